"""The archive of both models: what is in it, how it lies in a file, what proves that whole."""

from experiment.archive.layout import (
    CONVENTIONS,
    assemble,
    check,
    experiment_of,
    history,
    load,
    read,
    write,
)

__all__ = [
    "CONVENTIONS",
    "assemble",
    "check",
    "experiment_of",
    "history",
    "load",
    "read",
    "write",
]
