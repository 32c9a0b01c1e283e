"""A pour under way: the loop that both models share, and the way to disk that survives a kill."""

from experiment.pouring.loop import (
    Begin,
    InMemory,
    Keeper,
    Pouring,
    Progress,
    Section,
    Sliced,
    pour_in_memory,
    run_to_the_end,
)
from experiment.pouring.streaming import pour_to_file

__all__ = [
    "Begin",
    "InMemory",
    "Keeper",
    "Pouring",
    "Progress",
    "Section",
    "Sliced",
    "pour_in_memory",
    "pour_to_file",
    "run_to_the_end",
]
