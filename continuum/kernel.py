"""One step of the surface flow on a grid of cells, as a list of physical actions.

    dR_a/dt = - v_a dR_a/dx + D d2R_a/dx2 + Gamma_a        dh/dt = - sum_a Gamma_a - w x
    s = theta - l d2h/dx2,  theta = - dh/dx                w: turning rate of a drum

Split in time. Transport: dt = dx / max v, so that species as fast as the fastest shift by exactly
one cell; what slower ones and dispersion do stands in transport.py. As R_i belongs to the cell's
downhill edge, this is half a shift, the exchange at the centre, and half a shift (Strang).

Exchange: sub-steps dt' with v_c dt' / dx <= COURANT, where v_c = gamma R (1 + 2 l / dx) is the
speed at which a disturbance of the slope climbs; in each one all cells first find their slope from
the heights of one instant, and only then exchange grains. (A cell that finished its exchange
against a neighbour already a step ahead would err by (dh/dt) / v in the slope at every resolution.)
Disturbances come from below, so the slope is found towards the downhill edge, where it is
theta_i = (h_i - h_{i+1}) / dx. There are two schemes:

    godunov, first order    the slope is theta_i, which adds dx / 2 to l; sub-steps by Euler
    muscl, second order     the slope is that at the cell's centre, where it has the neighbours:
                            theta_i + limited(theta_{i-1} - theta_i, theta_i - theta_{i+1}) / 2;
                            sub-steps by the midpoint rule

Within a sub-step of Euler slope and composition stand still, so that a species' captured share is
1 - exp(-c), c = gamma_aa P(theta_a - s) dt', with exp(c) to fourth order in c; the amplified share
of what the surface layer holds is found likewise. Such a sub-step of dt' / 2 leads to the midpoint;
what is converted in dt' is then exp(c / 2) - exp(-c / 2) of what is there half-way, at the rates of
there, and at most all. So thicknesses never turn negative, for any input.

At a wall all that arrives is captured. At a drum's upper rim, where nothing arrives that could set
grains rolling, all that its turning lifts is released.

The surface is a layer of thickness d (Hirano's active layer) that holds d phi_a of each species.
What is captured mixes into it; what it then holds beyond d is buried, and where it holds less what
was buried refills it (deposit.py). The rigid surface of before pouring counts as surface where the
layer is thinner than d, and gives up no grains.

What happens to a cell in a sub-step is done in two passes over the cells, exchange and burial, on
tuples with one value a species (species.py); one pass for both is too long a chain of operations
for the processor to overlap cells.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from continuum.deposit import (
    dig_up,
    is_nearly_bare,
    is_nearly_full,
    reopen,
    seal_full_bins,
    some_lack,
)
from continuum.limiters import limited
from continuum.state import MUSCL, Flow, Grid
from continuum.transport import advect, disperse
from experiment.arrays import Floats
from experiment.law import Law, amplification_rates, capture_rates, repose_slopes
from experiment.species import Rows, Values, at, put, total

__all__ = [
    "BARE",
    "DONE",
    "FULL",
    "Advance",
    "advance",
    "cells_of",
    "find_composition",
    "substeps_at",
    "take_steps",
]


COURANT = (0.25, 0.5)  # by scheme
DONE, FULL, BARE = range(3)
TINY = 1e-300  # cm; keeps 0 / 0 away where there is nothing


class Cells(NamedTuple):
    """The state by rows, and what a sub-step tells of each cell."""

    rolling: Rows  # (cell,) cm, as the next two
    surface: Rows
    filling: Rows
    rigid_fraction: Values
    slope: Floats  # (cell,) 1
    beyond: Floats  # (cell,) cm; what the open bin holds beyond its capacity, or lacks (negative)
    midway_height: Floats  # (cell,) cm; at the midpoint of a sub-step, as the next two
    midway_rolling: Rows  # (cell,) cm
    midway_surface: Rows  # (cell,) cm


class Advance(NamedTuple):
    """How far a slope was advanced."""

    steps: int
    substeps: int  # the most that one of them needed
    why: int  # DONE, or why it goes no further: tapes are nearly FULL, or BARE of bins in memory


def advance(flow: Flow, law: Law, grid: Grid, velocity: Floats, inflow: Floats) -> Advance:
    """Advance `flow` by one step per row of `inflow` (step, species) [cm].

    Before a step that tapes may not last for it stops.
    """
    return Advance(*take_steps(flow, cells_of(flow), law, grid, velocity, inflow))


def cells_of(flow: Flow) -> Cells:
    """The same state by rows, the same numbers in memory, on whatever tapes it goes on."""
    return Cells(
        rolling=tuple(flow.rolling),
        surface=tuple(flow.surface),
        filling=tuple(flow.filling),
        rigid_fraction=tuple(flow.rigid_fraction),
        slope=np.zeros_like(flow.height),
        beyond=np.zeros_like(flow.height),
        midway_height=np.zeros_like(flow.height),
        midway_rolling=tuple(np.zeros_like(flow.rolling)),
        midway_surface=tuple(np.zeros_like(flow.rolling)),
    )


@njit(cache=True, nogil=True)
def take_steps(
    flow: Flow, cells: Cells, law: Law, grid: Grid, velocity: Floats, inflow: Floats
) -> tuple[int, int, int]:
    """:func:`advance`, with the same state by rows."""
    most, fastest = 0, _fastest(law)
    for step in range(inflow.shape[0]):
        thickest = _thickest(cells.slope, flow.rolling, inflow[step])
        if is_nearly_full(flow, thickest, grid.dz):
            return step, most, FULL
        deepest = law.surface_depth * substeps_at(fastest * thickest, law, grid)
        if is_nearly_bare(flow, deepest, grid.dz):
            return step, most, BARE
        advect(flow.rolling, flow.outflow, grid, velocity, inflow[step])
        disperse(flow.rolling, law.dispersion, grid)
        substeps = substeps_at(_busiest_rate(cells.slope, flow.rolling, law), law, grid)
        most = max(most, substeps)
        dt = grid.dt / substeps
        for k in range(substeps):
            at_wall = 1.0 / (substeps - k)
            _find_slope(cells.slope, flow.height, law, grid)
            if grid.scheme == MUSCL:
                _go_midway(flow, cells, law, grid, dt, at_wall)
                _find_slope(cells.slope, cells.midway_height, law, grid)
                _exchange_as_midway(flow, cells, law, grid, dt, at_wall)
            else:
                _exchange_and_bury(flow, cells, law, grid, dt, at_wall)
            if some_lack(cells.beyond):
                dig_up(flow, cells.beyond)
            if grid.turning_rate > 0.0:
                _turn(flow.height, flow.surface, grid, dt)
        seal_full_bins(flow, cells.beyond, grid.dz)
        if grid.turning_rate > 0.0:
            _release_at_rim(flow, cells, law, grid)
    return inflow.shape[0], most, DONE


def find_composition(surface: Floats, rigid_fraction: Floats, depth: float) -> Floats:
    """phi_a (species, cell) of surface layers that hold `surface` (species, cell) [cm].

    What a layer lacks of its depth is rigid surface of composition `rigid_fraction` (species,).
    """
    phi = np.empty_like(surface)
    _compose(tuple(phi), tuple(surface), tuple(rigid_fraction), depth)
    return phi


@njit(cache=True)
def _compose(phi: Rows, surface: Rows, rigid_fraction: Values, depth: float) -> None:
    for i in range(phi[0].size):
        fraction = _composition(at(surface, i, rigid_fraction), rigid_fraction, depth)
        for a in range(len(phi)):
            phi[a][i] = fraction[a]


@njit(cache=True, error_model="numpy")
def substeps_at(rate: float, law: Law, grid: Grid) -> int:
    """Sub-steps that a step needs where gamma R is `rate` [cm/s] at most."""
    climb = rate * (1.0 + 2.0 * law.curvature_length / grid.dx)
    return int(min(max(1.0, math.ceil(climb * grid.dt / (COURANT[grid.scheme] * grid.dx))), 1e15))


@njit(cache=True)
def _fastest(law: Law) -> float:
    """The largest rate [1/s] of any species."""
    fastest = 0.0
    for rates in law.collision_rate:
        for rate in rates:
            fastest = max(fastest, rate)
    return fastest


@njit(cache=True, error_model="numpy")
def _busiest_rate(spoilt: Floats, rolling: Floats, law: Law) -> float:
    """The largest gamma R [cm/s] on the slope, each species at its largest rate."""
    species, cells = rolling.shape
    spoilt[:] = 0.0
    for a in range(species):
        fastest = 0.0
        for b in range(species):
            fastest = max(fastest, law.collision_rate[a][b])
        for i in range(cells):
            spoilt[i] += fastest * rolling[a, i]
    return _largest(spoilt)


@njit(cache=True, error_model="numpy")
def _thickest(spoilt: Floats, rolling: Floats, inflow: Floats) -> float:
    """A thickness [cm] that the flow exceeds nowhere during the next step; spoils its first."""
    species, cells = rolling.shape
    thickest = 0.0
    for a in range(species):
        for i in range(cells):
            spoilt[i] = rolling[a, i]
        thickest += max(_largest(spoilt), inflow[a])
    return thickest


@njit(cache=True, error_model="numpy")
def _largest(values: Floats) -> float:
    """The largest of `values`, which are overwritten: folded in halves, so that lanes can do it."""
    left = values.size
    while left > 1:
        half = (left + 1) // 2
        for i in range(left - half):
            values[i] = max(values[i], values[half + i])
        left = half
    return values[0]


@njit(cache=True, error_model="numpy")
def _find_slope(slope: Floats, height: Floats, law: Law, grid: Grid) -> None:
    """The slope s = theta - l d2h/dx2 that each cell exchanges grains at; a wall's is not used."""
    last = height.size - 1
    per_dx, curvature = 1.0 / grid.dx, law.curvature_length / grid.dx
    slope[0] = (height[0] - height[1]) * per_dx
    for i in range(1, last):
        theta = (height[i] - height[i + 1]) * per_dx
        uphill = (height[i - 1] - height[i]) * per_dx
        slope[i] = theta - curvature * (uphill - theta)
    slope[last] = 0.0 if math.isnan(grid.lip) else (height[last] - grid.lip) * 2.0 * per_dx
    if grid.scheme == MUSCL:
        _take_to_centres(slope, height, grid)


