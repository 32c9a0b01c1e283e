"""The command line `stratify`: pour a mixture, compare the models, look at what came out."""

import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from threading import Event

import click
import xarray as xr
from rich.console import Console
from rich.progress import Progress

import ca_model
import continuum
from compare.campaign import CHECK, POUR
from compare.convergence import converge as converge_archives
from compare.convergence import refinement_ratio
from compare.ensemble import ranges
from compare.figure import draw, draw_photograph, save
from compare.measurement import compare as compare_archives
from compare.measurement import in_detail
from compare.photograph import View, measure_photograph
from compare.prediction import base, models_with_chance, with_piles, with_prediction
from compare.table import (
    as_records,
    convergence_record,
    convergence_table,
    layers_record,
    layers_table,
    table,
)
from experiment import (
    ArchiveError,
    Experiment,
    NotApplicableError,
    PictureError,
    SetupError,
    StratifyError,
    load,
    preset_names,
    preset_text,
)
from experiment.archive import read, write, write_whole
from experiment.files import make_folder, refuse_existing

__all__ = ["cli", "main"]

BAD_INPUT = 2

path_type = click.Path(path_type=Path)
force_option = click.option("--force", is_flag=True, help="Replace files that are there already.")
json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON instead of a table.")
set_option = click.option(
    "--set", "settings", multiple=True, metavar="KEY=VALUE", help="Change a field of the set-up."
)


@click.group(help=__doc__, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="stratify")
def cli() -> None:
    """All commands hang here."""


@cli.command()
@click.argument("name", required=False)
def presets(name: str | None) -> None:
    """List the presets, or print the one called NAME.

    Example: stratify presets glass-sugar > mine.toml
    """
    if name is not None:
        click.echo(preset_text(name), nl=False)
        return
    width = max(map(len, preset_names()))
    for preset in preset_names():
        click.echo(f"{preset:{width}}  {load(preset).title}")


@cli.command()
@click.argument("setup")
@click.option(
    "--model",
    type=click.Choice([*POUR, "both"]),
    default="both",
    show_default=True,
    help="Which model pours.",
)
@click.option(
    "-o", "--output", "folder", type=path_type, metavar="FOLDER", help="Default: pours/SETUP."
)
@set_option
@force_option
def pour(
    setup: str, model: str, folder: Path | None, settings: tuple[str, ...], force: bool
) -> None:
    """Pour SETUP, a preset or a TOML file; write FOLDER/ca_model.nc and FOLDER/continuum.nc.

    Example: stratify pour glass-sugar --set 'feed.inflow=[0.2,0.2]' -o pours/thicker
    """
    experiment = _load(setup, settings)
    folder = folder or _folder_of(setup)
    models = _applicable(experiment, list(POUR) if model == "both" else [model])
    paths = {name: folder / f"{name}.nc" for name in models}
    refuse_existing(paths.values(), force=force)
    make_folder(folder)
    for name, path in paths.items():
        with _bars() as bars, _progress(name, bars) as progress:
            archive = POUR[name](experiment, progress)
        _say(f"{name}: wrote {write(archive, path, force=force)}")


@cli.command()
@click.argument("folders", nargs=-1, required=True, type=path_type, metavar="FOLDER...")
@click.option(
    "--vary",
    multiple=True,
    metavar="KEY=LOW:HIGH",
    help="What is uncertain, besides the set-up's own [uncertain].",
)
@click.option(
    "--draws",
    type=click.IntRange(0, 1_000_000),
    default=32,
    show_default=True,
    help="Pours that predict a range, where something is uncertain.",
)
@click.option(
    "--seeds",
    type=click.IntRange(0, 1_000_000),
    default=0,
    show_default=True,
    help="Piles to average over, in a model where chance matters.",
)
@json_option
@force_option
def compare(
    folders: tuple[Path, ...],
    vary: tuple[str, ...],
    draws: int,
    seeds: int,
    as_json: bool,
    force: bool,
) -> None:
    """Measure kinks and layers in each FOLDER that `pour` wrote; put the models side by side.

    Prints one table, and writes comparison.nc and comparison.png into each folder. Where inputs are
    uncertain, it pours draws of them and predicts ranges.

    Example: stratify compare pours/glass-sugar --vary mixture.psi=0.1:0.3 --draws 64
    """
    outputs = [folder / name for folder in folders for name in ("comparison.nc", "comparison.png")]
    refuse_existing(outputs, force=force)
    archives = [_read_all(folder) for folder in folders]
    setups = [base(models, ranges(vary)) for models in archives]
    comparisons = [compare_archives(models) for models in archives]
    pictures = [draw(models) for models in archives]
    console = _console(stderr=as_json)
    for k, setup in enumerate(setups):
        comparisons[k] = _with_campaigns(comparisons[k], setup, draws, seeds, console)
    for folder, models, comparison, picture in zip(
        folders, archives, comparisons, pictures, strict=True
    ):
        save(picture, folder / "comparison.png", force=force)
        write_whole(comparison, folder / "comparison.nc", in_detail(models), force=force)
    if as_json:
        records = {str(f): as_records(c) for f, c in zip(folders, comparisons, strict=True)}
        click.echo(json.dumps(records, indent=2))
        return
    console.print(table(comparisons))
    for comparison in comparisons:
        for comment in comparison.attrs.get("comment", "").splitlines():
            _say(f"{comparison.attrs['title']}: {comment}")


@cli.command()
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
    path = path or _folder_of(setup) / "convergence.nc"
    refuse_existing([path], force=force)
    make_folder(path.parent)
    console = _console(stderr=as_json)
    convergence = converge_archives(_pour_grids(grids, console))
    _say(f"wrote {write_whole(convergence, path, force=force)}", console)
    if as_json:
        click.echo(json.dumps(convergence_record(convergence), indent=2))
        return
    console.print(convergence_table(convergence))
    _say(convergence.attrs["comment"])


