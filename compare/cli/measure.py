"""`stratify measure`: measure the layers in a photograph."""

import json
from pathlib import Path

import click

from compare.cli.options import force_option, json_option, path_type
from compare.cli.terminal import open_console, say
from compare.photograph import View, measure_photograph
from compare.pictures import draw_photograph, save
from compare.table import layers_record, layers_table
from experiment import PictureError, SetupError
from experiment.archive.files import refuse_existing
from experiment.archive.storage import write_whole

__all__ = ["measure"]


@click.command()
@click.argument("picture", type=path_type)
@click.option(
    "--scale",
    required=True,
    metavar="LENGTH",
    help="Width of what --crop leaves, or of the cell that --corners tell: 30cm, 0.3m, 300mm. "
    "With corners, better width and height: 30x20cm.",
)
@click.option(
    "--crop",
    metavar="LEFT,TOP,RIGHT,BOTTOM",
    help="The part to measure, in pixels or %, as in 5%,0,95%,90%.",
)
@click.option(
    "--corners",
    nargs=4,
    metavar="X,Y X,Y X,Y X,Y",
    help="Corners of the cell in the picture, in pixels, clockwise from the upper left.",
)
@click.option(
    "--rotate",
    type=float,
    default=0.0,
    metavar="DEGREES",
    help="Turn anticlockwise first, so that the vertical is upright.",
)
@click.option(
    "--large",
    default="bright",
    show_default=True,
    metavar="COLOUR",
    help="Colour of the large grains: bright, dark, or the name of what it is nearest to.",
)
@click.option(
    "-o", "--output", "path", type=path_type, metavar="FILE", help="Default: PICTURE.layers.nc."
)
@json_option
@force_option
def measure(
    picture: Path,
    scale: str,
    crop: str | None,
    corners: tuple[str, ...] | None,
    rotate: float,
    large: str,
    path: Path | None,
    as_json: bool,
    force: bool,
) -> None:
    """Measure the layers of a deposit in a photograph or any PICTURE of it, as in an archive.

    Prints one table, and writes FILE and, ending in .png, a picture to check it by. Air above the
    deposit and ground below it are found where each has a colour of its own; else crop them away.
    Needs scikit-image: pip install 'stratify[photo]'.

    Example: stratify measure cell.jpg --scale 30x20cm --corners 40,52 1190,60 1240,830 12,815
    """
    view = View.parse(scale, crop, corners, rotate)
    if not picture.is_file():
        raise PictureError(f"{str(picture)!r}: no such picture")
    path = path or picture.with_name(f"{picture.stem}.layers.nc")
    drawing = path.with_suffix(".png")
    if picture in (path, drawing):
        raise SetupError(f"output = {path}: it would replace the picture that is measured")
    if path.suffix != ".nc":
        raise SetupError(f"output = {path}: it should end in .nc")
    refuse_existing([path, drawing], force=force)
    found = measure_photograph(picture, view, large)
    save(draw_photograph(found), drawing, force=force)
    say(f"wrote {write_whole(found, path, force=force)}", open_console(stderr=as_json))
    if as_json:
        click.echo(json.dumps(layers_record(found), indent=2))
        return
    open_console().print(layers_table(found))
    for comment in found.attrs["comment"].splitlines():
        say(comment)
