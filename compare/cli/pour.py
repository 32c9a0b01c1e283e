"""`stratify pour`: pour a set-up, by one model or both."""

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import click

from compare.campaign import BEGIN
from compare.cli.inputs import applicable, folder_of, load_setup, model_of, ruled
from compare.cli.options import force_option, path_type, rule_option, set_option
from compare.cli.stopping import Stop, tell_how_to_go_on
from compare.cli.terminal import open_bars, progress_on, say
from experiment import Experiment, StoppedError
from experiment.archive.files import refuse_existing
from experiment.archive.places import archive_at
from experiment.archive.storage import content_of, told_by
from experiment.pouring.streaming import EVERY, pour_to_file

__all__ = ["pour"]


@click.command()
@click.argument("setup")
@click.option(
    "--model",
    type=click.Choice([*BEGIN, "both"]),
    help="Which model pours. Default: both, or the one that poured the archive SETUP.",
)
@click.option(
    "-o",
    "--output",
    "folder",
    type=path_type,
    metavar="FOLDER",
    help="Default: pours/SETUP. One that ends in .zarr is a Zarr store.",
)
@rule_option
@set_option
@force_option
@click.option("--resume", is_flag=True, help="Go on with a pour that was stopped or killed.")
@click.option(
    "--extend", is_flag=True, help="Go on from the archives in FOLDER, to a longer pour.duration."
)
@click.option(
    "--checkpoint",
    "every",
    type=click.FloatRange(min=0.0),
    default=EVERY,
    show_default=True,
    metavar="SECONDS",
    help="How often to write down what --resume goes on from.",
)
def pour(
    setup: str,
    model: str | None,
    folder: Path | None,
    rule: str | None,
    settings: tuple[str, ...],
    force: bool,
    resume: bool,
    extend: bool,
    every: float,
) -> None:
    """Pour SETUP, a preset, a TOML file or an archive, which is poured again from itself.

    Writes FOLDER/ca_model.nc and FOLDER/continuum.nc. While it pours, the work is beside them in
    folders that end in .unfinished; a pour that was stopped or killed goes on with --resume.

    With -o run.zarr the archives are the groups run.zarr/ca_model and run.zarr/continuum, the work
    is beside run.zarr, and every command takes that for a folder. Needs zarr: pip install
    'stratify[zarr]'.

    Example: stratify pour glass-sugar --set 'feed.inflow=[0.2,0.2]' -o pours/thicker
    """
    poured_by = model_of(setup)
    model = model or poured_by or "both"
    settings = ruled(settings, rule, model)
    experiment = load_setup(setup, settings)
    folder = folder or folder_of(setup)
    again = None if settings else poured_by
    before = None if again is None else _content_and_source(Path(setup))
    models = list(BEGIN) if model == "both" else [model]
    models = applicable(experiment, models, wanted=rule and "ca_model")
    paths = {name: archive_at(folder, name) for name in models}
    if not (resume or extend):
        refuse_existing(paths.values(), force=force)
    with Stop() as stop:
        how = partial(pour_to_file, resume=resume, extend=extend, force=force, every=every)
        for name, path in paths.items():
            is_new = _pour_one(name, experiment, path, how, stop)
            say(f"{name}: wrote {path}" if is_new else f"{name}: {path} is whole already")
            if before is not None and name == again:
                say(f"{name}: {_verdict(setup, before, path)}")


def _pour_one(
    name: str, experiment: Experiment, path: Path, how: Callable[..., bool], stop: Stop
) -> bool:
    """Whether a model had anything to pour; ends the process where it was stopped."""
    try:
        with open_bars() as bars, progress_on(name, bars) as progress:
            return how(BEGIN[name], experiment, path, progress=progress, stop=stop)
    except (StoppedError, KeyboardInterrupt) as stopped:
        tell_how_to_go_on(f"{name}: {stopped or 'stopped at once'}")
        sys.exit(128 + stop.signal)


def _content_and_source(archive: Path) -> tuple[str, str]:
    return content_of(archive), told_by(archive, "source")


def _verdict(archive: str, before: tuple[str, str], again: Path) -> str:
    """Whether an archive, which this pour may have replaced, came out the same."""
    content, source = before
    if content_of(again) == content:
        return f"it holds what {archive} holds, bit for bit"
    return f"it differs from {archive}, which is by {source}"
