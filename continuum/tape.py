"""Tapes of sealed bins, from below: what they hold is read, replaced, or laid on longer ones.

The open bin of a cell has the place `top`; the n bins sealed below it have those from top - n on.
Places are taken modulo the number of bins. Of a drum's half ring the lower end is taken to be the
one uphill of the axis, and its cell the one downhill.
"""

import numpy as np
from numba import njit

from continuum.state import Flow
from experiment.arrays import Floats, Ints

__all__ = ["lowest_bins", "put_lowest_bins", "sealed_bins", "with_more_bins", "with_sealed_bins"]


@njit(cache=True, nogil=True)
def lowest_bins(flow: Flow, cells: Ints, counts: Ints) -> Floats:
    """What the lowest `counts` of the sealed bins below `cells` hold, (bin, species) [cm].

    Cell after cell, in each from below.
    """
    species, _, bins = flow.tape.shape
    content = np.empty((counts.sum(), species))
    k = 0
    for i, count in zip(cells, counts):  # noqa: B905  numba knows no strict
        row = flow.row[i]
        place = (flow.top[i] - flow.sealed[row]) % bins
        for _ in range(count):
            for a in range(species):
                content[k, a] = flow.tape[a, row, place]
            k, place = k + 1, place + 1 if place + 1 < bins else 0
    return content


@njit(cache=True, nogil=True)
def put_lowest_bins(flow: Flow, cells: Ints, counts: Ints, content: Floats) -> None:
    """Replace what :func:`lowest_bins` tells."""
    species, _, bins = flow.tape.shape
    k = 0
    for i, count in zip(cells, counts):  # noqa: B905
        row = flow.row[i]
        place = (flow.top[i] - flow.sealed[row]) % bins
        for _ in range(count):
            for a in range(species):
                flow.tape[a, row, place] = content[k, a]
            k, place = k + 1, place + 1 if place + 1 < bins else 0


def sealed_bins(flow: Flow) -> Floats:
    """What the sealed bins in memory hold, tape after tape, in each from below, (bin, species)."""
    return lowest_bins(flow, *_whole_tapes(flow))


def with_sealed_bins(flow: Flow, bins: int, content: Floats) -> Flow:
    """The same state on tapes of so many `bins`, whose sealed ones hold `content`.

    That is as :func:`sealed_bins` tells. Raises ValueError where it is of another number of bins.
    """
    cells, counts = _whole_tapes(flow)
    species, rows, _ = flow.tape.shape
    if content.shape != (counts.sum(), species):
        raise ValueError(f"its sealed bins are {content.shape}, not {(counts.sum(), species)}")
    longer = flow._replace(tape=np.zeros((species, rows, bins)))
    put_lowest_bins(longer, cells, counts, content)
    return longer


def with_more_bins(flow: Flow) -> Flow:
    """The same state with tapes of twice as many bins."""
    return with_sealed_bins(flow, 2 * flow.tape.shape[2], sealed_bins(flow))


def _whole_tapes(flow: Flow) -> tuple[Ints, Ints]:
    """The cell at the upper end of each tape, and how many of its bins are sealed."""
    cells = np.flatnonzero(flow.up > 0)
    return cells, flow.sealed[flow.row[cells]]
