"""What lies under the open bin: sealing bins, and digging up what was buried, last first.

The surface layer's excess goes into the cell's open bin, which refills it where it lacks grains
(kernel.py). Where the open bin runs empty the sealed bins of the tape are reopened, topmost first,
before anything else happens; below the tape's last bin nothing can be dug up. At the end of a step
open bins that hold more than dz are sealed. Both are rare and go cell by cell. What every step asks
for is inlined, for to hand over the hundred numbers of a Flow takes longer than to look at 200
cells.
"""

import math

from numba import njit

from continuum.state import Flow
from experiment.arrays import Floats

__all__ = ["dig_up", "is_nearly_bare", "is_nearly_full", "reopen", "seal_full_bins", "some_lack"]


@njit(cache=True)
def some_lack(beyond: Floats) -> bool:
    """Whether any `beyond` (cell,) [cm] is negative."""
    lacking = 0
    for i in range(beyond.size):
        lacking += beyond[i] < 0.0
    return lacking > 0


@njit(cache=True, error_model="numpy")
def dig_up(flow: Flow, beyond: Floats) -> None:
    """Reopen sealed bins where the surface layer lacks grains, `beyond` (cell,) [cm] < 0."""
    for i in range(beyond.size):
        if beyond[i] < 0.0:
            reopen(flow, i, -beyond[i])


@njit(cache=True, error_model="numpy", forceinline=True)
def seal_full_bins(flow: Flow, beyond: Floats, dz: float) -> None:
    """Seal open bins that hold more than their capacity, `beyond` (cell,) [cm] > 0."""
    for i in range(beyond.size):
        if beyond[i] > 0.0:
            _seal(flow, i, dz)


@njit(cache=True, error_model="numpy", forceinline=True)
def _seal(flow: Flow, i: int, dz: float) -> None:
    """Close the bins of cell i that are full, and go on filling the one above them."""
    row, bins = flow.row[i], flow.tape.shape[2]
    species = flow.filling.shape[0]
    filled = 0.0
    for a in range(species):
        filled += flow.filling[a, i]
    while True:
        capacity = dz - flow.rigid[i] if flow.top[i] == 0 else dz
        if filled <= capacity:
            return
        for a in range(species):
            sealed = capacity / filled * flow.filling[a, i]
            flow.filling[a, i] -= sealed
            flow.tape[a, row, flow.top[i] % bins] = sealed
            flow.held[a, row] += sealed
        flow.top[i] += flow.up[i]
        flow.sealed[row] += 1
        filled -= capacity


@njit(cache=True, error_model="numpy", forceinline=True)
def reopen(flow: Flow, i: int, wanted: float) -> None:
    """Refill the surface layer of cell i by `wanted` from the sealed bins, as far as they go."""
    row, bins = flow.row[i], flow.tape.shape[2]
    species = flow.filling.shape[0]
    while wanted > 0.0 and flow.sealed[row] > 0:
        flow.top[i] -= flow.up[i]
        flow.sealed[row] -= 1
        place = flow.top[i] % bins
        filled = 0.0
        for a in range(species):
            filled += flow.tape[a, row, place]
        dug = wanted / max(wanted, filled)
        for a in range(species):
            opened = flow.tape[a, row, place]
            flow.surface[a, i] += dug * opened
            flow.filling[a, i] += opened - dug * opened
            flow.tape[a, row, place] = 0.0
            flow.held[a, row] -= opened
        wanted -= filled


@njit(cache=True, error_model="numpy")
def is_nearly_full(flow: Flow, thickest: float, dz: float) -> bool:
    """Whether some tape could run out of places within a step.

    No end of a tape gains more than the `thickest` flow [cm], for transport makes no new extremum,
    and a drum's tape has two ends.
    """
    most = 0
    for row in range(flow.sealed.size):
        most = max(most, flow.sealed[row])
    return bool(most + 4 + 2 * thickest / dz >= flow.tape.shape[2])


@njit(cache=True, error_model="numpy")
def is_nearly_bare(flow: Flow, deepest: float, dz: float) -> bool:
    """Whether what was handed on could be dug up by `deepest` [cm], the most that a step digs."""
    bins = math.ceil(min(deepest / dz, 1e15)) + 1
    bare = 0
    for row in range(flow.sealed.size):
        bare += (flow.buried[row] > 0) & (flow.sealed[row] < bins)
    return bare > 0
