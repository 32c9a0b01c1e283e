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

__all__ = [
    "MUSCL",
    "SCHEMES",
    "Flow",
    "Grid",
    "bare_flow",
    "lowest_bins",
    "places_of",
    "sealed_bins",
    "with_more_bins",
    "with_sealed_bins",
]

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


def with_more_bins(flow: Flow) -> Flow:
    """The same state with tapes of twice as many bins."""
    return with_sealed_bins(flow, 2 * flow.tape.shape[2], sealed_bins(flow))


def sealed_bins(flow: Flow) -> Floats:
    """What the sealed bins in memory hold, tape after tape in each from below, (bin, species)."""
    cells = np.flatnonzero(flow.up > 0).tolist()
    return np.concatenate([lowest_bins(flow, i, flow.sealed[flow.row[i]]) for i in cells])


def lowest_bins(flow: Flow, i: int, count: int) -> Floats:
    """What the lowest `count` of the sealed bins hold that end in cell i, (bin, species) [cm].

    Of a drum's half ring, the cell at its downhill end.
    """
    return np.asarray(flow.tape[:, flow.row[i], places_of(flow, i, count, flow.tape.shape[2])].T)


def with_sealed_bins(flow: Flow, bins: int, content: Floats) -> Flow:
    """The same state on tapes of so many `bins`, whose sealed ones hold `content`.

    That is as :func:`sealed_bins` tells. Raises ValueError where it is of another number of bins.
    """
    tape = np.zeros((*flow.tape.shape[:2], bins))
    for i in np.flatnonzero(flow.up > 0).tolist():
        share, content = np.split(content, [flow.sealed[flow.row[i]]])
        tape[:, flow.row[i], places_of(flow, i, len(share), bins)] = share.T
    if len(content):
        raise ValueError(f"it holds {len(content)} bins too many")
    return flow._replace(tape=tape)


def places_of(flow: Flow, i: int, count: int, bins: int) -> Ints:
    """Where the bins of :func:`lowest_bins` are on a tape of so many `bins`."""
    lowest = flow.top[i] - flow.sealed[flow.row[i]]
    return np.asarray((lowest + np.arange(count)) % bins)
