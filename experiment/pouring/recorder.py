"""When a pour is recorded, and where the records go: allocated from the table of variables."""

from collections.abc import Iterator

import numpy as np

from experiment.archive.variables import COORDINATES, VARIABLES
from experiment.arrays import Floats
from experiment.errors import ArchiveError, SetupError
from experiment.experiment import Pour

__all__ = ["Recorder", "edges_of_steps", "record_steps"]

MOST_STEPS = 10**9


def record_steps(pour: Pour, dt: float) -> list[int]:
    """The steps after which a record is kept, from 0 on, for a model whose step lasts `dt` [s].

    Records are evenly spaced in time as far as whole steps allow; none is kept twice. A pour that
    is longer at the same spacing has the same records, and more. Raises :class:`SetupError` for a
    pour of more steps than anybody would wait for.
    """
    last = max(1, round(pour.duration / dt))
    if last > MOST_STEPS:
        raise SetupError(
            f"pour.duration = {pour.duration:g}: it makes {last:.2g} steps of {dt:.2g} s; "
            f"it should make at most {MOST_STEPS:.0e}"
        )
    interval = pour.duration / pour.records
    steps = (round(k * interval / dt) for k in range(pour.records))
    return sorted({*(step for step in steps if step < last), last})


def edges_of_steps(first: int, last: int, dt: float, block: int) -> Iterator[Floats]:
    """Times [s] at which the steps from `first` up to `last` begin and the last one ends.

    In blocks of `block` steps.
    """
    for start in range(first, last, block):
        yield np.arange(start, min(start + block, last) + 1) * dt


class Recorder:
    """The variables along `time`, one record at a time; room for so many at once."""

    def __init__(self, room: int, columns: int, species: int) -> None:
        sizes = {"time": room, "x": columns, "species": species}
        self.room = room
        self.kept = 0
        self._arrays: dict[str, Floats] = {
            name: np.full([sizes[dim] for dim in variable.dims], np.nan)
            for name, variable in (COORDINATES | VARIABLES).items()
            if "time" in variable.dims
        }

    @property
    def arrays(self) -> dict[str, Floats]:
        """What is kept, each variable (time, ...)."""
        return {name: values[: self.kept] for name, values in self._arrays.items()}

    def keep(self, **values: float | Floats) -> None:
        """Keep one record; `values` must name every variable along `time`."""
        if values.keys() != self._arrays.keys():
            odd = sorted(values.keys() ^ self._arrays.keys())
            raise ArchiveError(f"record {self.kept}: {odd[0]!r} is missing or unknown")
        for name, value in values.items():
            self._arrays[name][self.kept] = value
        self.kept += 1

    @property
    def is_full(self) -> bool:
        """Whether there is no room for another record."""
        return self.kept == self.room

    def forget(self) -> None:
        """Make room again."""
        self.kept = 0
