"""Rolling grains on their way downhill:  dR_a/dt = - v_a dR_a/dx + D d2R_a/dx2.

Advection: species as fast as the fastest shift by exactly one cell in a step; slower ones, at a
Courant number nu = v_a / max v, move by the conservative scheme

    leaving_i = nu (R_i + (1 - nu) / 2 * limited(R_i - R_{i-1}, R_{i+1} - R_i)),

of second order where the profile is smooth. Dispersion: explicit sub-steps with D dt' / dx^2 <= 1/6
(where the leading errors in space and time cancel), so thicknesses stay positive; nothing disperses
through either end.
"""

import math

import numpy as np
from numba import njit

from continuum.limiters import limited
from continuum.state import Grid
from experiment.arrays import Floats

__all__ = ["advect", "disperse", "dispersion_substeps"]

MESH_RATIO = 1.0 / 6.0


@njit(cache=True, error_model="numpy")
def advect(rolling: Floats, outflow: Floats, grid: Grid, velocity: Floats, inflow: Floats) -> None:
    """Move each species (species, cell) on by a step; what leaves an open end joins `outflow`."""
    is_open, fastest = not math.isnan(grid.lip), velocity.max()
    species, cells = rolling.shape
    for a in range(species):
        nu = velocity[a] / fastest
        if nu < 1.0:
            fallen = _advect_slower(rolling[a], nu, inflow[a], is_open, grid.limiter)
        else:
            fallen = rolling[a, cells - 1]
            for i in range(cells - 1, 0, -1):
                rolling[a, i] = rolling[a, i - 1]
            rolling[a, 0] = inflow[a]
        outflow[a] += fallen


@njit(cache=True, error_model="numpy")
def _advect_slower(
    thickness: Floats, nu: float, inflow: float, is_open: bool, limiter: int
) -> float:
    """Move one species (cell,) at a Courant number nu < 1; returns what left the last cell."""
    cells = thickness.size
    arriving = nu * inflow
    uphill, here = inflow, thickness[0]
    for i in range(cells):
        leaving = nu * here if is_open else 0.0
        downhill = here
        if i < cells - 1:
            downhill = thickness[i + 1]
            steepness = limited(limiter, here - uphill, downhill - here)
            leaving = nu * (here + 0.5 * (1.0 - nu) * steepness)
        thickness[i] = here + (arriving - leaving)
        arriving = leaving
        uphill, here = here, downhill
    return arriving


@njit(cache=True, error_model="numpy")
def dispersion_substeps(dispersion: float, grid: Grid) -> int:
    """Sub-steps that dispersion [cm2/s] needs in a step."""
    return int(min(math.ceil(dispersion * grid.dt / (MESH_RATIO * grid.dx**2)), 1e15))


@njit(cache=True, error_model="numpy")
def disperse(rolling: Floats, dispersion: float, grid: Grid) -> None:
    """Spread each species (species, cell) along the slope for a step."""
    substeps = dispersion_substeps(dispersion, grid)
    if substeps == 0:
        return
    ratio = dispersion * grid.dt / (substeps * grid.dx**2)
    species, cells = rolling.shape
    flux = np.zeros(cells + 1)
    for _ in range(substeps):
        for a in range(species):
            for i in range(1, cells):
                flux[i] = ratio * (rolling[a, i - 1] - rolling[a, i])
            for i in range(cells):
                rolling[a, i] += flux[i] - flux[i + 1]
