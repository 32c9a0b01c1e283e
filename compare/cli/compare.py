"""`stratify compare`: compare the models that poured in a folder."""

import json
from pathlib import Path

import click
import xarray as xr
from rich.console import Console

from compare.cli.inputs import archives_of
from compare.cli.options import force_option, json_option, path_type
from compare.cli.terminal import open_bars, open_console, progress_on, say
from compare.ensemble import ranges
from compare.measurement import compare as compare_archives
from compare.measurement import in_detail
from compare.pictures import draw, save
from compare.prediction import base, models_with_chance, with_piles, with_prediction
from compare.table import as_records, table
from experiment import Experiment
from experiment.archive.files import refuse_existing
from experiment.archive.places import beside
from experiment.archive.storage import write_whole

__all__ = ["compare"]


@click.command()
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

    Prints one table, and writes comparison.nc and comparison.png into each folder; beside a Zarr
    store run.zarr they are run.comparison.nc and run.comparison.png. Where inputs are uncertain, it
    pours draws of them and predicts ranges.

    Example: stratify compare pours/glass-sugar --vary mixture.psi=0.1:0.3 --draws 64
    """
    files = [beside(folder / "comparison.nc") for folder in folders]
    refuse_existing([*files, *(file.with_suffix(".png") for file in files)], force=force)
    archives = [archives_of(folder) for folder in folders]
    setups = [base(models, ranges(vary)) for models in archives]
    comparisons = [compare_archives(models) for models in archives]
    pictures = [draw(models) for models in archives]
    console = open_console(stderr=as_json)
    for k, setup in enumerate(setups):
        comparisons[k] = _with_campaigns(comparisons[k], setup, draws, seeds, console)
    for file, models, comparison, picture in zip(
        files, archives, comparisons, pictures, strict=True
    ):
        save(picture, file.with_suffix(".png"), force=force)
        write_whole(comparison, file, in_detail(models), force=force)
    if as_json:
        records = {str(f): as_records(c) for f, c in zip(folders, comparisons, strict=True)}
        click.echo(json.dumps(records, indent=2))
        return
    console.print(table(comparisons))
    for comparison in comparisons:
        for comment in comparison.attrs.get("comment", "").splitlines():
            say(f"{comparison.attrs['title']}: {comment}")


def _with_campaigns(
    comparison: xr.Dataset, experiment: Experiment, draws: int, seeds: int, console: Console
) -> xr.Dataset:
    """The comparison with its prediction, if something is uncertain, and with means over piles."""
    if experiment.uncertain and draws:
        with open_bars(console) as bars, progress_on(f"{draws} draws", bars) as progress:
            comparison = with_prediction(comparison, experiment, draws, progress)
    if seeds and not models_with_chance(experiment, comparison["model_name"].values.tolist()):
        say(f"{experiment.title}: chance has no part in it, all piles are alike", console)
    elif seeds:
        with open_bars(console) as bars, progress_on(f"{seeds} piles", bars) as progress:
            comparison = with_piles(comparison, experiment, seeds, progress)
    return comparison