@njit(cache=True, error_model="numpy")
def _take_to_centres(slope: Floats, height: Floats, grid: Grid) -> None:
    """Take slopes from the downhill edges to the centres, in cells that have neighbours enough."""
    for i in range(1, height.size - 2):
        uphill = height[i - 1] - 2.0 * height[i] + height[i + 1]
        downhill = height[i] - 2.0 * height[i + 1] + height[i + 2]
        slope[i] += 0.5 * limited(grid.limiter, uphill, downhill) / grid.dx


@njit(cache=True, error_model="numpy")
def _exchange_and_bury(
    flow: Flow, cells: Cells, law: Law, grid: Grid, dt: float, at_wall: float
) -> None:
    """Exchange grains for dt at the rates of its beginning.

    A wall captures the share `at_wall` of what reached it, over a step's sub-steps all of it.
    """
    like = cells.rigid_fraction
    wall = flow.height.size - 1 if math.isnan(grid.lip) else -1
    for i in range(flow.height.size):
        rolling, surface = at(cells.rolling, i, like), at(cells.surface, i, like)
        settled = _settled(rolling, surface, cells.slope[i], like, law, dt)
        for a in range(len(settled)):
            settled = put(settled, a, rolling[a] * at_wall if i == wall else settled[a])
        _lay(flow, cells, i, settled)
    for i in range(flow.height.size):
        _bury(flow, cells, i, law, grid)


