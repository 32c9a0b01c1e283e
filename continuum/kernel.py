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
are rare and go cell by cell. What keeps them fast, measured: the compiler gives up lanes where a
loop has too many arrays to check for shared memory, so each has few; a function that calls another
counts a reference to each array of its arguments, atomically, 5 ns each, so what a sub-step calls
is `forceinline` or calls nothing (but for _seal_or_reopen); and a sub-step allocates nothing.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from continuum.law import (
    Law,
    find_amplification_rate,
    find_capture_rate,
    find_push,
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


class Workspace(NamedTuple):
    """What a sub-step writes before it reads it, allocated once."""

    slope: Floats  # (cell,)
    bare: Floats  # (cell,) cm; what the surface layer lacks of its depth
    share: Floats  # (cell,)
    filled: Floats  # (cell,) cm
    crossing: Floats  # (cell,) cm; see _bury_or_dig_up
    phi: Floats  # (species, cell), as the ones below
    push: Floats
    theta: Floats
    captured: Floats
    amplified: Floats


@njit(cache=True, nogil=True)
def advance(flow: Flow, law: Law, grid: Grid, velocity: Floats, inflow: Floats) -> tuple[int, int]:
    """Advance `flow` by one step per row of `inflow` (step, species) [cm].

    Returns the number of steps taken, fewer than asked for where the deposit needs more bins first,
    and the largest number of sub-steps that one of them needed.
    """
    cells, shape = flow.height.size, flow.rolling.shape
    work = Workspace(
        np.empty(cells),
        np.empty(cells),
        np.empty(cells),
        np.empty(cells),
        np.empty(cells),
        np.empty(shape),
        np.empty(shape),
        np.empty(shape),
        np.empty(shape),
        np.empty(shape),
    )
    most = 0
    for step in range(inflow.shape[0]):
        if _deposit_is_nearly_full(flow, grid, inflow[step]):
            return step, most
        _advect(flow.rolling, velocity, inflow[step])
        substeps = _count_substeps(flow.rolling, work, law, grid)
        most = max(most, substeps)
        for k in range(substeps):
            _find_slope(work.slope, flow.height, law, grid)
            _exchange(flow, work, law, grid.dt / substeps)
            _capture_at_wall(flow, 1.0 / (substeps - k))
            _bury_or_dig_up(flow, work, law, grid)
            _seal_or_reopen(flow, work.crossing, grid)
    return inflow.shape[0], most


@njit(cache=True, error_model="numpy")
def find_composition(phi: Floats, surface: Floats, rigid_fraction: Floats, depth: float) -> None:
    """phi_a (species, cell) of surface layers that hold `surface` (species, cell) [cm].

    What a layer lacks of its depth is rigid surface of composition `rigid_fraction` (species,).
    """
    bare, per_layer = np.empty((2, surface.shape[1]))
    _compose(phi, bare, per_layer, surface, rigid_fraction, depth)


@njit(cache=True, error_model="numpy", forceinline=True)
def _compose(
    phi: Floats,
    bare: Floats,
    per_layer: Floats,
    surface: Floats,
    rigid_fraction: Floats,
    depth: float,
) -> None:
    """:func:`find_composition`, with what is bare of the depth and 1 / layer thickness (cell,)."""
    species, cells = surface.shape
    _total(bare, surface)
    for i in range(cells):
        held = bare[i]
        bare[i] = max(depth - held, 0.0)
        per_layer[i] = 1.0 / max(held, depth)
    for a in range(species):
        for i in range(cells):
            phi[a, i] = (surface[a, i] + bare[i] * rigid_fraction[a]) * per_layer[i]


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
def _count_substeps(rolling: Floats, work: Workspace, law: Law, grid: Grid) -> int:
    species, cells = rolling.shape
    rate = work.share
    rate[:] = 0.0
    for a in range(species):
        gamma = law.collision_rate[a].max()
        for i in range(cells):
            rate[i] += gamma * rolling[a, i]
    return substeps_at(_largest(rate), law, grid)


@njit(cache=True, error_model="numpy", forceinline=True)
def _largest(values: Floats) -> float:
    """The largest of `values`, which are overwritten: folded in halves, for lanes cannot reduce."""
    left = values.size
    while left > 1:
        half = (left + 1) // 2
        for i in range(left - half):
            values[i] = max(values[i], values[half + i])
        left = half
    return values[0]


@njit(cache=True, error_model="numpy")
def _find_slope(slope: Floats, height: Floats, law: Law, grid: Grid) -> None:
    """The slope s = theta - l d2h/dx2 at each cell's downhill edge; the last cell's is not used."""
    cells = height.size
    per_dx, curvature = 1.0 / grid.dx, law.curvature_length / grid.dx
    slope[0] = (height[0] - height[1]) * per_dx
    for i in range(1, cells - 1):
        theta = (height[i] - height[i + 1]) * per_dx
        uphill = (height[i - 1] - height[i]) * per_dx
        slope[i] = theta - curvature * (uphill - theta)
    slope[cells - 1] = 0.0


@njit(cache=True, error_model="numpy")
def _exchange(flow: Flow, work: Workspace, law: Law, dt: float) -> None:
    """Exchange grains for dt between what rolls and the surface of all cells but the last."""
    _compose(work.phi, work.bare, work.share, flow.surface, flow.rigid_fraction, law.surface_depth)
    find_repose_slope(work.theta, work.phi, law)
    find_capture_rate(work.captured, work.theta, work.slope, law)
    find_push(work.push, work.theta, work.slope, flow.rolling, law)
    find_amplification_rate(work.amplified, work.push, flow.rolling, law)
    work.captured[:, -1] = work.amplified[:, -1] = 0.0
    for a in range(len(flow.rolling)):
        settled = work.captured[a]
        _settle(settled, work.amplified[a], flow.rolling[a], flow.surface[a], law, dt)
        for i in range(settled.size):
            flow.height[i] += settled[i]


@njit(cache=True, error_model="numpy", forceinline=True)
def _settle(
    captured: Floats, amplified: Floats, rolling: Floats, surface: Floats, law: Law, dt: float
) -> None:
    """Bring grains of a species to rest for dt, and set others rolling.

    `captured` (cell,) [1/s] becomes the thickness [cm] that came to rest less what was set rolling.
    """
    amplification_dt = dt / law.surface_depth
    for i in range(captured.size):
        gain = _share(captured[i] * dt) * rolling[i]
        loss = _share(amplified[i] * amplification_dt) * surface[i]
        captured[i] = gain - loss
        rolling[i] -= gain - loss
        surface[i] += gain - loss


@njit(cache=True, inline="always")
def _share(c: float) -> float:
    """1 - exp(-c): what share is converted where rate times time is c."""
    growth = c * (1.0 + c * (1.0 / 2.0 + c * (1.0 / 6.0 + c * (1.0 / 24.0))))
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
def _bury_or_dig_up(flow: Flow, work: Workspace, law: Law, grid: Grid) -> None:
    """Bring each cell's surface layer back to its depth d, as far as the bin below it can.

    `work.crossing` (cell,) [cm] tells what that bin lacked (negative) or now holds beyond its
    capacity (positive).
    """
    species, cells = flow.surface.shape
    depth = law.surface_depth
    share, filled, crossing = work.share, work.filled, work.crossing
    _total(share, flow.surface)
    _total(filled, flow.filling)
    for i in range(cells):
        excess = share[i] - depth
        above = excess + filled[i]
        share[i] = excess / max(share[i] if excess > 0.0 else filled[i], abs(excess), TINY)
        crossing[i] = min(above, 0.0) + max(above - _capacity(flow, i, grid.dz), 0.0)
    for a in range(species):
        for i in range(cells):
            surface, filling = flow.surface[a, i], flow.filling[a, i]
            moved = share[i] * (surface if share[i] > 0.0 else filling)
            flow.surface[a, i] = surface - moved
            flow.filling[a, i] = filling + moved


@njit(cache=True, error_model="numpy")
def _seal_or_reopen(flow: Flow, crossing: Floats, grid: Grid) -> None:
    """Seal the bins that are full, and reopen sealed ones where the surface layer lacks grains."""
    for i in range(crossing.size):
        if crossing[i] < 0.0:
            _reopen(flow, i, -crossing[i])
        elif crossing[i] > 0.0:
            _seal(flow, i, grid.dz)


@njit(cache=True, error_model="numpy", forceinline=True)
def _total(total: Floats, thickness: Floats) -> None:
    """Sum over species (cell,) of thicknesses (species, cell)."""
    species = thickness.shape[0]
    for i in range(total.size):
        total[i] = thickness[0, i] + (thickness[1, i] if species > 1 else 0.0)
    for a in range(2, species):
        for i in range(total.size):
            total[i] += thickness[a, i]


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
