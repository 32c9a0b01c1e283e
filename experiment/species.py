"""Values of each species in one cell: tuples, of a length that the compiler knows.

So loops over species are unrolled, values stay in registers, and the loop over cells around them
runs in vector lanes.
"""

from typing import Protocol, TypeVar, cast

from numba import njit
from numba.cpython.unsafe.tuple import tuple_setitem

from experiment.arrays import Floats

__all__ = ["Rows", "Values", "at", "put", "total"]

Values = tuple[float, ...]  # one a species
Rows = tuple[Floats, ...]  # (cell,) one a species

Number = TypeVar("Number", float, int)


class Put(Protocol):
    """How a value is replaced."""

    def __call__(self, values: tuple[Number, ...], a: int, value: Number) -> tuple[Number, ...]:
        """A copy of `values` with that of species a replaced."""


put = cast(Put, tuple_setitem)


@njit(cache=True, inline="always")
def at(rows: Rows, i: int, like: Values) -> Values:
    """The values in cell i; `like` is any tuple of that many."""
    values = like
    for a in range(len(rows)):
        values = put(values, a, rows[a][i])
    return values


@njit(cache=True, inline="always")
def total(values: Values) -> float:
    """Sum over species."""
    summed = values[0]
    for a in range(1, len(values)):
        summed += values[a]
    return summed
