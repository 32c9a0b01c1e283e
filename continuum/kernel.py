"""One step of the surface flow on a grid of cells, as a list of physical actions.

    dR_a/dt = - v_a dR_a/dx + Gamma_a        dh/dt = - sum_a Gamma_a
    s = theta - l d2h/dx2                    theta = - dh/dx

Split in time (Godunov, first order). Advection: dt = dx / max v, so that species as fast as the
fastest shift by exactly one cell; slower ones move by van Leer's limited, conservative scheme.
Exchange: sub-steps dt' with v_c dt' / dx <= COURANT, v_c = gamma R (1 + 2 l / dx) the speed at
which a disturbance of the slope climbs; in each one all cells first find their slope from the
heights of one instant, and only then exchange grains. (A cell that finished its exchange against a
neighbour already a step ahead would err by (dh/dt) / v in the slope at every resolution.) The slope
belongs to the cell's downhill edge, theta_i = (h_i - h_{i+1}) / dx, for disturbances come from
below.

Within a sub-step slope and composition stand still, so that a species' captured share is
1 - exp(-c), c = gamma_aa P(theta_a - s) dt', with exp(c) to fourth order in c; the amplified share
of what the surface layer holds is found likewise. So thicknesses never turn negative, for any
input.

The surface is a layer of thickness d (Hirano's active layer) that holds d phi_a of each species.
What is captured mixes into it; what it then holds beyond d is buried in the deposit, and where it
holds less the deposit below refills it. The deposit is kept in bins of height dz, the topmost being
filled and those below it sealed, so erosion digs up what was buried. The rigid surface of before
pouring counts as surface where the layer is thinner than d, and gives up no grains.

Arrays are (species, cell); loops along the cells run in vector lanes, sealing and reopening of bins
are rare and go cell by cell.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from continuum.law import (
    Law,
    find_amplification_rate,
    find_capture_rate,
    find_repose_slope,
)
from experiment.arrays import Floats, Ints

__all__ = ["Flow", "Grid", "advance", "find_composition", "substeps_at"]


COURANT = 0.25
TINY = 1e-300  # cm; keeps 0 / 0 away where a bin is empty


class Grid(NamedTuple):
    """Cells of width dx, a step of dt, bins of height dz."""

    dx: float  # cm
    dt: float  # s
    dz: float  # cm


class Flow(NamedTuple):
    """The state of a pour, changed in place by :func:`advance`."""

    height: Floats  # (cell,) cm
    rolling: Floats  # (species, cell) cm; after a step: at the cell's downhill edge
    surface: Floats  # (species, cell) cm; what the surface layer holds
    filling: Floats  # (species, cell) cm; what the bin below it holds, which is being filled
    deposit: Floats  # (species, cell, bin) cm; the sealed bins
    top: Ints  # (cell,) the place of the bin that is being filled
    rigid: Floats  # (cell,) cm; how much of bin 0 the surface of before pouring takes up
    rigid_fraction: Floats  # (species,) its composition


@njit(cache=True, nogil=True)
def advance(flow: Flow, law: Law, grid: Grid, velocity: Floats, inflow: Floats) -> tuple[int, int]:
    """Advance `flow` by one step per row of `inflow` (step, species) [cm].

    Returns the number of steps taken, fewer than asked for where the deposit needs more bins first,
    and the largest number of sub-steps that one of them needed.
    """
    slope = np.empty(flow.height.size)
    most = 0
    for step in range(inflow.shape[0]):
        if _deposit_is_nearly_full(flow, grid, inflow[step]):
            return step, most
        _advect(flow.rolling, velocity, inflow[step])
        substeps = _count_substeps(flow.rolling, law, grid)
        most = max(most, substeps)
        for k in range(substeps):
            _find_slope(slope, flow.height, law, grid)
            _exchange(flow, slope, law, grid.dt / substeps)
            _capture_at_wall(flow, 1.0 / (substeps - k))
            _bury_or_dig_up(flow, law, grid)
    return inflow.shape[0], most


@njit(cache=True, error_model="numpy")
def find_composition(phi: Floats, surface: Floats, rigid_fraction: Floats, depth: float) -> None:
    """phi_a (species, cell) of surface layers that hold `surface` (species, cell) [cm].

    What a layer lacks of its depth is rigid surface of composition `rigid_fraction` (species,).
    """
    species, cells = surface.shape
    held = _total(surface)
    for a in range(species):
        for i in range(cells):
            bare = max(depth - held[i], 0.0)
            phi[a, i] = (surface[a, i] + bare * rigid_fraction[a]) / (held[i] + bare)


@njit(cache=True, error_model="numpy")
def _advect(rolling: Floats, velocity: Floats, inflow: Floats) -> None:
    species, cells = rolling.shape
    for a in range(species):
        nu = velocity[a] / velocity.max()
        if nu == 1.0:
            for i in range(cells - 1, 0, -1):
                rolling[a, i] = rolling[a, i - 1]
            rolling[a, 0] = inflow[a]
        else:
            _advect_slower(rolling[a], nu, inflow[a])


@njit(cache=True, error_model="numpy")
def _advect_slower(thickness: Floats, nu: float, inflow: float) -> None:
    """Van Leer's scheme for a Courant number nu < 1; nothing leaves through the wall."""
    cells = thickness.size
    arriving = nu * inflow
    uphill, here = inflow, thickness[0]
    for i in range(cells):
        leaving = 0.0
        downhill = here
        if i < cells - 1:
            downhill = thickness[i + 1]
            leaving = nu * (here + 0.5 * (1.0 - nu) * _van_leer(here - uphill, downhill - here))
        thickness[i] = here + (arriving - leaving)
        arriving = leaving
        uphill, here = here, downhill


