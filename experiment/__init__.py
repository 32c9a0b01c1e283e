"""What is poured, described once for both models, and the archive that both write."""

from experiment.cell import Cell
from experiment.errors import (
    ArchiveError,
    NotApplicableError,
    OutputExistsError,
    SetupError,
    StratifyError,
)
from experiment.experiment import Experiment, Pour, Published
from experiment.feed import Feed
from experiment.mixture import Mixture, two_species_slopes
from experiment.presets import load, preset_names, preset_text

__all__ = [
    "ArchiveError",
    "Cell",
    "Experiment",
    "Feed",
    "Mixture",
    "NotApplicableError",
    "OutputExistsError",
    "Pour",
    "Published",
    "SetupError",
    "StratifyError",
    "load",
    "preset_names",
    "preset_text",
    "two_species_slopes",
]
