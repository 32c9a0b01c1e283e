"""The grains at rest, a byte each: stacks of columns, from the log of their capture.

Every so often the log is sorted by columns into a slab: the species of all that was captured
meanwhile. The stack of a column is its share of one slab upon the other.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ca_model.kernel.bits import ONE
from ca_model.kernel.log import Entries, column_of, rank_of
from experiment.arrays import Floats, Ints
from experiment.pouring.slabs import Slab

__all__ = ["Grains", "Raster", "count", "pure", "section", "slab_of", "top_of"]

Grains = NDArray[np.uint8]
Volume = NDArray[np.uint8] | NDArray[np.int64]  # units of height


class Raster(NamedTuple):
    """A grid that a deposit is averaged over, or some rows of it."""

    rows: int
    columns: int
    low: int = 0  # of the lowest row
    units: int = 1  # that a row is high
    wide: int = 1  # columns of the pile that one of the grid is wide


@njit(cache=True, nogil=True)
def slab_of(log: Entries, bottom: Ints, top: Ints, species: Ints) -> Slab:
    """Sort a log by columns; the grains of rank r are of `species` (rank,)."""
    columns = bottom.size
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
    return Slab(bottom, top, ends, grains)


@njit(cache=True, nogil=True)
def count(log: Entries, ranks: int) -> Ints:
    """How many grains of each rank (rank,) a log holds."""
    counts = np.zeros(ranks, dtype=np.int64)
    for entry in log:
        counts[rank_of(entry)] += 1
    return counts


@njit(cache=True, nogil=True, boundscheck=True)
def top_of(bottom: Ints, ends: Ints, grains: Grains, grain_height: Ints) -> Ints:
    """Where each column's share of some grains ends, (column,) in u; see :class:`Slab`."""
    top = bottom.copy()
    for i in range(top.size):
        for k in range(ends[i], ends[i + 1]):
            top[i] += grain_height[grains[k]]
    return top


def pure(surface: Ints, species: int) -> Floats:
    """The composition (column, species) of surfaces that are of one species (column,) each."""
    fraction: Floats = np.eye(species).take(surface, axis=0)
    return fraction


def section(slabs: Iterable[Slab], grain_height: Ints, raster: Raster) -> Floats:
    """Composition of what was poured, (z, x, species), on a raster; NaN where nothing was.

    Raises IndexError for grains that lie beyond its columns, or are of no species.
    """
    counts = np.uint8 if raster.units * raster.wide < 2**8 else np.int64
    volume = np.zeros((raster.rows, raster.columns, len(grain_height)), dtype=counts)
    for slab in slabs:
        _fill(volume, slab, grain_height, raster)
    return _fraction(volume)


@njit(cache=True, nogil=True, boundscheck=True)
def _fill(volume: Volume, slab: Slab, grain_height: Ints, raster: Raster) -> None:
    """Add a slab's grains to the rows that they lie in, unit by unit."""
    first = raster.low * raster.units
    last = first + raster.rows * raster.units
    for i in range(slab.bottom.size):
        height, x = slab.bottom[i], i // raster.wide
        for k in range(slab.ends[i], slab.ends[i + 1]):
            a = slab.pieces[k]
            top = height + grain_height[a]
            for z in range(max(height, first), min(top, last)):
                volume[z // raster.units - raster.low, x, a] += 1
            height = top


@njit(cache=True, nogil=True, error_model="numpy")
def _fraction(volume: Volume) -> Floats:
    """Each species' share of a `volume` (z, x, species); NaN where there is none."""
    fraction = np.full(volume.shape, np.nan, dtype=np.float32)
    rows, columns, species = volume.shape
    for row in range(rows):
        for x in range(columns):
            total = volume[row, x].sum()
            if total > 0:
                for a in range(species):
                    fraction[row, x, a] = np.float32(volume[row, x, a]) / np.float32(total)
    return fraction
