"""The way to a steady state: this solver, scipy's solve_ivp and py-pde, each at what error.

The job is the preset `makse-profile`, to its end, where the closed form of the paper's section III
holds. The others solve the same equations by the method of lines on equal cells, with one compiled
right-hand side, and without a deposit, for nothing is eroded here: what is captured pushes an equal
thickness out of a full surface layer.

    dR_a/dt = - v (R_a,i - R_a,i-1) / dx - c_a        dh/dt = sum_a c_a
    dm_a/dt = c_a - phi_a sum_b c_b, the latter once m_1 + m_2 = d; the last cell captures all

Differences of the others are upwind, of first order: the steady state has kinks. This solver runs
its second-order scheme. Errors are means over the cells away from the wall (x < 0.93 L), of R_a and
theta at the cells' downhill edges.

`first` counts compilation: this solver's in a process of its own with nothing cached, as in the
first `make run`; the others' right-hand side; py-pde's of the whole loop, which each solve repeats.
"""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from itertools import count
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.integrate import solve_ivp

import continuum
from benchmarks.clock import once, seconds
from continuum import Law, law_of
from continuum.theory import steady_state_of
from experiment import Experiment, load
from experiment.arrays import Floats

try:
    import pde
except ImportError:
    pde = None

METHODS = ("RK45", "RK23", "DOP853", "LSODA", "BDF", "Radau")
TOLERANCE = {"rtol": 1e-2, "atol": 1e-6}  # their errors are those of the grid, not of time
PATIENCE = 5.0  # s
GRIDS = (150, 300)
PDE_SOLVERS = ("euler", "runge-kutta")
POUR_ONCE = """
import time, continuum
from experiment import load
settings = ["continuum.cells={cells}", "continuum.scheme=muscl", "pour.records=1"]
experiment = load("makse-profile", settings)
start = time.perf_counter()
continuum.pour(experiment)
print(time.perf_counter() - start)
"""


class Errors(NamedTuple):
    """Mean absolute errors of theta, and of R_a in units of R0."""

    slope: float
    rolling: float


class Row(NamedTuple):
    """What one way of solving cost, warm and with compilation [s], and how far off it was."""

    name: str
    cells: int
    warm: float
    first: float
    errors: Errors

    def errs_no_more_than(self, other: "Row") -> bool:
        """In theta and in R."""
        return all(mine <= its for mine, its in zip(self.errors, other.errors, strict=True))

    def show(self) -> None:
        """Print it."""
        print(
            f"{self.name:20s} {self.cells:6d} {self.warm:9.4f} {self.first:9.2f} "
            f"{self.errors.slope:9.1e} {self.errors.rolling:9.1e}"
        )


class Job(NamedTuple):
    """What the others need to know of the set-up."""

    law: Law
    inflow: Floats  # (species,) cm
    rigid_fraction: Floats  # (species,)
    velocity: float  # cm/s
    dx: float  # cm


def set_up(cells: int) -> Experiment:
    settings = [f"continuum.cells={cells}", "continuum.scheme=muscl", "pour.records=1"]
    return load("makse-profile", settings)


def job_of(experiment: Experiment, cells: int) -> tuple[Job, Floats]:
    """The job, and the state it starts from: R_1, R_2, m_1, m_2 and h, (5, cell) cm."""
    dx = experiment.cell.length / cells
    start = np.zeros((5, cells))
    start[4] = experiment.cell.base_height((np.arange(cells) + 0.5) * dx)
    job = Job(
        law=law_of(experiment.mixture),
        inflow=np.array(experiment.feed.inflow),
        rigid_fraction=np.array(experiment.start_composition),
        velocity=experiment.mixture.drift_velocity[0],
        dx=dx,
    )
    return job, start


