"""When a pour is recorded, and where the records go: allocated from the table of variables."""

from collections.abc import Iterator

import numpy as np

from experiment.arrays import Floats
from experiment.errors import ArchiveError, SetupError
from experiment.experiment import Pour
from experiment.variables import COORDINATES, VARIABLES

__all__ = ["Recorder", "edges_of_steps", "record_steps"]

MOST_STEPS = 10**9
BLOCK = 65_536


def record_steps(pour: Pour, dt: float) -> list[int]:
    """The steps after which a record is kept, from 0 on, for a model whose step lasts `dt` [s].

    Records are evenly spaced in time as far as whole steps allow; none is kept twice. Raises
    :class:`SetupError` for a pour of more steps than anybody would wait for.
    """
    last = max(1, round(pour.duration / dt))
    if last > MOST_STEPS:
        raise SetupError(
            f"pour.duration = {pour.duration:g}: it makes {last:.2g} steps of {dt:.2g} s; "
            f"it should make at most {MOST_STEPS:.0e}"
        )
    return sorted({round(k * last / pour.records) for k in range(pour.records + 1)})


def edges_of_steps(first: int, last: int, dt: float) -> Iterator[Floats]:
    """Times [s] at which the steps from `first` up to `last` begin and the last one ends.

    In blocks that fit into memory.
    """
    for start in range(first, last, BLOCK):
        yield np.arange(start, min(start + BLOCK, last) + 1) * dt


class Recorder:
    """The variables along `time`, one record at a time."""

    def __init__(self, records: int, cells: int, species: int) -> None:
        sizes = {"time": records, "x": cells, "species": species}
        table = COORDINATES | VARIABLES
        self.arrays: dict[str, Floats] = {
            name: np.full([sizes[dim] for dim in variable.dims], np.nan)
            for name, variable in table.items()
            if "time" in variable.dims
        }

    def keep(self, record: int, **values: float | Floats) -> None:
        """Keep one record; `values` must name every variable along `time`."""
        if set(values) != set(self.arrays):
            odd = sorted(set(values) ^ set(self.arrays))
            raise ArchiveError(f"record {record}: {odd[0]!r} is missing or unknown")
        for name, value in values.items():
            self.arrays[name][record] = value
