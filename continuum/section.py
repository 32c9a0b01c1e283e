"""Sections through what lies at rest: its composition, (z, x, species)."""

import math
from collections.abc import Iterable

import numpy as np

from continuum.slopes import Slope, across
from continuum.state import Flow, lowest_bins
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
    fraction = np.full(shape, np.nan)
    for slab in slabs:
        column = np.repeat(np.arange(shape[1]), np.diff(slab.ends))
        row = np.arange(len(slab.pieces)) + (slab.bottom - slab.ends[:-1] - low)[column]
        total = slab.pieces.sum(axis=1)
        there = (row >= 0) & (row < shape[0]) & (total > 0)
        fraction[row[there], column[there]] = slab.pieces[there] / total[there, None]
    return fraction


def rest_of(slopes: list[Slope]) -> Slab:
    """What piles have in memory: sealed bins, the open one, and the surface layer upon it."""
    shares = [share for slope in slopes for share in _columns(slope)[:: slope.direction]]
    bottom = across(slopes, lambda slope: slope.first_bin + slope.flow.buried)
    return slab_of(bottom, shares)


def slab_of(bottom: Ints, shares: list[Floats]) -> Slab:
    """A slab of what each column holds, (bin, species) [cm], from its `bottom` (column,) on."""
    counts = np.array([len(share) for share in shares])
    return Slab(bottom, bottom + counts, np.append(0, np.cumsum(counts)), np.concatenate(shares))


def _columns(slope: Slope) -> list[Floats]:
    """Thickness of each species in the bins of each cell, (bin, species)."""
    flow, layer_bins = slope.flow, _layer_bins(slope)
    columns: list[Floats] = []
    for i in range(len(slope.x)):
        sealed = int(flow.sealed[i])
        column = np.zeros((sealed + 1 + layer_bins, len(flow.rolling)))
        column[:sealed] = lowest_bins(flow, i, sealed)
        column[sealed] = flow.filling[:, i]
        rigid = flow.rigid[i] if flow.top[i] == 0 else 0.0
        _lay_on_top(column[sealed:], flow.surface[:, i], rigid, slope.grid.dz)
        columns.append(column)
    return columns


def _layer_bins(slope: Slope) -> int:
    """Bins that the surface layer may reach into, above the open one."""
    return math.ceil(float(slope.flow.surface.sum(axis=0).max()) / slope.grid.dz) + 1


def _lay_on_top(column: Floats, layer: Floats, rigid: float, dz: float) -> None:
    """Put the surface layer (species,) onto the bins (bin, species), of which the first is open."""
    left = layer.sum()
    mixture = layer / left if left > 0 else layer
    for k, held in enumerate(column.sum(axis=1)):
        room = dz - held - (rigid if k == 0 else 0.0)
        part = min(max(room, 0.0), left)
        column[k] += part * mixture
        left -= part


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