@njit(error_model="numpy")
def rate_of_change(state: Floats, job: Job) -> Floats:
    """d/dt of R_1, R_2, m_1, m_2 and h, (5, cell) cm/s."""
    rate = np.empty_like(state)
    repose, gamma = job.law.repose_slope, job.law.collision_rate
    depth, bare_1 = job.law.surface_depth, job.rigid_fraction[0]
    last = state.shape[1] - 1
    for i in range(last + 1):
        r_1, r_2, m_1, m_2 = state[0, i], state[1, i], state[2, i], state[3, i]
        above_1 = state[0, i - 1] if i > 0 else job.inflow[0]
        above_2 = state[1, i - 1] if i > 0 else job.inflow[1]
        held = m_1 + m_2
        phi_1 = (m_1 + max(depth - held, 0.0) * bare_1) / max(held, depth)
        if i == last:
            c_1, c_2 = job.velocity * above_1 / job.dx, job.velocity * above_2 / job.dx
        else:
            slope = (state[4, i] - state[4, i + 1]) / job.dx
            lack_1 = repose[0][0] * phi_1 + repose[0][1] * (1.0 - phi_1) - slope
            lack_2 = repose[1][0] * phi_1 + repose[1][1] * (1.0 - phi_1) - slope
            push_1, push_2 = max(-lack_1, 0.0) * r_1, max(-lack_2, 0.0) * r_2
            per_layer = 1.0 / max(held, depth)
            c_1 = gamma[0][0] * max(lack_1, 0.0) * r_1
            c_1 -= per_layer * m_1 * (gamma[0][0] * push_1 + gamma[1][0] * push_2)
            c_2 = gamma[1][1] * max(lack_2, 0.0) * r_2
            c_2 -= per_layer * m_2 * (gamma[0][1] * push_1 + gamma[1][1] * push_2)
        rate[0, i] = job.velocity * (above_1 - r_1) / job.dx - c_1
        rate[1, i] = job.velocity * (above_2 - r_2) / job.dx - c_2
        buried = c_1 + c_2 if held >= depth else 0.0
        rate[2, i] = c_1 - phi_1 * buried
        rate[3, i] = c_2 - (1.0 - phi_1) * buried
        rate[4, i] = c_1 + c_2
    return rate


def errors_of(height: Floats, rolling: Floats, experiment: Experiment) -> Errors:
    """Errors at the end, at the cells' downhill edges."""
    exact = steady_state_of(experiment)
    dx = exact.length / len(height)
    x = (np.arange(len(height)) + 0.5) * dx
    inside = x < 0.93 * exact.length
    slope = -np.diff(height) / dx - exact.slope(x[:-1] + 0.5 * dx)
    thickness = rolling - exact.rolling_thickness(x + 0.5 * dx).T
    return Errors(
        float(np.abs(slope[inside[:-1]]).mean()),
        float(np.abs(thickness[:, inside]).mean() / exact.total_inflow),
    )


def ours(cells: int, compiling: float) -> Row:
    experiment = set_up(cells)
    archive = continuum.pour(experiment).isel(time=-1)
    height, rolling = archive["height"].values, archive["rolling_thickness"].values.T
    errors = errors_of(height, rolling, experiment)
    warm = seconds(lambda: continuum.pour(experiment))
    return Row("stratify", cells, warm, warm + compiling, errors)


def in_a_new_process(cells: int, cache: str) -> float:
    """Seconds that the first pour of a process takes, imports left out."""
    command = [sys.executable, "-c", POUR_ONCE.format(cells=cells)]
    settings = os.environ | {"NUMBA_CACHE_DIR": cache}
    done = subprocess.run(command, env=settings, check=True, capture_output=True)
    return float(done.stdout)


