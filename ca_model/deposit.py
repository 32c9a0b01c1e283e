"""The grains at rest, a byte each: stacks of columns, from the log of their capture.

Every so often the log is sorted by columns into a slab: all that was captured meanwhile, column
after column, in each from below. The stack of a column is its share of one slab upon the other.
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ca_model.kernel.bits import ONE
from ca_model.kernel.log import Entries, column_of, rank_of
from ca_model.lattice import Ground
from experiment.arrays import Floats, Ints

__all__ = ["Deposit", "Grains", "Slab", "count", "section", "slab_of"]

Grains = NDArray[np.uint8]
Volume = NDArray[np.int32] | NDArray[np.int64]  # units of height


class Slab(NamedTuple):
    """What was captured in a part of the pour."""

    ends: Ints  # (column + 1,) where each column's share begins and ends
    grains: Grains  # (grain,) species

    def share(self, i: int) -> Grains:
        """The species of what column i captured, from below."""
        return self.grains[self.ends[i] : self.ends[i + 1]]

    def columns(self, first: int, last: int) -> "Slab":
        """The part of it from column `first` up to `last`."""
        ends = self.ends[first : last + 1]
        return Slab(ends - ends[0], self.grains[ends[0] : ends[-1]])


class Deposit:
    """Slabs in memory."""

    def __init__(self) -> None:
        self.slabs: list[Slab] = []

    def lay(self, slab: Slab) -> None:
        """Put a slab on top."""
        self.slabs.append(slab)

    def __iter__(self) -> Iterator[Slab]:
        """The slabs, lowest first."""
        return iter(self.slabs)

    def stack(self, i: int) -> Grains:
        """The species of the grains of column i, lowest first."""
        return np.concatenate([np.zeros(0, np.uint8), *(slab.share(i) for slab in self.slabs)])


@njit(cache=True, nogil=True)
def slab_of(log: Entries, columns: int, species: Ints) -> Slab:
    """Sort a log by columns; the grains of rank r are of `species` (rank,)."""
    ends = np.zeros(columns + 1, dtype=np.int64)
    for entry in log:
        ends[column_of(entry) + ONE] += 1
    for i in range(columns):
        ends[i + 1] += ends[i]
    place = ends.copy()
    grains = np.empty(log.size, dtype=np.uint8)
    for entry in log:
        column = column_of(entry)
        grains[place[column]] = species[rank_of(entry)]
        place[column] += 1
    return Slab(ends, grains)


@njit(cache=True, nogil=True)
def count(log: Entries, ranks: int) -> Ints:
    """How many grains of each rank (rank,) a log holds."""
    counts = np.zeros(ranks, dtype=np.int64)
    for entry in log:
        counts[rank_of(entry)] += 1
    return counts


def section(
    slabs: Iterable[Slab],
    grain_height: Ints,
    ground: Ground,
    shape: tuple[int, int],
    units: int,
    wide: int,
) -> Floats:
    """Composition of what was poured, (z, x, species), on a grid of `shape` (z, x).

    Its cells are `units` high and `wide` columns wide. NaN where nothing was poured. Raises
    IndexError for grains that lie outside.
    """
    counts = np.int32 if units * wide < 2**31 else np.int64
    volume = np.zeros((*shape, len(grain_height)), dtype=counts)
    height = ground.height.copy()
    for slab in slabs:
        _fill(volume, height, slab, grain_height, units, wide)
    fraction = np.full(volume.shape, np.nan, dtype=np.float32)
    total = volume.sum(axis=2, keepdims=True)
    np.divide(volume, total, out=fraction, where=total > 0, dtype=np.float32)
    return fraction


@njit(cache=True, nogil=True, boundscheck=True)
def _fill(
    volume: Volume, height: Ints, slab: Slab, grain_height: Ints, units: int, wide: int
) -> None:
    """Add a slab's grains to the cells they lie in, on columns of `height`, unit by unit."""
    for i in range(height.size):
        x = i // wide
        for k in range(slab.ends[i], slab.ends[i + 1]):
            a = slab.grains[k]
            for z in range(height[i], height[i] + grain_height[a]):
                volume[z // units, x, a] += 1
            height[i] += grain_height[a]
