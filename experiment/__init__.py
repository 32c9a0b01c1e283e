"""What is poured, described once for both models, and the archive that both write."""

from experiment.cell import Cell
from experiment.errors import (
    ArchiveError,
    NotApplicableError,
    OutputExistsError,
    PictureError,
    SetupError,
    StoppedError,
    StratifyError,
)
from experiment.experiment import Experiment, Pour, Published
from experiment.feed import Feed
from experiment.mixture import Mixture
from experiment.presets import load, preset_names, preset_text
from experiment.schedule import Constant, Pulses, Sine, Table
from experiment.slopes import two_species_slopes
from experiment.source import Source

__all__ = [
    "ArchiveError",
    "Cell",
    "Constant",
    "Experiment",
    "Feed",
    "Mixture",
    "NotApplicableError",
    "OutputExistsError",
    "PictureError",
    "Pour",
    "Published",
    "Pulses",
    "SetupError",
    "Sine",
    "Source",
    "StoppedError",
    "StratifyError",
    "Table",
    "load",
    "preset_names",
    "preset_text",
    "two_species_slopes",
]
