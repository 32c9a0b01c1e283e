"""What one check says: what should come out, what did, and how far apart the two may be."""

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import xarray as xr

__all__ = ["POWER", "ROUND_OFF", "SCHEME", "Check", "Checks", "Poured", "Subject"]

ROUND_OFF = 1e-12  # relative, of sums over a whole pour
SCHEME = "formal order of the scheme"
POWER = "departure from a pure power of dx"

Poured = Callable[..., xr.Dataset]  # the archive of (model, preset, *settings)


class Check(NamedTuple):
    """A number, or a word, beside what it should be.

    What is `observed` in an experiment or in somebody else's numerical run is compared, too, but
    the models need not have it right.
    """

    what: str
    source: str  # paper and equation
    expected: float | str
    found: float | str
    bound: float = 0.0  # of |found - expected|
    why: str = "exact"  # what the bound is
    unit: str = "1"
    observed: bool = False

    @property
    def difference(self) -> float:
        """Found - expected; of words 0 where they are the same, else infinite."""
        if isinstance(self.expected, str) or isinstance(self.found, str):
            return 0.0 if self.found == self.expected else math.inf
        return self.found - self.expected

    @property
    def holds(self) -> bool:
        """Whether they are as close as they should be; what could not be found is not."""
        return bool(abs(self.difference) <= self.bound)


Checks = Iterator[Check]
Subject = Callable[[Poured], Checks]