def by_scipy(cells: int, method: str, compiling: float) -> Row | None:
    """None where `method` is not done within PATIENCE."""
    experiment = set_up(cells)
    job, start = job_of(experiment, cells)
    calls, deadline = count(), time.perf_counter() + PATIENCE

    def right_hand_side(_: float, state: Floats) -> Floats:
        if next(calls) % 256 == 0 and time.perf_counter() > deadline:
            raise TimeoutError
        return rate_of_change(state.reshape(start.shape), job).ravel()

    span = (0.0, experiment.pour.duration)
    solve = partial(
        solve_ivp, right_hand_side, span, start.ravel(), method=method, t_eval=span[1:], **TOLERANCE
    )
    try:
        end = solve().y[:, -1].reshape(start.shape)
        warm = min(once(solve) for _ in range(2))
    except TimeoutError:
        return None
    errors = errors_of(end[4], end[:2], experiment)
    return Row(f"scipy {method}", cells, warm, warm + compiling, errors)


def by_pde(cells: int, solver: str) -> Row:
    """With py-pde's own clock for the warm time, as it compiles anew in every solve."""
    experiment = set_up(cells)
    job, start = job_of(experiment, cells)

    class SurfaceFlow(pde.PDEBase):
        """The job, with the right-hand side that scipy gets."""

        def evolution_rate(self, state: pde.FieldCollection, _: float = 0.0):
            rate = state.copy()
            rate.data = rate_of_change(state.data, job)
            return rate

        def make_evolution_rate(self, *_: object, **__: object) -> Callable[..., Floats]:
            return lambda state, _: rate_of_change(state, job)

    grid = pde.CartesianGrid([[0.0, experiment.cell.length]], [cells])
    fields = pde.FieldCollection([pde.ScalarField(grid, row) for row in start])
    began = time.perf_counter()
    end, info = SurfaceFlow().solve(
        fields,
        t_range=experiment.pour.duration,
        dt=1e-3,
        adaptive=True,
        tolerance=TOLERANCE["rtol"] * 1e-2,
        solver=solver,
        backend="numba",
        tracker=None,
        ret_info=True,
    )
    first = time.perf_counter() - began
    warm = info["controller"]["profiler"]["solver"]
    errors = errors_of(end.data[4], end.data[:2], experiment)
    return Row(f"py-pde {solver}", cells, warm, first, errors)


def main() -> None:
    job, start = job_of(set_up(GRIDS[0]), GRIDS[0])
    compiling = once(lambda: rate_of_change(start, job))
    with tempfile.TemporaryDirectory() as folder:
        first, later = (in_a_new_process(GRIDS[0], folder) for _ in range(2))
    print(
        f"stratify's first pour in a new process takes {first:.2f} s, {later:.2f} s once compiled "
        f"on disk; the others' right-hand side compiles in {compiling:.2f} s\n"
        f"{'':20s} {'cells':>6s} {'warm, s':>9s} {'first, s':>9s} {'theta':>9s} {'R / R0':>9s}"
    )
    for cells in GRIDS:
        compare(cells, first, compiling)


def compare(cells: int, first: float, compiling: float) -> None:
    """All on `cells` cells; then this solver on as few as make its errors no larger than theirs."""
    theirs = [row for method in METHODS if (row := by_scipy(cells, method, compiling))]
    if pde is not None:
        theirs += [by_pde(cells, solver) for solver in PDE_SOLVERS]
    theirs.sort(key=lambda row: row.warm)
    best, soonest = theirs[0], min(row.first for row in theirs)
    equal_cells = ours(cells, first)
    coarser = (ours(fewer, first) for fewer in range(30, cells, 15))
    equal_error = next((row for row in coarser if row.errs_no_more_than(best)), equal_cells)
    for row in (equal_cells, equal_error, *theirs):
        row.show()
    missing = {f"scipy {method}" for method in METHODS} - {row.name for row in theirs}
    print(
        f"not done after {PATIENCE:.0f} s: {', '.join(sorted(missing)) or 'none'}"
        f"{'' if pde else '; py-pde is missing'}\n"
        f"to {best.name}: {best.warm / equal_cells.warm:.1f} x as fast on equal cells, "
        f"{best.warm / equal_error.warm:.1f} x at equal error, "
        f"{soonest / equal_error.first:.2f} x with compilation"
    )
