"""The log that kernels put captured grains down in: each an integer, its column and its rank."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ca_model.kernel.bits import Whole, Word
from ca_model.kernel.compiled import inlined
from experiment.arrays import Ints

__all__ = ["MOST_RANKS", "Entries", "Log", "column_of", "entry_of", "rank_of", "steps_that_fit"]

MOST_RANKS = 64
RANK_BITS, RANK = Word(6), Word(MOST_RANKS - 1)

Entries = NDArray[np.int32]


class Log(NamedTuple):
    """Captured grains, those of a column in the order in which it captured them."""

    grains: Entries  # (grain,), used as far as
    length: NDArray[np.uint64]  # (1,) tells


@njit(cache=True, nogil=True)
def steps_that_fit(arrivals: Ints, room: int) -> int:
    """Steps of `arrivals` (step, side, rank) of which the log has `room` for all grains."""
    for step in range(len(arrivals)):
        room -= arrivals[step].sum()
        if room < 0:
            return step
    return len(arrivals)


@inlined
def entry_of(column: Whole, rank: Whole) -> Whole:
    """How the log tells of a grain."""
    return (column << RANK_BITS) | rank


@inlined
def column_of(entry: Whole) -> Whole:
    """Where the grain of an entry came to rest."""
    return Word(entry) >> RANK_BITS


@inlined
def rank_of(entry: Whole) -> Whole:
    """Of what rank it is."""
    return Word(entry) & RANK
