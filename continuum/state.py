"""What the continuum's step works on: the grid, and the state of one slope of the pile.

A slope runs downhill, cell by cell, from the pouring point (or the upper rim of a drum) to a wall
or an open end. Grains at rest lie in three places: the surface layer of thickness d; the open bin
below it, which is being filled; and a tape of sealed bins of height dz. In a silo each cell has a
tape of its own, with a fixed bottom, of which the lowest bins may be handed on. In a drum, whose
body turns rigidly, a tape runs along the half ring of one radius: both its ends are surface, the
cells at x = r and x = -r.
"""

from typing import NamedTuple

import numpy as np

from continuum.limiters import VAN_LEER
from experiment.arrays import Floats, Ints

__all__ = ["MUSCL", "SCHEMES", "Flow", "Grid", "bare_flow"]

SCHEMES = ("godunov", "muscl")
GODUNOV, MUSCL = range(len(SCHEMES))


class Grid(NamedTuple):
    """Cells of width dx, a step of dt, bins of height dz, and what the slope ends at."""

    dx: float  # cm
    dt: float  # s
    dz: float  # cm
    lip: float = np.nan  # cm; height of the open end that grains fall off; NaN for a wall
    turning_rate: float = 0.0  # 1/s; of a drum
    limiter: int = VAN_LEER  # its place in LIMITERS
    scheme: int = GODUNOV  # its place in SCHEMES


class Flow(NamedTuple):
    """The state of a slope, changed in place by :func:`continuum.kernel.advance`."""

    height: Floats  # (cell,) cm
    rolling: Floats  # (species, cell) cm; after a step: at the cell's downhill edge
    surface: Floats  # (species, cell) cm; what the surface layer holds
    filling: Floats  # (species, cell) cm; what the open bin below it holds
    tape: Floats  # (species, row, bin) cm; the sealed bins, places taken modulo their number
    row: Ints  # (cell,) the cell's tape
    up: Ints  # (cell,) +1 or -1: which way along the tape is upwards
    top: Ints  # (cell,) the place on the tape of the open bin
    sealed: Ints  # (row,) how many bins of the tape are sealed and in memory
    buried: Ints  # (row,) how many more lie below these, handed on as slabs
    held: Floats  # (species, row) cm; what all sealed bins of the tape hold, those handed on too
    rigid: Floats  # (cell,) cm; how much of bin 0 the surface of before pouring takes up
    rigid_fraction: Floats  # (species,) its composition
    outflow: Floats  # (species,) cm; what fell off the open end, as thickness of one cell


def bare_flow(height: Floats, rigid_fraction: Floats, bins: int) -> Flow:
    """A silo's slope before pouring: a rigid surface of `height` (cell,) and its composition."""
    shape = (len(rigid_fraction), len(height))
    return Flow(
        height=height.copy(),
        rolling=np.zeros(shape),
        surface=np.zeros(shape),
        filling=np.zeros(shape),
        tape=np.zeros((*shape, bins)),
        row=np.arange(len(height)),
        up=np.ones(len(height), dtype=np.int64),
        top=np.zeros(len(height), dtype=np.int64),
        sealed=np.zeros(len(height), dtype=np.int64),
        buried=np.zeros(len(height), dtype=np.int64),
        held=np.zeros(shape),
        rigid=np.zeros(len(height)),
        rigid_fraction=rigid_fraction.copy(),
        outflow=np.zeros(len(rigid_fraction)),
    )
