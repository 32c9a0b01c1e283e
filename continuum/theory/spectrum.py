"""The linear spectrum of a steadily growing pile in a silo: which disturbances grow, how fast.

The state U (cell, field) is what the kernel carries from step to step: the rolling thicknesses R_a,
the surface fractions phi_a of all species but the last, and the slope theta at the cell's downhill
edge, in which a uniform rise of the pile does not show. One step of the kernel is a map F, and

    U* = F(U*)                     the steady pile, which rises by v R0 / L everywhere
    J = dF/dU at U*,  J w = mu w   a disturbance w grows as exp(sigma t), sigma = ln(mu) / dt

is the spectrum of the scheme as it runs, at its resolution. A pile that rises never digs into its
deposit, which therefore is no part of the state.

With P(z) = max(z, 0) the map is smooth by pieces, its seams where some theta_a = s; J comes from
central differences far shorter than the distance of U* from them, O(dx) on a generic grid. As the
cell where species a begins to be captured changes with the grid, rates scatter by O(dx).
"""

from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.sparse import coo_array, csr_array, eye_array
from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs, splu

from continuum.kernel import advance, substeps_at
from continuum.run import Resolution, pour
from continuum.state import MUSCL, Flow, Grid, bare_flow
from continuum.theory.steady_state import steady_state_of
from continuum.transport import dispersion_substeps
from experiment import Experiment, NotApplicableError
from experiment.arrays import Floats, Ints
from experiment.law import Law, law_of

__all__ = [
    "Spectrum",
    "critical_delta",
    "critical_value",
    "growth_rates",
    "leading_growth_rate",
    "spectrum_of",
]

Complexes = NDArray[np.complex128]

DIFFERENCE = 1e-6  # of R [cm], phi and theta [1]
TOLERANCE = 1e-10
ACCURACY = 1e-9
MOST_ITERATIONS = 60
MOST_HALVINGS = 8
FAR_OFF = 1e6  # no slope, fraction or thickness is


class Spectrum(NamedTuple):
    """The steady pile on its grid and its leading modes; fields R_a, all phi_a but one, theta."""

    x: Floats  #: (cell,) cm; the cells' middles
    steady: Floats  #: (cell, field) R_a [cm] and theta [1] at the downhill edges
    growth_rate: Complexes  #: (mode,) 1/s, by falling real part
    mode: Complexes  #: (mode, cell, field)


def growth_rates(experiment: Experiment, count: int = 6) -> Complexes:
    """The `count` leading sigma [1/s] of the steady pile, by falling real part."""
    return spectrum_of(experiment, count).growth_rate


def leading_growth_rate(experiment: Experiment) -> complex:
    """The sigma [1/s] of the disturbance that grows fastest, or decays slowest."""
    return complex(growth_rates(experiment, 2)[0])


def critical_delta(experiment: Experiment, bracket: tuple[float, float] = (-0.25, 0.1)) -> float:
    """The delta, to 1e-4, at which the leading disturbance starts to grow; two species.

    Raises :class:`NotApplicableError` where growth does not change its sign within `bracket`.
    """
    return critical_value(experiment, "mixture.delta", bracket, accuracy=1e-4)


def critical_value(
    experiment: Experiment, key: str, bracket: tuple[float, float], accuracy: float
) -> float:
    """The value of the field `key` from which on the leading disturbance grows.

    To that `accuracy`. Raises :class:`NotApplicableError` unless it decays at the low end of the
    bracket and grows at the high one.
    """

    @cache
    def growth(value: float) -> float:
        return leading_growth_rate(experiment.with_values({key: value})).real

    low, high = (growth(value) for value in bracket)
    if not low < 0 < high:
        raise NotApplicableError(
            f"{key}: disturbances grow at {low:.2g} /s at {bracket[0]:g} and {high:.2g} /s at "
            f"{bracket[1]:g}; the growth rate should turn from negative to positive"
        )
    return float(brentq(growth, *bracket, xtol=accuracy))