@njit(cache=True, error_model="numpy")
def _go_midway(flow: Flow, cells: Cells, law: Law, grid: Grid, dt: float, at_wall: float) -> None:
    """Tell what height, flow and surface will be in dt / 2, short of digging up sealed bins."""
    like = cells.rigid_fraction
    wall = flow.height.size - 1 if math.isnan(grid.lip) else -1
    for i in range(flow.height.size):
        rolling, surface = at(cells.rolling, i, like), at(cells.surface, i, like)
        settled = _settled(rolling, surface, cells.slope[i], like, law, 0.5 * dt)
        for a in range(len(settled)):
            captured = rolling[a] * (0.5 * at_wall)
            settled = put(settled, a, captured if i == wall else settled[a])
            surface = put(surface, a, surface[a] + settled[a])
            cells.midway_rolling[a][i] = rolling[a] - settled[a]
        cells.midway_height[i] = flow.height[i] + total(settled)
        filling = at(cells.filling, i, like)
        share = _buried_share(total(surface), total(filling), law.surface_depth)
        for a in range(len(settled)):
            cells.midway_surface[a][i] = surface[a] - _buried(share, surface[a], filling[a])
    if grid.turning_rate > 0.0:
        _turn(cells.midway_height, flow.surface, grid, 0.5 * dt)


