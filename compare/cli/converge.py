"""`stratify converge`: pour a set-up on finer and finer grids."""

import json
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Event

import click
import xarray as xr
from rich.console import Console

import continuum
from compare.cli.inputs import folder_of, load_setup
from compare.cli.options import force_option, json_option, path_type, set_option
from compare.cli.terminal import open_bars, open_console, progress_on, say
from compare.convergence import converge as converge_archives
from compare.convergence import refinement_ratio
from compare.table import convergence_record, convergence_table
from experiment import Experiment, NotApplicableError, SetupError
from experiment.archive.files import make_folder, refuse_existing
from experiment.archive.storage import write_whole

__all__ = ["converge"]


@click.command()
@click.argument("setup")
@click.option(
    "--cells",
    default="100,200,400",
    show_default=True,
    metavar="N,N,N...",
    help="Numbers of cells, three or more, that grow by one ratio.",
)
@click.option(
    "-o",
    "--output",
    "path",
    type=path_type,
    metavar="FILE",
    help="Default: pours/SETUP/convergence.nc.",
)
@set_option
@json_option
@force_option
def converge(
    setup: str,
    cells: str,
    path: Path | None,
    settings: tuple[str, ...],
    as_json: bool,
    force: bool,
) -> None:
    """Pour SETUP by the continuum on finer and finer grids, and extrapolate what is measured.

    Prints one table of the wavelength and the velocities of kinks and fronts, and writes FILE.

    Example: stratify converge makse-stratification --cells 100,200,400,800
    """
    grids = _grids(setup, settings, cells)
    path = path or folder_of(setup) / "convergence.nc"
    refuse_existing([path], force=force)
    make_folder(path.parent)
    console = open_console(stderr=as_json)
    convergence = converge_archives(_pour_grids(grids, console))
    say(f"wrote {write_whole(convergence, path, force=force)}", console)
    if as_json:
        click.echo(json.dumps(convergence_record(convergence), indent=2))
        return
    console.print(convergence_table(convergence))
    say(convergence.attrs["comment"])


def _grids(setup: str, settings: tuple[str, ...], cells: str) -> list[Experiment]:
    """The set-up once for each number in `cells`, which is text such as 100,200,400."""
    try:
        numbers = [int(number) for number in cells.split(",")]
    except ValueError:
        raise SetupError(f"cells = {cells}: it should be numbers, as in 100,200,400") from None
    refinement_ratio(numbers)
    grids = [load_setup(setup, (*settings, f"continuum.cells={number}")) for number in numbers]
    for grid in grids:
        if grid.cell.shape == "drum":
            raise NotApplicableError("cell.shape = 'drum': what converges is measured in a pour")
        continuum.check(grid)
    return grids


def _pour_grids(grids: list[Experiment], console: Console) -> list[xr.Dataset]:
    """The continuum's pour of each, on as many threads as there are processors."""
    stopped = Event()
    with open_bars(console) as bars, ThreadPoolExecutor(os.cpu_count()) as pool:

        def pour_grid(grid: Experiment) -> xr.Dataset:
            with progress_on(f"{grid.continuum['cells']} cells", bars) as progress:

                def tell(share: float) -> None:
                    if stopped.is_set():
                        raise click.Abort
                    progress(share)

                return continuum.pour(grid, tell)

        try:
            longest_first = list(pool.map(pour_grid, reversed(grids)))
        finally:
            stopped.set()
    return longest_first[::-1]
