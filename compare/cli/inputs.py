"""What a user names: a set-up, and the folder with the archives that were poured from one."""

from pathlib import Path

import xarray as xr
from rich.console import Console

import ca_model
import continuum
from compare.campaign import CHECK, POUR
from compare.cli.terminal import say
from experiment import ArchiveError, Experiment, NotApplicableError, SetupError, load
from experiment.archive import read
from experiment.archive.places import archive_at, is_archive
from experiment.archive.storage import told_by

__all__ = ["applicable", "archives_of", "folder_of", "load_setup", "model_of", "ruled"]

SAYS_THE_RULE = ("ca_model", "ca_model.rule")


def load_setup(setup: str, settings: tuple[str, ...]) -> Experiment:
    """The set-up, its models' own tables read too, so that a slip in either is found at once."""
    experiment = load(setup, settings)
    ca_model.Settings.parse(experiment.ca_model, "ca_model")
    continuum.Resolution.parse(experiment.continuum, "continuum")
    return experiment


def ruled(
    settings: tuple[str, ...], rule: str | None, model: str, varied: tuple[str, ...] = ()
) -> tuple[str, ...]:
    """The settings, with the lattice's `rule` among them if it is told.

    Raises :class:`SetupError` where the `model` that pours has no rules, or where one of the
    settings or of the fields that are `varied` says the rule, too.
    """
    if rule is None:
        return settings
    if model == "continuum":
        raise SetupError(f"--rule {rule}: the continuum has none; allowed: --model ca_model, both")
    for option, texts in (("--set", settings), ("--vary", varied)):
        for text in texts:
            if text.partition("=")[0].strip() in SAYS_THE_RULE:
                raise SetupError(f"--rule {rule}: {option} {text!r} says it too; allowed: either")
    return (*settings, f"ca_model.rule={rule}")


def model_of(setup: str) -> str | None:
    """The model that poured the archive `setup`; None where that is a preset or a TOML file."""
    path = Path(setup)
    return told_by(path, "model") if is_archive(path) else None


def folder_of(setup: str) -> Path:
    """Where what is poured from a set-up goes, if the user names no folder."""
    return Path("pours") / Path(setup).stem


def archives_of(folder: Path) -> list[xr.Dataset]:
    """The archives of a folder, one for each model that poured there."""
    paths = [archive_at(folder, name) for name in POUR]
    there = [path for path in paths if path.exists()]
    if not there:
        raise ArchiveError(f"{str(folder)!r} holds no archive; allowed: a folder that `pour` wrote")
    return [read(path) for path in there]


def applicable(
    experiment: Experiment,
    models: list[str],
    console: Console | None = None,
    *,
    wanted: str | None = None,
) -> list[str]:
    """Which of the models can pour; the others say why.

    That none of them can, or not the one that is `wanted`, is an error.
    """
    able: list[str] = []
    for name in models:
        try:
            CHECK[name](experiment)
        except NotApplicableError as refusal:
            if name == wanted or (not able and name == models[-1]):
                raise
            say(f"{name}: does not apply: {refusal}", console)
        else:
            able.append(name)
    return able