@njit(cache=True, error_model="numpy")
def _exchange_as_midway(
    flow: Flow, cells: Cells, law: Law, grid: Grid, dt: float, at_wall: float
) -> None:
    """Exchange grains for dt at the rates of the midpoint."""
    like = cells.rigid_fraction
    wall = flow.height.size - 1 if math.isnan(grid.lip) else -1
    for i in range(flow.height.size):
        rolling, surface = at(cells.rolling, i, like), at(cells.surface, i, like)
        midway, layer = at(cells.midway_rolling, i, like), at(cells.midway_surface, i, like)
        theta = repose_slopes(_composition(layer, like, law.surface_depth), law)
        captured = capture_rates(theta, cells.slope[i], law)
        amplified = amplification_rates(theta, cells.slope[i], midway, law)
        settled = rolling
        for a in range(len(settled)):
            gain = min(_about_midway(captured[a] * dt) * midway[a], rolling[a])
            loss = _about_midway(amplified[a] * (dt / law.surface_depth)) * layer[a]
            loss = min(loss, surface[a])
            settled = put(settled, a, rolling[a] * at_wall if i == wall else gain - loss)
        _lay(flow, cells, i, settled)
    for i in range(flow.height.size):
        _bury(flow, cells, i, law, grid)


@njit(cache=True, inline="always")
def _settled(
    rolling: Values, surface: Values, slope: float, rigid_fraction: Values, law: Law, dt: float
) -> Values:
    """Thickness of each species that comes to rest within dt, less what is set rolling."""
    phi = _composition(surface, rigid_fraction, law.surface_depth)
    theta = repose_slopes(phi, law)
    captured = capture_rates(theta, slope, law)
    amplified = amplification_rates(theta, slope, rolling, law)
    settled = phi
    for a in range(len(phi)):
        gain = _share(captured[a] * dt) * rolling[a]
        loss = _share(amplified[a] * (dt / law.surface_depth)) * surface[a]
        settled = put(settled, a, gain - loss)
    return settled


@njit(cache=True, inline="always")
def _composition(surface: Values, rigid_fraction: Values, depth: float) -> Values:
    held = total(surface)
    bare, per_layer = max(depth - held, 0.0), 1.0 / max(held, depth)
    phi = surface
    for a in range(len(surface)):
        phi = put(phi, a, (surface[a] + bare * rigid_fraction[a]) * per_layer)
    return phi


