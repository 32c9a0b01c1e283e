"""Sections through what lies at rest: its composition, (z, x, species)."""

import math
from collections.abc import Iterable

import numpy as np
from numba import njit

from continuum.slopes import Slope, across
from continuum.state import Flow
from continuum.tape import lowest_bins
from experiment.arrays import Floats, Ints
from experiment.pouring.slabs import Slab

__all__ = [
    "heights_in_drum",
    "heights_in_pile",
    "rest_of",
    "section_of_drum",
    "section_of_pile",
    "slab_of",
]


def heights_in_pile(slopes: list[Slope]) -> Floats:
    """Z (z,) [cm] above the floor of the bins that hold what was poured."""
    highest = max(_highest_bin(slope) for slope in slopes)
    return (np.arange(highest + 1) + 0.5) * slopes[0].grid.dz


def _highest_bin(slope: Slope) -> int:
    return int((slope.first_bin + slope.flow.top).max()) + _layer_bins(slope)


def section_of_pile(slabs: Iterable[Slab], shape: tuple[int, int, int], low: int) -> Floats:
    """Composition of slabs on a grid of `shape` (z, x, species), from bin `low` up.

    NaN where nothing was poured.
    """
    fraction = np.full(shape, np.nan, dtype=np.float32)
    for slab in slabs:
        _fill(fraction, slab, slab.pieces.sum(axis=1), low)
    return fraction


@njit(cache=True, nogil=True, boundscheck=True)
def _fill(fraction: Floats, slab: Slab, thickness: Floats, low: int) -> None:
    """Put the pieces of a slab, of that `thickness` (piece,) [cm], into the rows from `low` up."""
    for i in range(slab.bottom.size):
        above = slab.bottom[i] - slab.ends[i] - low
        for k in range(slab.ends[i], slab.ends[i + 1]):
            if 0 <= above + k < fraction.shape[0] and thickness[k] > 0.0:
                for a in range(fraction.shape[2]):
                    fraction[above + k, i, a] = slab.pieces[k, a] / thickness[k]


def rest_of(slopes: list[Slope]) -> list[Slab]:
    """What piles have in memory: sealed bins; the open one, and the surface layer upon it."""
    first = across(slopes, lambda slope: slope.first_bin + slope.flow.buried)
    sealed = across(slopes, lambda slope: slope.flow.sealed)
    lower = slab_of(first, sealed, np.concatenate([_sealed_bins(slope) for slope in slopes]))
    bins = 1 + max(_layer_bins(slope) for slope in slopes)
    tops = np.concatenate([_open_bins(slope, bins)[:: slope.direction] for slope in slopes])
    return [lower, slab_of(lower.top, np.full(len(tops), bins), tops.reshape(-1, tops.shape[2]))]


def _sealed_bins(slope: Slope) -> Floats:
    """What those in memory hold, column after column, (bin, species) [cm]."""
    return lowest_bins(slope.flow, slope.cells, slope.flow.sealed[slope.cells])


def slab_of(bottom: Ints, counts: Ints, pieces: Floats) -> Slab:
    """A slab of columns, each of so many of the `pieces` (bin, species) [cm], from `bottom` on."""
    return Slab(bottom, bottom + counts, np.append(0, np.cumsum(counts)), pieces)


def _layer_bins(slope: Slope) -> int:
    """Bins that the surface layer may reach into, above the open one."""
    return math.ceil(float(slope.flow.surface.sum(axis=0).max()) / slope.grid.dz) + 1


def _open_bins(slope: Slope, bins: int) -> Floats:
    """What the open bins and those above hold once the surface layer is laid into them.

    Of so many `bins` a cell, (cell, bin, species) [cm].
    """
    flow, layer = slope.flow, slope.flow.surface.T.copy()
    column = np.zeros((len(layer), bins, layer.shape[1]))
    column[:, 0] = flow.filling.T
    rigid = np.where(flow.top == 0, flow.rigid, 0.0)
    left = layer.sum(axis=1)
    mixture = layer / np.where(left > 0.0, left, 1.0)[:, None]
    for k in range(bins):
        room = slope.grid.dz - column[:, k].sum(axis=1) - (rigid if k == 0 else 0.0)
        part = np.minimum(np.maximum(room, 0.0), left)
        column[:, k] += part[:, None] * mixture
        left -= part
    return column


def heights_in_drum(slope: Slope) -> Floats:
    """Z (z,) [cm] above the lowest point of a drum."""
    return (np.arange(len(slope.x)) + 0.5) * slope.grid.dx


def section_of_drum(slope: Slope, radius: float) -> Floats:
    """Composition (z, x, species) of what fills a drum of that `radius` [cm].

    A point at distance r from the axis, at an angle below the level of the axis downhill, lies at
    the arc length r * angle along the tape of its half ring.
    """
    dx, flow = slope.grid.dx, slope.flow
    x, y = np.meshgrid(slope.x, heights_in_drum(slope) - radius)
    ring = (np.hypot(x, y) / dx).astype(np.int64)
    angle = np.mod(np.arctan2(-y, x) + np.pi / 2, 2 * np.pi) - np.pi / 2
    half = len(slope.x) // 2
    fraction = np.full((len(flow.rolling), *x.shape), np.nan)
    for k in range(half):
        here = ring == k
        arc = flow.height[half + k] - radius + angle[here] * (k + 0.5) * dx
        fraction[:, here] = _on_tape(_whole_tape(flow, half + k), arc)
    return fraction.transpose(1, 2, 0)


def _whole_tape(flow: Flow, i: int) -> Floats:
    """All that lies on the half ring that ends in cell i, (species, piece), from that end on."""
    mirror, bins = flow.height.size - 1 - i, flow.tape.shape[2]
    row = flow.row[i]
    places = np.arange(flow.top[i] - 1, flow.top[mirror], -1) % bins
    ends = [part[:, [k]] for k in (i, mirror) for part in (flow.surface, flow.filling)]
    return np.concatenate([ends[0], ends[1], flow.tape[:, row, places], ends[3], ends[2]], axis=1)


def _on_tape(pieces: Floats, arc: Floats) -> Floats:
    """Composition (species, point) at arc lengths (point,) [cm]; NaN beyond either end."""
    thickness = pieces.sum(axis=0)
    pieces, thickness = pieces[:, thickness > 0], thickness[thickness > 0]
    if not len(thickness):
        return np.full((len(pieces), len(arc)), np.nan)
    ends = np.cumsum(thickness)
    at = np.minimum(np.searchsorted(ends, arc, side="right"), len(ends) - 1)
    inside = (arc >= 0.0) & (arc < ends[-1])
    return np.where(inside, (pieces / thickness)[:, at], np.nan)
