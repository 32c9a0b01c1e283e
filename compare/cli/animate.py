"""`stratify animate`: make a film of one archive."""

from pathlib import Path

import click

from compare.cli.options import force_option, path_type
from compare.cli.stopping import Stop
from compare.cli.terminal import open_bars, progress_on, say
from compare.pictures import animate as make_film
from experiment.archive import read
from experiment.archive.files import refuse_existing, refuse_folder
from experiment.archive.places import beside

__all__ = ["animate"]


@click.command()
@click.argument("file", type=path_type)
@click.option(
    "-o", "--output", type=path_type, metavar="FILM", help="Default: FILE, ending in .mp4."
)
@click.option("--seconds", type=float, help="Length of the film.  [default: 20, a .gif 12]")
@click.option("--fps", type=float, help="Frames a second.  [default: 25, a .gif 10]")
@click.option("--from", "start", type=float, metavar="TIME", help="Begin at this time of the pour.")
@click.option("--to", "end", type=float, metavar="TIME", help="End at this time of the pour.")
@force_option
def animate(
    file: Path,
    output: Path | None,
    seconds: float | None,
    fps: float | None,
    start: float | None,
    end: float | None,
    force: bool,
) -> None:
    """Make a film of the archive FILE, or of the group run.zarr/continuum: the pile as it grows.

    What rolls is coloured by species; kinks and avalanche fronts are marked once they are told,
    after the transient. FILM ends in .mp4 or .gif. Needs ffmpeg: pip install 'stratify[film]'.

    Example: stratify animate pours/glass-sugar/continuum.nc -o pour.mp4
    """
    film = output or beside(file.with_suffix(".mp4"))
    refuse_folder(film)
    refuse_existing([film], force=force)
    archive = read(file)
    with (
        Stop() as stop,
        open_bars() as bars,
        progress_on(film.name, bars, "filmed") as progress,
    ):

        def tell(share: float) -> None:
            progress(share)
            if stop():
                raise KeyboardInterrupt

        make_film(
            archive,
            film,
            fps=fps,
            seconds=seconds,
            start=start,
            end=end,
            force=force,
            progress=tell,
        )
    say(f"wrote {film}")
