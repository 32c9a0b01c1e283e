"""What many jobs told, one array for each number and word."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compare.campaign.jobs import Attributes, Outcome
from experiment import StratifyError

__all__ = ["Table"]

FAILURE = {"long_name": "why a pour has no numbers"}


class Table:
    """The outcomes of so many jobs, as they come; NaN, or no word, where there is none."""

    def __init__(self, jobs: int) -> None:
        self.told = 0
        self.done = np.zeros(jobs, dtype=bool)
        self.failure = np.full(jobs, "", dtype=object)
        self._arrays: dict[str, NDArray[Any]] = {}
        self._attributes: Attributes = {}

    def put(self, number: int, outcome: Outcome) -> None:
        """Keep what came of the job of this number."""
        self.told += 1
        self.done[number] = True
        self.failure[number] = outcome.failure
        for name, value in outcome.measured.items():
            if name not in self._arrays:
                self._arrays[name] = _nothing(len(self.failure), value)
            self._arrays[name][number] = value
        self._attributes = self._attributes or outcome.attributes

    def values_of(self, name: str) -> NDArray[Any]:
        """One number of each job (job,)."""
        return self._arrays.get(name, np.full(len(self.done), np.nan))

    def variables(self, sizes: Mapping[str, int]) -> dict[str, tuple[Any, ...]]:
        """Every number over the dimensions of these `sizes`, and `failure`, as a Dataset takes it.

        Raises :class:`StratifyError` where every job failed.
        """
        if not self._arrays:
            reason = self.failure[0] if len(self.failure) else "there is none"
            raise StratifyError(f"no pour could be measured: {reason}")
        dims, shape = tuple(sizes), tuple(sizes.values())
        told: dict[str, tuple[Any, ...]] = {
            name: (dims, _plain(values).reshape(shape), dict(self._attributes[name]))
            for name, values in self._arrays.items()
        }
        return told | {"failure": (dims, _plain(self.failure).reshape(shape), FAILURE)}


def _nothing(size: int, like: float | str) -> NDArray[Any]:
    return np.full(size, "", dtype=object) if isinstance(like, str) else np.full(size, np.nan)


def _plain(values: NDArray[Any]) -> NDArray[Any]:
    return values.astype(str) if values.dtype == object else values
