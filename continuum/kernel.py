"""One step of the surface flow on a grid of cells, as a list of physical actions.

    dR_a/dt = - v_a dR_a/dx + Gamma_a        dh/dt = - sum_a Gamma_a
    s = theta - l d2h/dx2                    theta = - dh/dx

Split in time (Godunov, first order). Advection: dt = dx / max v, so that species as fast as the
fastest shift by exactly one cell; slower ones move by van Leer's limited, conservative scheme.
Exchange: sub-steps dt' with v_c dt' / dx <= COURANT, v_c = gamma R (1 + 2 l / dx) the speed at which
a disturbance of the slope climbs; in each one all cells first find their slope from the heights of
one instant, and only then exchange grains. (A cell that finished its exchange against a neighbour
already a step ahead would err by (dh/dt) / v in the slope at every resolution.) The slope belongs to
the cell's downhill edge, theta_i = (h_i - h_{i+1}) / dx, for disturbances come from below.

Within a sub-step slope and composition stand still, so that a species' captured share is
1 - exp(-c), c = gamma_aa P(theta_a - s) dt', with exp(c) to fourth order in c; the amplified share of
what the surface layer holds is found likewise. So thicknesses never turn negative, for any input.

The surface is a layer of thickness d (Hirano's active layer) that holds d phi_a of each species.
What is captured mixes into it; what it then holds beyond d is buried in the deposit, and where it
holds less the deposit below refills it. The deposit is kept in bins of height dz, so erosion digs
up what was buried. The rigid surface of before pouring counts as surface where the layer is thinner
than d, and gives up no grains.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from continuum.law import (
    Law,
    find_amplification_rate,
    find_capture_rate,
    find_repose_slope,
)

__all__ = ["Flow", "Grid", "advance", "find_composition", "thickness_at_rest"]

Array = NDArray[np.float64]

COURANT = 0.25


class Grid(NamedTuple):
    """Cells of width dx, a step of dt, bins of height dz."""

    dx: float  # cm
    dt: float  # s
    dz: float  # cm


class Flow(NamedTuple):
    """The state of a pour, changed in place by :func:`advance`."""

    height: Array  # (cell,) cm
    rolling: Array  # (species, cell) cm; after a step: at the cell's downhill edge
    surface: Array  # (species, cell) cm; what the surface layer holds
    deposit: Array  # (cell, bin, species) cm; what lies below the surface layer
    top: NDArray[np.int64]  # (cell,) the bin that is being filled
    rigid: Array  # (cell,) cm; how much of bin 0 the surface of before pouring takes up
    rigid_fraction: Array  # (species,) its composition


@njit(cache=True, nogil=True)
def advance(flow: Flow, law: Law, grid: Grid, velocity: Array, inflow: Array) -> tuple[int, int]:
    """Advance `flow` by one step per row of `inflow` (step, species) [cm].

    Returns the number of steps taken, fewer than asked for where the deposit needs more bins first,
    and the largest number of sub-steps that one of them needed.
    """
    slope = np.empty(flow.height.size)
    most = 0
    for step in range(inflow.shape[0]):
        if _deposit_is_nearly_full(flow, grid):
            return step, most
        _advect(flow.rolling, velocity, grid, inflow[step])
        substeps = _count_substeps(flow.rolling, law, grid)
        most = max(most, substeps)
        for k in range(substeps):
            _find_slope(slope, flow.height, law, grid)
            _exchange(flow, slope, law, grid.dt / substeps)
            _capture_at_wall(flow, 1.0 / (substeps - k))
            _bury_or_dig_up(flow, law, grid)
    return inflow.shape[0], most


@njit(cache=True, error_model="numpy")
def find_composition(phi: Array, surface: Array, rigid_fraction: Array, depth: float) -> None:
    """phi_a (species, cell) of surface layers that hold `surface` (species, cell) [cm].

    What a layer lacks of its depth is rigid surface of composition `rigid_fraction` (species,).
    """
    species, cells = surface.shape
    held = np.zeros(cells)
    for a in range(species):
        for i in range(cells):
            held[i] += surface[a, i]
    for a in range(species):
        for i in range(cells):
            bare = max(depth - held[i], 0.0)
            phi[a, i] = (surface[a, i] + bare * rigid_fraction[a]) / (held[i] + bare)


@njit(cache=True, nogil=True)
def thickness_at_rest(flow: Flow) -> Array:
    """What each column holds of each species (species, cell) [cm]: surface layer and deposit."""
    held = flow.surface.copy()
    species, cells = held.shape
    for i in range(cells):
        for k in range(flow.top[i] + 1):
            for a in range(species):
                held[a, i] += flow.deposit[i, k, a]
    return held


@njit(cache=True, error_model="numpy")
def _advect(rolling: Array, velocity: Array, grid: Grid, inflow: Array) -> None:
    species, cells = rolling.shape
    for a in range(species):
        nu = velocity[a] * grid.dt / grid.dx
        if nu == 1.0:
            for i in range(cells - 1, 0, -1):
                rolling[a, i] = rolling[a, i - 1]
            rolling[a, 0] = inflow[a]
        else:
            _advect_slower(rolling[a], nu, inflow[a])


@njit(cache=True, error_model="numpy")
def _advect_slower(thickness: Array, nu: float, inflow: float) -> None:
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
def _count_substeps(rolling: Array, law: Law, grid: Grid) -> int:
    species, cells = rolling.shape
    rate = np.zeros(cells)
    for a in range(species):
        gamma = law.collision_rate[a].max()
        for i in range(cells):
            rate[i] += gamma * rolling[a, i]
    climb = rate.max() * (1.0 + 2.0 * law.curvature_length / grid.dx)
    return max(1, math.ceil(climb * grid.dt / (COURANT * grid.dx)))


@njit(cache=True, error_model="numpy")
def _find_slope(slope: Array, height: Array, law: Law, grid: Grid) -> None:
    """s = theta - l d2h/dx2 at each cell's downhill edge; the last cell's is not used."""
    cells = height.size
    curvature = law.curvature_length / grid.dx
    for i in range(cells - 1):
        theta = (height[i] - height[i + 1]) / grid.dx
        uphill = theta if i == 0 else (height[i - 1] - height[i]) / grid.dx
        slope[i] = theta - curvature * (uphill - theta)
    slope[cells - 1] = 0.0


@njit(cache=True, error_model="numpy")
def _exchange(flow: Flow, slope: Array, law: Law, dt: float) -> None:
    phi, theta, captured, amplified = np.empty((4, *flow.rolling.shape))
    find_composition(phi, flow.surface, flow.rigid_fraction, law.surface_depth)
    find_repose_slope(theta, phi, law)
    find_capture_rate(captured, theta, slope, law)
    find_amplification_rate(amplified, theta, slope, flow.rolling, law)
    species, cells = flow.rolling.shape
    for a in range(species):
        for i in range(cells - 1):
            gain = _share(captured[a, i] * dt) * flow.rolling[a, i]
            loss = _share(amplified[a, i] / law.surface_depth * dt) * flow.surface[a, i]
            flow.rolling[a, i] += loss - gain
            flow.surface[a, i] += gain - loss
            flow.height[i] += gain - loss


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
    for i in range(cells):
        held = 0.0
        for a in range(species):
            held += flow.surface[a, i]
        if held > law.surface_depth:
            _bury(flow, i, held, held - law.surface_depth, grid.dz)
        elif held < law.surface_depth:
            _dig_up(flow, i, law.surface_depth - held)


@njit(cache=True, error_model="numpy")
def _bury(flow: Flow, i: int, held: float, surplus: float, dz: float) -> None:
    species = flow.surface.shape[0]
    while surplus > 0.0:
        k = flow.top[i]
        room = dz - _thickness(flow.deposit, i, k)
        if k == 0:
            room -= flow.rigid[i]
        if room <= 0.0:
            flow.top[i] += 1
            continue
        part = min(surplus, room)
        for a in range(species):
            moved = part / held * flow.surface[a, i]
            flow.surface[a, i] -= moved
            flow.deposit[i, k, a] += moved
        held -= part
        surplus -= part


@njit(cache=True, error_model="numpy")
def _dig_up(flow: Flow, i: int, wanted: float) -> None:
    species = flow.surface.shape[0]
    while wanted > 0.0:
        k = flow.top[i]
        buried = _thickness(flow.deposit, i, k)
        share = min(wanted / buried, 1.0) if buried > 0.0 else 1.0
        for a in range(species):
            moved = share * flow.deposit[i, k, a]
            flow.deposit[i, k, a] -= moved
            flow.surface[a, i] += moved
        if share < 1.0 or k == 0:
            return
        flow.top[i] -= 1
        wanted -= buried


@njit(cache=True, inline="always")
def _thickness(deposit: Array, i: int, k: int) -> float:
    thickness = 0.0
    for a in range(deposit.shape[2]):
        thickness += deposit[i, k, a]
    return thickness


@njit(cache=True, error_model="numpy")
def _deposit_is_nearly_full(flow: Flow, grid: Grid) -> bool:
    """Whether some cell could outgrow its bins within a step: all that can reach it, captured."""
    cells, bins, species = flow.deposit.shape
    for i in range(cells):
        arriving = 0.0
        for a in range(species):
            arriving += flow.rolling[a, i] + flow.rolling[a, max(i - 1, 0)]
        if flow.top[i] + 2 + arriving / grid.dz >= bins:
            return True
    return False
