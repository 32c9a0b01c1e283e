"""The set-ups that come with the package: each a TOML file beside this one."""

from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

from experiment.archive.places import is_archive
from experiment.archive.storage import told_by
from experiment.errors import SetupError
from experiment.experiment import Experiment

__all__ = ["load", "preset_names", "preset_text"]


def preset_names() -> list[str]:
    """Names of all presets, in alphabetical order."""
    names = (entry.name for entry in files(__name__).iterdir())
    return sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml"))


def preset_text(name: str) -> str:
    """The TOML text of a preset. Raises :class:`SetupError` where there is none of that name."""
    if name not in preset_names():
        raise SetupError(
            f"set-up {name!r}: no such preset or file; presets: {', '.join(preset_names())}"
        )
    return (files(__name__) / f"{name}.toml").read_text(encoding="utf-8")


def load(setup: str, settings: Sequence[str] = ()) -> Experiment:
    """The experiment of a preset, a TOML file or an archive, with `settings` (KEY=VALUE each).

    Raises :class:`SetupError` with one line where the name, the file or a setting is wrong, and
    :class:`ArchiveError` where the archive cannot be read.
    """
    path = Path(setup)
    if is_archive(path):
        return Experiment.from_toml(told_by(path, "experiment"), settings)
    if setup not in preset_names() and (
        path.suffix == ".toml" or (path.exists() and not path.is_dir())
    ):
        return Experiment.from_file(path, settings)
    return Experiment.from_toml(preset_text(setup), settings)