@njit(cache=True, error_model="numpy")
def _van_leer(behind: float, ahead: float) -> float:
    """The harmonic mean of two differences of one sign; 0 at an extremum."""
    if behind * ahead <= 0.0:
        return 0.0
    return 2.0 * behind * ahead / (behind + ahead)


@njit(cache=True, error_model="numpy")
def substeps_at(rate: float, law: Law, grid: Grid) -> int:
    """Sub-steps that a step needs where gamma R is `rate` [cm/s] at most."""
    climb = rate * (1.0 + 2.0 * law.curvature_length / grid.dx)
    return int(min(max(1.0, math.ceil(climb * grid.dt / (COURANT * grid.dx))), 1e15))


@njit(cache=True, error_model="numpy")
def _count_substeps(rolling: Floats, law: Law, grid: Grid) -> int:
    species, cells = rolling.shape
    rate = np.zeros(cells)
    for a in range(species):
        gamma = law.collision_rate[a].max()
        for i in range(cells):
            rate[i] += gamma * rolling[a, i]
    return substeps_at(rate.max(), law, grid)


@njit(cache=True, error_model="numpy")
def _find_slope(slope: Floats, height: Floats, law: Law, grid: Grid) -> None:
    """The slope s = theta - l d2h/dx2 at each cell's downhill edge; the last cell's is not used."""
    cells = height.size
    curvature = law.curvature_length / grid.dx
    for i in range(cells - 1):
        theta = (height[i] - height[i + 1]) / grid.dx
        uphill = theta if i == 0 else (height[i - 1] - height[i]) / grid.dx
        slope[i] = theta - curvature * (uphill - theta)
    slope[cells - 1] = 0.0


@njit(cache=True, error_model="numpy")
def _exchange(flow: Flow, slope: Floats, law: Law, dt: float) -> None:
    shape = flow.rolling.shape
    phi, theta = np.empty(shape), np.empty(shape)
    captured, amplified, settled = np.empty(shape), np.empty(shape), np.empty(shape)
    find_composition(phi, flow.surface, flow.rigid_fraction, law.surface_depth)
    find_repose_slope(theta, phi, law)
    find_capture_rate(captured, theta, slope, law)
    find_amplification_rate(amplified, theta, slope, flow.rolling, law)
    for a in range(len(settled)):
        _settle(settled[a], captured[a], amplified[a], flow.rolling[a], flow.surface[a], law, dt)
        for i in range(flow.height.size - 1):
            flow.rolling[a, i] -= settled[a, i]
            flow.surface[a, i] += settled[a, i]
            flow.height[i] += settled[a, i]