@njit(cache=True, inline="always")
def _share(c: float) -> float:
    """1 - exp(-c): what share is converted where rate times time is c."""
    growth = c * (1.0 + c * (1.0 / 2.0 + c * (1.0 / 6.0 + c * (1.0 / 24.0))))
    return growth / (1.0 + growth)


@njit(cache=True, inline="always")
def _about_midway(c: float) -> float:
    """exp(c / 2) - exp(-c / 2): what is converted over what is left half-way, at c in all."""
    growth = 1.0 + 0.5 * c * (1.0 + c * (1.0 / 4.0 + c * (1.0 / 24.0 + c * (1.0 / 192.0))))
    return growth - 1.0 / growth


@njit(cache=True, inline="always")
def _lay(flow: Flow, cells: Cells, i: int, settled: Values) -> None:
    """Lay what settled onto cell i, for its surface layer to hold."""
    for a in range(len(settled)):
        cells.rolling[a][i] -= settled[a]
        cells.surface[a][i] += settled[a]
    flow.height[i] += total(settled)


@njit(cache=True, inline="always")
def _bury(flow: Flow, cells: Cells, i: int, law: Law, grid: Grid) -> None:
    """Bring the surface layer of cell i back to its depth d.

    What it holds beyond d goes into the open bin below it, which refills it where it holds less, as
    far as the bin can.
    """
    like = cells.rigid_fraction
    surface, filling = at(cells.surface, i, like), at(cells.filling, i, like)
    held, filled = total(surface), total(filling)
    above = held - law.surface_depth + filled
    capacity = grid.dz - flow.rigid[i] if flow.top[i] == 0 else grid.dz
    cells.beyond[i] = min(above, 0.0) + max(above - capacity, 0.0)
    share = _buried_share(held, filled, law.surface_depth)
    for a in range(len(like)):
        buried = _buried(share, surface[a], filling[a])
        cells.surface[a][i] = surface[a] - buried
        cells.filling[a][i] = filling[a] + buried


@njit(cache=True, inline="always")
def _buried_share(held: float, filled: float, depth: float) -> float:
    """What share of the surface layer goes into the open bin; if negative, the other way."""
    excess = held - depth
    return excess / max(held if excess > 0.0 else filled, abs(excess), TINY)


@njit(cache=True, inline="always")
def _buried(share: float, surface: float, filling: float) -> float:
    return share * (surface if share > 0.0 else filling)


@njit(cache=True, error_model="numpy")
def _turn(height: Floats, surface: Floats, grid: Grid, dt: float) -> None:
    """Turn a drum by w dt: its body rises uphill of the axis, x < 0, and sinks downhill.

    A half ring by the axis that has nothing left to lift stands still.
    """
    last = height.size - 1
    for i in range(height.size // 2):
        if surface[:, i].sum() > 0.0:
            lifted = grid.turning_rate * (0.5 * last - i) * grid.dx * dt
            height[i] += lifted
            height[last - i] -= lifted


@njit(cache=True, error_model="numpy")
def _release_at_rim(flow: Flow, cells: Cells, law: Law, grid: Grid) -> None:
    """Set rolling what the turning of a drum lifted in its first cell, where no flow arrives.

    Layer by layer, for that may be more than the surface layer holds.
    """
    lifted = grid.turning_rate * 0.5 * (flow.height.size - 1) * grid.dx * grid.dt
    held = flow.surface[:, 0].sum()
    while lifted > 0.0 and held > 0.0:
        share = min(lifted / held, 1.0)
        settled = at(cells.surface, 0, cells.rigid_fraction)
        for a in range(len(settled)):
            settled = put(settled, a, -share * settled[a])
        _lay(flow, cells, 0, settled)
        _bury(flow, cells, 0, law, grid)
        if cells.beyond[0] < 0.0:
            reopen(flow, 0, -cells.beyond[0])
        lifted -= share * held
        held = flow.surface[:, 0].sum()
