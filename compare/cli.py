"""The command line `stratify`: pour a mixture, compare the models, look at what came out."""

import json
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import click
import xarray as xr
from rich.console import Console
from rich.progress import Progress

import ca_model
import continuum
from compare.figure import draw, save
from compare.measurement import compare as compare_archives
from compare.table import as_records, table
from experiment import (
    ArchiveError,
    Experiment,
    NotApplicableError,
    StratifyError,
    load,
    preset_names,
    preset_text,
)
from experiment.archive import read, write, write_whole
from experiment.files import make_folder, refuse_existing

__all__ = ["cli", "main"]

BAD_INPUT = 2
POUR: dict[str, Callable[..., xr.Dataset]] = {
    "ca_model": ca_model.pour,
    "continuum": continuum.pour,
}
CHECK = {"ca_model": ca_model.check, "continuum": continuum.check}

path_type = click.Path(path_type=Path)
force_option = click.option("--force", is_flag=True, help="Replace files that are there already.")


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
@click.option(
    "--set", "settings", multiple=True, metavar="KEY=VALUE", help="Change a field of the set-up."
)
@force_option
def pour(
    setup: str, model: str, folder: Path | None, settings: tuple[str, ...], force: bool
) -> None:
    """Pour SETUP, a preset or a TOML file; write FOLDER/ca_model.nc and FOLDER/continuum.nc.

    Example: stratify pour glass-sugar --set 'feed.inflow=[0.2,0.2]' -o pours/thicker
    """
    experiment = load(setup, settings)
    folder = folder or Path("pours") / Path(setup).stem
    ca_model.Settings.parse(experiment.ca_model, "ca_model")
    continuum.Resolution.parse(experiment.continuum, "continuum")
    models = _applicable(experiment, list(POUR) if model == "both" else [model])
    paths = {name: folder / f"{name}.nc" for name in models}
    refuse_existing(paths.values(), force=force)
    make_folder(folder)
    for name, path in paths.items():
        with _progress(name) as progress:
            archive = POUR[name](experiment, progress)
        _say(f"{name}: wrote {write(archive, path, force=force)}")


@cli.command()
@click.argument("folders", nargs=-1, required=True, type=path_type, metavar="FOLDER...")
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of a table.")
@force_option
def compare(folders: tuple[Path, ...], as_json: bool, force: bool) -> None:
    """Measure kinks and layers in each FOLDER that `pour` wrote; put the models side by side.

    Prints one table, and writes comparison.nc and comparison.png into each folder.

    Example: stratify compare pours/glass-sugar pours/thicker
    """
    outputs = [folder / name for folder in folders for name in ("comparison.nc", "comparison.png")]
    refuse_existing(outputs, force=force)
    archives = [_read_all(folder) for folder in folders]
    comparisons = [compare_archives(models) for models in archives]
    pictures = [draw(models) for models in archives]
    for folder, comparison, picture in zip(folders, comparisons, pictures, strict=True):
        save(picture, folder / "comparison.png", force=force)
        write_whole(comparison, folder / "comparison.nc", force=force)
    if as_json:
        records = {str(f): as_records(c) for f, c in zip(folders, comparisons, strict=True)}
        click.echo(json.dumps(records, indent=2))
        return
    _console().print(table(comparisons))
    for comparison in comparisons:
        for comment in comparison.attrs.get("comment", "").splitlines():
            _say(f"{comparison.attrs['title']}: {comment}")


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


@contextmanager
def _progress(name: str) -> Iterator[Callable[[float], object] | None]:
    """A bar on a terminal, a line elsewhere."""
    started = time.perf_counter()
    console = _console()
    if console.is_terminal:
        with Progress(console=console, transient=True) as bar:
            task = bar.add_task(name, total=1.0)
            yield lambda share: bar.update(task, completed=share)
    else:
        yield None
    _say(f"{name}: poured in {time.perf_counter() - started:.1f} s")


def _console() -> Console:
    """Where to print: as wide as the terminal, or as wide as the table needs."""
    return Console(highlight=False, width=None if sys.stdout.isatty() else 100)


def _say(line: str) -> None:
    _console().print(line, soft_wrap=True, markup=False)


if __name__ == "__main__":
    main()
