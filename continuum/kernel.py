"""One step of the surface flow on a grid of cells, as a list of physical actions.

    dR_a/dt = - v_a dR_a/dx + D d2R_a/dx2 + Gamma_a        dh/dt = - sum_a Gamma_a - w x
    s = theta - l d2h/dx2,  theta = - dh/dx                w: turning rate of a drum

Split in time (Godunov, first order). Transport: dt = dx / max v, so that species as fast as the
fastest shift by exactly one cell; what slower ones and dispersion do stands in transport.py.
Exchange, first order in time and space: sub-steps dt' with v_c dt' / dx <= COURANT, where
v_c = gamma R (1 + 2 l / dx) is the speed at which a disturbance of the slope climbs; in each one
all cells first find their slope from the heights of one instant, and only then exchange grains. (A
cell that finished its exchange against a neighbour already a step ahead would err by (dh/dt) / v in
the slope at every resolution.) The slope belongs to the cell's downhill edge,
theta_i = (h_i - h_{i+1}) / dx, for disturbances come from below.

At a wall all that arrives is captured. At a drum's upper rim, where nothing arrives that could set
grains rolling, all that its turning lifts is released.

Within a sub-step slope and composition stand still, so that a species' captured share is
1 - exp(-c), c = gamma_aa P(theta_a - s) dt', with exp(c) to fourth order in c; the amplified share
of what the surface layer holds is found likewise. So thicknesses never turn negative, for any
input.

The surface is a layer of thickness d (Hirano's active layer) that holds d phi_a of each species.
What is captured mixes into it; what it then holds beyond d is buried, and where it holds less what
was buried refills it (deposit.py). The rigid surface of before pouring counts as surface where the
layer is thinner than d, and gives up no grains.

Arrays are (species, cell), so that each loop runs along the cells, in vector lanes.
"""

import math

import numpy as np
from numba import njit

from continuum.deposit import bury_or_dig_up, is_nearly_full, total
from continuum.law import (
    Law,
    find_amplification_rate,
    find_capture_rate,
    find_repose_slope,
)
from continuum.state import Flow, Grid
from continuum.transport import advect, disperse
from experiment.arrays import Floats

__all__ = ["advance", "find_composition", "substeps_at"]


COURANT = 0.25


@njit(cache=True, nogil=True)
def advance(flow: Flow, law: Law, grid: Grid, velocity: Floats, inflow: Floats) -> tuple[int, int]:
    """Advance `flow` by one step per row of `inflow` (step, species) [cm].

    Returns the number of steps taken, fewer than asked for where the deposit needs more bins first,
    and the largest number of sub-steps that one of them needed.
    """
    slope = np.empty(flow.height.size)
    most = 0
    for step in range(inflow.shape[0]):
        if is_nearly_full(flow, grid, inflow[step]):
            return step, most
        advect(flow, grid, velocity, inflow[step])
        disperse(flow.rolling, law.dispersion, grid)
        substeps = _count_substeps(flow.rolling, law, grid)
        most = max(most, substeps)
        for k in range(substeps):
            _find_slope(slope, flow.height, law, grid)
            _exchange(flow, slope, law, grid, grid.dt / substeps)
            if math.isnan(grid.lip):
                _capture_at_wall(flow, 1.0 / (substeps - k))
            bury_or_dig_up(flow, law.surface_depth, grid)
            if grid.turning_rate > 0.0:
                _turn(flow, grid, grid.dt / substeps)
                _release_at_rim(flow, grid, grid.dt / substeps)
    return inflow.shape[0], most


@njit(cache=True, error_model="numpy")
def find_composition(phi: Floats, surface: Floats, rigid_fraction: Floats, depth: float) -> None:
    """phi_a (species, cell) of surface layers that hold `surface` (species, cell) [cm].

    What a layer lacks of its depth is rigid surface of composition `rigid_fraction` (species,).
    """
    species, cells = surface.shape
    held = total(surface)
    for a in range(species):
        for i in range(cells):
            bare = max(depth - held[i], 0.0)
            phi[a, i] = (surface[a, i] + bare * rigid_fraction[a]) / (held[i] + bare)


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
    """The slope s = theta - l d2h/dx2 at each cell's downhill edge; a wall's is not used."""
    last = height.size - 1
    curvature = law.curvature_length / grid.dx
    for i in range(last):
        theta = (height[i] - height[i + 1]) / grid.dx
        uphill = theta if i == 0 else (height[i - 1] - height[i]) / grid.dx
        slope[i] = theta - curvature * (uphill - theta)
    slope[last] = 0.0 if math.isnan(grid.lip) else (height[last] - grid.lip) / (0.5 * grid.dx)


@njit(cache=True, error_model="numpy")
def _exchange(flow: Flow, slope: Floats, law: Law, grid: Grid, dt: float) -> None:
    shape = flow.rolling.shape
    phi, theta = np.empty(shape), np.empty(shape)
    captured, amplified, settled = np.empty(shape), np.empty(shape), np.empty(shape)
    find_composition(phi, flow.surface, flow.rigid_fraction, law.surface_depth)
    find_repose_slope(theta, phi, law)
    find_capture_rate(captured, theta, slope, law)
    find_amplification_rate(amplified, theta, slope, flow.rolling, law)
    first = 1 if grid.turning_rate > 0.0 else 0
    beyond = flow.height.size - (1 if math.isnan(grid.lip) else 0)
    for a in range(len(settled)):
        _settle(settled[a], captured[a], amplified[a], flow.rolling[a], flow.surface[a], law, dt)
        for i in range(first, beyond):
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
def _turn(flow: Flow, grid: Grid, dt: float) -> None:
    """Turn a drum by w dt: its body rises uphill of the axis, x < 0, and sinks downhill.

    A half ring by the axis that has nothing left to lift stands still.
    """
    last = flow.height.size - 1
    for i in range(flow.height.size // 2):
        if flow.surface[:, i].sum() > 0.0:
            lifted = grid.turning_rate * (0.5 * last - i) * grid.dx * dt
            flow.height[i] += lifted
            flow.height[last - i] -= lifted


@njit(cache=True, error_model="numpy")
def _release_at_rim(flow: Flow, grid: Grid, dt: float) -> None:
    """Set rolling what the turning of a drum lifts in its first cell, where no flow arrives."""
    lifted = grid.turning_rate * 0.5 * (flow.height.size - 1) * grid.dx * dt
    share = lifted / max(lifted, flow.surface[:, 0].sum())
    for a in range(flow.rolling.shape[0]):
        released = share * flow.surface[a, 0]
        flow.rolling[a, 0] += released
        flow.surface[a, 0] -= released
        flow.height[0] -= released
