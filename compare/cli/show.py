"""`stratify show`: draw one archive."""

from pathlib import Path

import click

from compare.cli.options import force_option, path_type
from compare.cli.terminal import say
from compare.pictures import draw, save
from experiment.archive import read
from experiment.archive.files import refuse_existing
from experiment.archive.places import beside

__all__ = ["show"]


@click.command()
@click.argument("file", type=path_type)
@click.option(
    "-o", "--output", type=path_type, metavar="PICTURE", help="Default: FILE, ending in .png."
)
@force_option
def show(file: Path, output: Path | None, force: bool) -> None:
    """Draw the deposit and the kymograph of the archive FILE, or of the group run.zarr/continuum.

    The picture of a group is beside its store: run.continuum.png.

    Example: stratify show pours/glass-sugar/continuum.nc -o picture.png
    """
    archive = read(file)
    picture = output or beside(file.with_suffix(".png"))
    refuse_existing([picture], force=force)
    say(f"wrote {save(draw([archive]), picture, force=force)}")
