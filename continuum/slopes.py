"""The slopes that a cell is made of, before pouring, and how they lie in the archive.

A silo is one slope. A heap is two that share nothing but the pouring point, each with its own feed.
A drum is one, from rim to rim, with the body below it and its axis at x = 0.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum.kernel import Advance, cells_of, find_composition, take_steps
from continuum.state import Flow, Grid, bare_flow
from experiment import Experiment
from experiment.arrays import Floats, Ints
from experiment.law import Law

__all__ = ["FIRST_BINS", "Slope", "across", "lent_to_the_flow", "slopes_of"]


FIRST_BINS = 64
SPARE_BINS = 1.5  # of a drum's half ring, for its surface to swing


@dataclass
class Slope:
    """One slope of the pile and its state; x and base run downhill."""

    x: Floats  # (cell,) cm; as in the archive
    base: Floats  # (cell,) cm; height before pouring
    grid: Grid
    flow: Flow
    law: Law

    def __post_init__(self) -> None:
        self._rows = cells_of(self.flow)

    def advance(self, velocity: Floats, inflow: Floats) -> Advance:
        """Take a step per row of `inflow` (step, species) [cm], as far as the tapes last."""
        return Advance(*take_steps(self.flow, self._rows, self.law, self.grid, velocity, inflow))

    @property
    def direction(self) -> int:
        """Whether x grows downhill, 1, or uphill, -1."""
        return 1 if self.x[-1] > self.x[0] else -1

    @property
    def cells(self) -> Ints:
        """Its cells (cell,) in the order of the archive."""
        return np.ascontiguousarray(np.arange(len(self.x))[:: self.direction])

    @property
    def first_bin(self) -> Ints:
        """The bin of height (cell,) above the floor in which what is poured begins."""
        return np.asarray(np.floor(self.base / self.grid.dz).astype(np.int64))

    @property
    def composition(self) -> Floats:
        """phi_a (species, cell) of the surface."""
        flow = self.flow
        return find_composition(flow.surface, flow.rigid_fraction, self.law.surface_depth)

    @property
    def volume_at_rest(self) -> Floats:
        """Volume (species,) [cm2] of what was poured and lies still."""
        flow = self.flow
        lying = (flow.surface + flow.filling).sum(axis=1) + flow.held.sum(axis=1)
        return np.asarray(lying * self.grid.dx)


def across(slopes: list[Slope], values: Callable[[Slope], NDArray[Any]]) -> NDArray[Any]:
    """`values` (..., cell) of all slopes in the order of the archive, x growing."""
    parts = [values(slope)[..., :: slope.direction] for slope in slopes]
    return np.concatenate(parts, axis=-1)


def slopes_of(experiment: Experiment, grid: Grid, cells: int, law: Law) -> list[Slope]:
    """The slopes of the experiment's cell before pouring, in the order of the archive."""
    cell = experiment.cell
    downhill = (np.arange(cells) + 0.5) * grid.dx
    if cell.shape == "drum":
        x = downhill - 0.5 * cell.length
        grid = grid._replace(turning_rate=cell.turning_rate or 0.0)
        base = cell.base_height(x) + lent_to_the_flow(experiment, law)
        return [Slope(x, base, grid, _half_full(experiment, base, x, grid, law), law)]
    sides = (-downhill, downhill) if cell.shape == "heap" else (downhill,)
    lips = cell.base_at_end if cell.end == "open" else np.full(len(sides), np.nan)
    return [
        _bare_slope(experiment, x, grid._replace(lip=float(lip)), law)
        for x, lip in zip(sides, lips, strict=True)
    ]


def _bare_slope(experiment: Experiment, x: Floats, grid: Grid, law: Law) -> Slope:
    """A slope on which nothing rolls and nothing was poured."""
    base = experiment.cell.base_height(x)
    flow = bare_flow(base, np.array(experiment.start_composition), FIRST_BINS)
    flow = flow._replace(rigid=base - grid.dz * np.floor(base / grid.dz))
    return Slope(x, base, grid, flow, law)


def lent_to_the_flow(experiment: Experiment, law: Law) -> float:
    """How far [cm] a drum is filled above its axis, so that its surface passes there as it turns.

    What rolls then, w a^2 / 3 v on average, and the mean height (2 - ln 4) v / gamma of de Gennes'
    surface over its middle, of the species for which they are largest.
    """
    velocity = np.array(experiment.mixture.drift_velocity)
    swept = (experiment.cell.turning_rate or 0.0) * (experiment.cell.length / 2) ** 2
    lift = (2.0 - math.log(4.0)) * velocity / np.diag(np.array(law.collision_rate))
    return float((swept / (3.0 * velocity) + lift).max())


def _half_full(experiment: Experiment, base: Floats, x: Floats, grid: Grid, law: Law) -> Flow:
    """A drum whose lower half is full of a mixture at rest: a tape along each half ring.

    The downhill end of a tape grows towards larger places, the uphill end towards smaller ones.
    """
    composition = np.array(experiment.start_composition)[:, None]
    cells, radius = len(x), np.abs(x)
    row = np.minimum(np.arange(cells), np.arange(cells)[::-1])
    half_ring = np.pi * radius + (base + base[::-1] - experiment.cell.length)
    layer = np.minimum(law.surface_depth, half_ring / 2)
    inside = half_ring[: cells // 2] - 2 * layer[: cells // 2]
    sealed = np.floor(inside / grid.dz).astype(np.int64)
    bins = math.ceil(SPARE_BINS * half_ring.max() / grid.dz) + FIRST_BINS
    tape = np.zeros((len(composition), cells // 2, bins))
    for r, count in enumerate(sealed):
        tape[:, r, :count] = composition * grid.dz
    up = np.where(x > 0, 1, -1)
    filling = np.where(x > 0, (inside - sealed * grid.dz)[row], 0.0)
    return Flow(
        height=base.copy(),
        rolling=np.zeros((len(composition), cells)),
        surface=composition * layer,
        filling=composition * filling,
        tape=tape,
        row=row,
        up=up,
        top=np.where(up > 0, sealed[row], -1),
        sealed=sealed,
        buried=np.zeros_like(sealed),
        held=tape.sum(axis=2),
        rigid=np.zeros(cells),
        rigid_fraction=composition[:, 0].copy(),
        outflow=np.zeros(len(composition)),
    )