def spectrum_of(experiment: Experiment, count: int = 6) -> Spectrum:
    """The steady pile of `experiment` and its `count` leading modes.

    Raises :class:`NotApplicableError` where no steady state is found.
    """
    step = step_of(experiment)
    steady = steady_pile(step, first_guess(experiment, step))
    factor, mode = leading_modes(step.jacobian(steady), count, power=max(1, step.cells // 10))
    x = (np.arange(step.cells) + 0.5) * step.grid.dx
    rate = np.log(factor) / step.grid.dt
    return Spectrum(x, steady, rate.astype(np.complex128), mode.T.reshape(-1, *steady.shape))


@dataclass(frozen=True)
class Step:
    """F: one step of the kernel, a map of states (cell, field)."""

    law: Law
    grid: Grid
    velocity: Floats
    inflow: Floats
    cells: int

    def __call__(self, state: Floats) -> Floats:
        """The state after one step."""
        species = len(self.inflow)
        flow = self.flow(state)
        advance(flow, self.law, self.grid, self.velocity, self.inflow[np.newaxis])
        after = np.zeros_like(state)
        after[:, :species] = flow.rolling.T
        after[:, species:-1] = flow.surface[:-1].T / self.law.surface_depth
        after[:-1, -1] = -np.diff(flow.height) / self.grid.dx
        return after

    def flow(self, state: Floats) -> Flow:
        """The kernel's state, on a deposit of which nothing is needed."""
        species = len(self.inflow)
        fraction = np.column_stack([state[:, species:-1], 1.0 - state[:, species:-1].sum(axis=1)])
        drop = state[:, -1] * self.grid.dx
        flow = bare_flow(np.cumsum(drop[::-1])[::-1], np.full(species, 1.0 / species), bins=5)
        return flow._replace(
            rolling=state[:, :species].T.copy(),
            surface=self.law.surface_depth * fraction.T.copy(),
        )

    def jacobian(self, state: Floats) -> csr_array:
        """J = dF/dU: cells out of each other's reach are disturbed together."""
        cells, fields = state.shape
        rate = float(np.max(self.law.collision_rate, axis=1) @ self.inflow)
        spread = dispersion_substeps(self.law.dispersion, self.grid)
        slopes = 2 if self.grid.scheme == MUSCL else 1  # that a sub-step finds
        reach = slopes * substeps_at(rate, self.law, self.grid) + spread + 3
        field, around = np.arange(fields), np.arange(-reach, reach + 1)
        rows, columns, values = [], [], []
        for first in range(min(around.size, cells)):
            disturbed = np.arange(first, cells, around.size)
            near = disturbed[:, np.newaxis] + around
            inside = (near >= 0) & (near < cells)
            row = (near[..., np.newaxis] * fields + field)[inside]
            for f in field:
                change = self._change(state, disturbed, f)
                column = np.broadcast_to((disturbed * fields + f)[:, np.newaxis], near.shape)
                rows.append(row.ravel())
                columns.append(np.repeat(column[inside], fields))
                values.append(change[near[inside]].ravel())
        index = np.concatenate(rows), np.concatenate(columns)
        found = coo_array((np.concatenate(values), index), shape=(state.size, state.size)).tocsr()
        found.eliminate_zeros()
        return found

    def _change(self, state: Floats, disturbed: Ints, field: np.integer[Any]) -> Floats:
        """The change of F per change of one field in some cells."""
        more, less = state.copy(), state.copy()
        more[disturbed, field] += DIFFERENCE
        less[disturbed, field] -= DIFFERENCE
        return (self(more) - self(less)) / (2 * DIFFERENCE)


def step_of(experiment: Experiment) -> Step:
    """The kernel's step for a set-up, fed its mean inflow, with bins that never fill."""
    if (experiment.cell.shape, experiment.cell.end) != ("silo", "wall"):
        raise NotApplicableError(
            f"cell.shape = {experiment.cell.shape!r}, cell.end = {experiment.cell.end!r}: "
            "the spectrum is that of a silo with a wall"
        )
    resolution = Resolution.parse(experiment.continuum, "continuum")
    return Step(
        law=law_of(experiment.mixture),
        grid=resolution.grid(experiment)._replace(dz=1e9),
        velocity=np.array(experiment.mixture.drift_velocity),
        inflow=experiment.mean_inflow,
        cells=resolution.cells,
    )


def first_guess(experiment: Experiment, step: Step) -> Floats:
    """The closed form for D = 0 and sharp P or, where there is none, the end of a long pour.

    The pour's surface layer is thick, for steady states do not depend on it and waves die out in it
    (unless the pile stratifies strongly).
    """
    edge = (np.arange(step.cells) + 1) * step.grid.dx
    edge[-1] = experiment.cell.length
    guess = np.zeros((step.cells, 2 * len(step.inflow)))
    sharp = experiment.with_values({"mixture.dispersion": 0.0, "mixture.smoothing": 0.0})
    try:
        closed = steady_state_of(sharp)
    except NotApplicableError:
        rolling, fraction, slope = _poured(experiment)
    else:
        rolling = closed.rolling_thickness(edge)
        fraction = closed.surface_fraction(edge - step.grid.dx / 2)
        slope = closed.slope(edge[:-1])
    guess[:, : len(step.inflow)] = rolling
    guess[:, len(step.inflow) : -1] = fraction[:, :-1]
    guess[:-1, -1] = slope
    return guess


def _poured(experiment: Experiment) -> tuple[Floats, Floats, Floats]:
    length, total = experiment.cell.length, float(experiment.mean_inflow.sum())
    depth = max(experiment.mixture.surface_depth, 5 * total)
    crossing = length / min(experiment.mixture.drift_velocity)
    slope = float(np.min(experiment.mixture.repose_slope))
    last = pour(
        experiment.with_values(
            {
                "mixture.surface_depth": depth,
                "cell.start_slope": slope,
                "pour.duration": crossing * (length + 20 * depth) / total,
                "pour.records": 1,
            }
        )
    ).isel(time=-1)
    dx = last["x"].values[1] - last["x"].values[0]
    return (
        last["rolling_thickness"].values,
        last["surface_fraction"].values,
        -np.diff(last["height"].values) / dx,
    )


def steady_pile(step: Step, guess: Floats) -> Floats:
    """U* = F(U*) by Newton's method from a guess, with shorter steps where it overshoots a seam."""
    state, missed = guess, step(guess) - guess
    for _ in range(MOST_ITERATIONS):
        if np.abs(missed).max() < TOLERANCE:
            return state
        try:
            solver = splu((eye_array(state.size) - step.jacobian(state)).tocsc())
        except RuntimeError:  # singular
            break
        towards = solver.solve(missed.ravel()).reshape(state.shape)
        for halvings in range(MOST_HALVINGS):
            moved = state + towards / 2**halvings
            left = step(moved) - moved if np.abs(moved).max() < FAR_OFF else np.full(1, np.inf)
            if np.linalg.norm(left) < np.linalg.norm(missed):
                break
        if not np.isfinite(left).all():
            break
        state, missed = moved, left
    raise NotApplicableError("mixture: no steady state of the pile was found")


def leading_modes(jacobian: csr_array, count: int, power: int) -> tuple[Complexes, Complexes]:
    """The mu (mode,) of largest modulus and their w (row, mode).

    Found from J^power, in which they stand farther apart; from all of J where that fails, for
    where the surface is passive many modes decay alike, as it is renewed.
    """

    def apply(vector: Floats) -> Floats:
        for _ in range(power):
            vector = jacobian @ vector
        return vector

    size = jacobian.shape[0]
    start = np.random.default_rng(0).standard_normal(size)
    try:
        operator = LinearOperator((size, size), matvec=apply, dtype=np.float64)
        _, w = eigs(operator, count, ncv=min(10 * count + 20, size), v0=start, maxiter=30)
        once = np.asarray(jacobian @ w)
        mu = np.einsum("ij,ij->j", w.conj(), once)  # for w is of length 1
        if np.abs(once - mu * w).max() > ACCURACY:
            raise ArpackNoConvergence("modes of a power of J are not those of J", mu, w)
    except ArpackNoConvergence:
        mu, w = np.linalg.eig(jacobian.toarray())
    order = np.argsort(-np.abs(mu))[:count]
    return mu[order], w[:, order]
