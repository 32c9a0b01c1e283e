"""What lies under the surface layer: burying, and digging up what was buried, last first.

What the surface layer holds beyond its depth d goes, as it is mixed, into the open bin; where it
holds less, the open bin refills it, and then the sealed bins of the tape, topmost first. Bins are
sealed when they hold dz. Nothing below the tape's last bin can be dug up: it is rigid, or rolls
away at a drum's other end.

Arrays are (species, cell); loops along the cells run in vector lanes, sealing and reopening of bins
are rare and go cell by cell.
"""

import numpy as np
from numba import njit

from continuum.state import Flow, Grid
from experiment.arrays import Floats

__all__ = ["bury_or_dig_up", "is_nearly_full"]

TINY = 1e-300  # cm; keeps 0 / 0 away where a bin is empty


@njit(cache=True, error_model="numpy")
def bury_or_dig_up(flow: Flow, depth: float, grid: Grid) -> None:
    """Bring each cell's surface layer back to its `depth` [cm], as far as the deposit can."""
    species, cells = flow.surface.shape
    held, filled = total(flow.surface), total(flow.filling)
    buried, dug = np.empty(cells), np.empty(cells)
    for i in range(cells):
        wanted = max(depth - held[i], 0.0)
        buried[i] = max(held[i] - depth, 0.0) / max(held[i], depth)
        dug[i] = wanted / max(wanted, filled[i], TINY)
    for a in range(species):
        for i in range(cells):
            moved = buried[i] * flow.surface[a, i] - dug[i] * flow.filling[a, i]
            flow.surface[a, i] -= moved
            flow.filling[a, i] += moved
    for i in range(cells):
        if held[i] + filled[i] < depth:
            _reopen(flow, i, depth - held[i] - filled[i])
        elif held[i] + filled[i] > depth + _capacity(flow, i, grid.dz):
            _seal(flow, i, grid.dz)


@njit(cache=True, error_model="numpy")
def total(thickness: Floats) -> Floats:
    """Sum over species (cell,) of thicknesses (species, cell)."""
    summed: Floats = thickness[0].copy()
    for a in range(1, thickness.shape[0]):
        for i in range(summed.size):
            summed[i] += thickness[a, i]
    return summed


@njit(cache=True, inline="always")
def _capacity(flow: Flow, i: int, dz: float) -> float:
    """What the open bin of cell i can hold; the lowest one is partly rigid."""
    return dz - flow.rigid[i] if flow.top[i] == 0 else dz


@njit(cache=True, error_model="numpy")
def _seal(flow: Flow, i: int, dz: float) -> None:
    """Close the bins of cell i that are full, and go on filling the one above them."""
    row, bins = flow.row[i], flow.tape.shape[2]
    filled = flow.filling[:, i].sum()
    while filled > _capacity(flow, i, dz):
        capacity = _capacity(flow, i, dz)
        for a in range(flow.filling.shape[0]):
            sealed = capacity / filled * flow.filling[a, i]
            flow.filling[a, i] -= sealed
            flow.tape[a, row, flow.top[i] % bins] = sealed
        flow.top[i] += flow.up[i]
        flow.sealed[row] += 1
        filled -= capacity


@njit(cache=True, error_model="numpy")
def _reopen(flow: Flow, i: int, wanted: float) -> None:
    """Refill the surface layer of cell i by `wanted` from the sealed bins, as far as they go."""
    row, bins = flow.row[i], flow.tape.shape[2]
    while wanted > 0.0 and flow.sealed[row] > 0:
        flow.top[i] -= flow.up[i]
        flow.sealed[row] -= 1
        opened = flow.tape[:, row, flow.top[i] % bins]
        filled = opened.sum()
        dug = wanted / max(wanted, filled)
        for a in range(opened.size):
            moved = dug * opened[a]
            flow.surface[a, i] += moved
            flow.filling[a, i] += opened[a] - moved
            opened[a] = 0.0
        wanted -= filled


@njit(cache=True, error_model="numpy")
def is_nearly_full(flow: Flow, grid: Grid, inflow: Floats) -> bool:
    """Whether some tape could run out of bins within a step: all that can reach it, captured."""
    species, cells = flow.rolling.shape
    bins = flow.tape.shape[2]
    for i in range(cells):
        arriving = 0.0
        for a in range(species):
            uphill = flow.rolling[a, i - 1] if i > 0 else inflow[a]
            arriving += flow.rolling[a, i] + uphill
        if flow.sealed[flow.row[i]] + 4 + 2 * arriving / grid.dz >= bins:
            return True
    return False