@njit(cache=True, error_model="numpy")
def _settle(
    settled: Floats,
    captured: Floats,
    amplified: Floats,
    rolling: Floats,
    surface: Floats,
    law: Law,
    dt: float,
) -> None:
    """Thickness (cell,) of a species that comes to rest within dt, less what is set rolling.

    `settled` must not share memory with the others, or the loop does not run in vector lanes.
    """
    for i in range(settled.size):
        gain = _share(captured[i] * dt) * rolling[i]
        loss = _share(amplified[i] / law.surface_depth * dt) * surface[i]
        settled[i] = gain - loss


@njit(cache=True, inline="always")
def _share(c: float) -> float:
    """1 - exp(-c): what share is converted where rate times time is c."""
    growth = c * (1.0 + c / 2.0 * (1.0 + c / 3.0 * (1.0 + c / 4.0)))
    return growth / (1.0 + growth)


@njit(cache=True, error_model="numpy")
def _capture_at_wall(flow: Flow, share: float) -> None:
    """The last cell captures `share` of what reached it; over a step's sub-steps, all of it."""
    last = flow.height.size - 1
    for a in range(flow.rolling.shape[0]):
        settled = flow.rolling[a, last] * share
        flow.rolling[a, last] -= settled
        flow.surface[a, last] += settled
        flow.height[last] += settled


@njit(cache=True, error_model="numpy")
def _bury_or_dig_up(flow: Flow, law: Law, grid: Grid) -> None:
    """Bring each cell's surface layer back to its depth d, as far as the deposit can."""
    species, cells = flow.surface.shape
    depth = law.surface_depth
    held, filled = _total(flow.surface), _total(flow.filling)
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
def _total(thickness: Floats) -> Floats:
    """Sum over species (cell,) of thicknesses (species, cell)."""
    total = thickness[0].copy()
    for a in range(1, thickness.shape[0]):
        for i in range(total.size):
            total[i] += thickness[a, i]
    return total


@njit(cache=True, inline="always")
def _capacity(flow: Flow, i: int, dz: float) -> float:
    """What the bin that cell i is filling can hold; the lowest one is partly rigid."""
    return dz - flow.rigid[i] if flow.top[i] == 0 else dz


@njit(cache=True, error_model="numpy")
def _seal(flow: Flow, i: int, dz: float) -> None:
    """Close the bins of cell i that are full, and go on filling the one above them."""
    filled = flow.filling[:, i].sum()
    while filled > _capacity(flow, i, dz):
        capacity = _capacity(flow, i, dz)
        for a in range(flow.filling.shape[0]):
            sealed = capacity / filled * flow.filling[a, i]
            flow.filling[a, i] -= sealed
            flow.deposit[a, i, flow.top[i]] = sealed
        flow.top[i] += 1
        filled -= capacity


@njit(cache=True, error_model="numpy")
def _reopen(flow: Flow, i: int, wanted: float) -> None:
    """Refill the surface layer of cell i by `wanted` from the sealed bins, as far as they go."""
    while wanted > 0.0 and flow.top[i] > 0:
        flow.top[i] -= 1
        opened = flow.deposit[:, i, flow.top[i]]
        filled = opened.sum()
        dug = wanted / max(wanted, filled)
        for a in range(opened.size):
            moved = dug * opened[a]
            flow.surface[a, i] += moved
            flow.filling[a, i] += opened[a] - moved
            opened[a] = 0.0
        wanted -= filled


@njit(cache=True, error_model="numpy")
def _deposit_is_nearly_full(flow: Flow, grid: Grid, inflow: Floats) -> bool:
    """Whether some cell could outgrow its bins within a step: all that can reach it, captured."""
    species, cells, bins = flow.deposit.shape
    for i in range(cells):
        arriving = 0.0
        for a in range(species):
            uphill = flow.rolling[a, i - 1] if i > 0 else inflow[a]
            arriving += flow.rolling[a, i] + uphill
        if flow.top[i] + 2 + arriving / grid.dz >= bins:
            return True
    return False
