"""Sections through what lies at rest at the end of a pour: its composition, (z, x, species)."""

import math

import numpy as np

from continuum.slopes import Slope, across
from continuum.state import Flow
from experiment.arrays import Floats, Ints

__all__ = ["section_of_drum", "section_of_pile"]


def section_of_pile(slopes: list[Slope]) -> tuple[Floats, Floats]:
    """Z (z,) [cm] above the floor, and the composition of what was poured on bins of height dz."""
    dz = slopes[0].grid.dz
    bins = max(_highest_bin(slope) for slope in slopes)
    volume = across(slopes, lambda slope: _volume(slope, bins))
    return (np.arange(bins) + 0.5) * dz, _fractions(volume).transpose(1, 2, 0)


def section_of_drum(slope: Slope, radius: float) -> tuple[Floats, Floats]:
    """Z (z,) [cm] above the lowest point of a drum of that `radius` [cm], and what fills it.

    A point at distance r from the axis, at an angle below the level of the axis downhill, lies at
    the arc length r * angle along the tape of its half ring.
    """
    dx, flow = slope.grid.dx, slope.flow
    z = (np.arange(len(slope.x)) + 0.5) * dx
    x, y = np.meshgrid(slope.x, z - radius)
    ring = (np.hypot(x, y) / dx).astype(np.int64)
    angle = np.mod(np.arctan2(-y, x) + np.pi / 2, 2 * np.pi) - np.pi / 2
    half = len(slope.x) // 2
    fraction = np.full((len(flow.rolling), *x.shape), np.nan)
    for k in range(half):
        here = ring == k
        arc = flow.height[half + k] - radius + angle[here] * (k + 0.5) * dx
        fraction[:, here] = _on_tape(_whole_tape(flow, half + k), arc)
    return z, fraction.transpose(1, 2, 0)


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


def _first_bins(slope: Slope) -> Ints:
    return np.asarray(np.floor(slope.base / slope.grid.dz).astype(np.int64))


def _layer_bins(slope: Slope) -> int:
    """Bins that the surface layer may reach into, above the open one."""
    return math.ceil(float(slope.flow.surface.sum(axis=0).max()) / slope.grid.dz) + 1


def _highest_bin(slope: Slope) -> int:
    return int((_first_bins(slope) + slope.flow.top).max()) + 1 + _layer_bins(slope)


def _volume(slope: Slope, bins: int) -> Floats:
    """Thickness of each species in each bin above the floor, (species, bin, cell)."""
    flow, dz = slope.flow, slope.grid.dz
    first, layer_bins = _first_bins(slope), _layer_bins(slope)
    volume = np.zeros((len(flow.rolling), bins, len(slope.x)))
    for i in range(len(slope.x)):
        used = int(flow.top[i]) + 1
        column = np.zeros((len(volume), used + layer_bins))
        column[:, : used - 1] = flow.tape[:, i, : used - 1]
        column[:, used - 1] = flow.filling[:, i]
        _lay_on_top(column, flow.surface[:, i], used - 1, flow.rigid[i], dz)
        volume[:, first[i] : first[i] + used + layer_bins, i] = column
    return volume


def _lay_on_top(column: Floats, layer: Floats, top: int, rigid: float, dz: float) -> None:
    """Put the surface layer (species,) onto a column (species, bin), from bin `top` up."""
    left = layer.sum()
    mixture = layer / left if left > 0 else layer
    while left > 0 and top < column.shape[1]:
        room = dz - column[:, top].sum() - (rigid if top == 0 else 0.0)
        part = min(max(room, 0.0), left)
        column[:, top] += part * mixture
        left -= part
        top += 1


def _fractions(volume: Floats) -> Floats:
    """Shares of the species in each bin; NaN where it is empty."""
    total = volume.sum(axis=0)
    fraction = np.full_like(volume, np.nan)
    np.divide(volume, total, out=fraction, where=total > 0)
    return fraction
