"""When a pour is recorded, and where the records go: allocated from the table of variables."""

import numpy as np

from experiment.arrays import Floats
from experiment.errors import ArchiveError
from experiment.experiment import Pour
from experiment.variables import COORDINATES, VARIABLES

__all__ = ["Recorder", "record_steps"]


def record_steps(pour: Pour, dt: float) -> list[int]:
    """The steps after which a record is kept, from 0 on, for a model whose step lasts `dt` [s].

    Records are evenly spaced in time as far as whole steps allow; none is kept twice.
    """
    last = max(1, round(pour.duration / dt))
    return sorted({round(k * last / pour.records) for k in range(pour.records + 1)})


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