@cli.command()
@click.argument("file", type=path_type)
@click.option(
    "-o", "--output", type=path_type, metavar="PICTURE", help="Default: FILE, ending in .png."
)
@force_option
def show(file: Path, output: Path | None, force: bool) -> None:
    """Draw the deposit and the kymograph of the archive FILE.

    Example: stratify show pours/glass-sugar/continuum.nc -o picture.png
    """
    archive = read(file)
    picture = output or file.with_suffix(".png")
    refuse_existing([picture], force=force)
    _say(f"wrote {save(draw([archive]), picture, force=force)}")


@cli.command()
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
    _say(f"wrote {write_whole(found, path, force=force)}", _console(stderr=as_json))
    if as_json:
        click.echo(json.dumps(layers_record(found), indent=2))
        return
    _console().print(layers_table(found))
    for comment in found.attrs["comment"].splitlines():
        _say(comment)


def main() -> None:
    """Run the command line; what a user can mend ends in one line and exit status 2."""
    try:
        cli.main(standalone_mode=False)
    except StratifyError as error:
        _fail(str(error))
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message())
        sys.exit(BAD_INPUT)
    except click.ClickException as error:
        _fail(error.format_message())
    except MemoryError as error:
        _fail(f"this takes more memory than there is: {error}")
    except (click.Abort, KeyboardInterrupt):
        _fail("stopped; what was not yet written under its name is lost")


def _fail(reason: str) -> None:
    click.echo(f"stratify: {' '.join(reason.split())}", err=True)
    sys.exit(BAD_INPUT)


def _applicable(experiment: Experiment, models: list[str]) -> list[str]:
    """Which of the models can pour; the others say why, and if none can, that is an error."""
    able: list[str] = []
    for name in models:
        try:
            CHECK[name](experiment)
        except NotApplicableError as refusal:
            if not able and name == models[-1]:
                raise
            _say(f"{name}: does not apply: {refusal}")
        else:
            able.append(name)
    return able


def _read_all(folder: Path) -> list[xr.Dataset]:
    """The archives of a folder, one for each model that poured there."""
    paths = [folder / f"{name}.nc" for name in POUR]
    there = [path for path in paths if path.exists()]
    if not there:
        raise ArchiveError(f"{str(folder)!r} holds no archive; allowed: a folder that `pour` wrote")
    return [read(path) for path in there]


def _with_campaigns(
    comparison: xr.Dataset, experiment: Experiment, draws: int, seeds: int, console: Console
) -> xr.Dataset:
    """The comparison with its prediction, if something is uncertain, and with means over piles."""
    if experiment.uncertain and draws:
        with _bars(console) as bars, _progress(f"{draws} draws", bars) as progress:
            comparison = with_prediction(comparison, experiment, draws, progress)
    if seeds and not models_with_chance(experiment, comparison["model_name"].values.tolist()):
        _say(f"{experiment.title}: chance has no part in it, all piles are alike", console)
    elif seeds:
        with _bars(console) as bars, _progress(f"{seeds} piles", bars) as progress:
            comparison = with_piles(comparison, experiment, seeds, progress)
    return comparison


def _load(setup: str, settings: tuple[str, ...]) -> Experiment:
    """The set-up, its models' own tables read too, so that a slip in either is found at once."""
    experiment = load(setup, settings)
    ca_model.Settings.parse(experiment.ca_model, "ca_model")
    continuum.Resolution.parse(experiment.continuum, "continuum")
    return experiment


def _folder_of(setup: str) -> Path:
    return Path("pours") / Path(setup).stem


def _grids(setup: str, settings: tuple[str, ...], cells: str) -> list[Experiment]:
    """The set-up once for each number in `cells`, which is text such as 100,200,400."""
    try:
        numbers = [int(number) for number in cells.split(",")]
    except ValueError:
        raise SetupError(f"cells = {cells}: it should be numbers, as in 100,200,400") from None
    refinement_ratio(numbers)
    grids = [_load(setup, (*settings, f"continuum.cells={number}")) for number in numbers]
    for grid in grids:
        if grid.cell.shape == "drum":
            raise NotApplicableError("cell.shape = 'drum': what converges is measured in a pour")
        continuum.check(grid)
    return grids


def _pour_grids(grids: list[Experiment], console: Console) -> list[xr.Dataset]:
    """The continuum's pour of each, on as many threads as there are processors."""
    stopped = Event()
    with _bars(console) as bars, ThreadPoolExecutor(os.cpu_count()) as pool:

        def pour_grid(grid: Experiment) -> xr.Dataset:
            with _progress(f"{grid.continuum['cells']} cells", bars) as progress:

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


@contextmanager
def _bars(console: Console | None = None) -> Iterator[Progress]:
    """Where bars of progress are drawn, on a terminal only."""
    console = console or _console()
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bars:
        yield bars


@contextmanager
def _progress(name: str, bars: Progress) -> Iterator[Callable[[float], object]]:
    """A bar while it pours, a line once it has."""
    started = time.perf_counter()
    task = bars.add_task(name, total=1.0)
    yield lambda share: bars.update(task, completed=share)
    _say(f"{name}: poured in {time.perf_counter() - started:.1f} s", bars.console)


def _console(*, stderr: bool = False) -> Console:
    """Where to print: as wide as the terminal, or as wide as the table needs."""
    stream = sys.stderr if stderr else sys.stdout
    return Console(highlight=False, stderr=stderr, width=None if stream.isatty() else 100)


def _say(line: str, console: Console | None = None) -> None:
    (console or _console()).print(line, soft_wrap=True, markup=False)


if __name__ == "__main__":
    main()
