"""What moves: drift and spread, climbing waves, a patch that fades, the spectrum of the pile."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import xarray as xr
from scipy.optimize import curve_fit

from compare.quantities import total_inflow, values_of, velocity
from compare.validation.check import POWER, SCHEME, Check, Checks, Poured
from compare.validation.steady import orders_of
from continuum import Law, law_of
from continuum.kernel import advance
from continuum.state import GODUNOV, MUSCL, Flow, Grid, bare_flow
from continuum.theory import (
    ClimbingWave,
    Perturbation,
    growth_rates,
    perturbation_of,
    poured_step,
    spectrum_of,
    steady_state_of,
)
from continuum.theory.spectrum import Step, step_of
from experiment import Experiment, load
from experiment.archive import experiment_of
from experiment.arrays import Floats

__all__ = [
    "DRIFT_CELLS",
    "WAVES",
    "Oscillation",
    "after",
    "bcre",
    "drift_error",
    "faint_flow",
    "growth_of_noise",
    "kernel_step",
    "oscillation_of",
    "oscillations",
    "patch",
    "spectrum",
    "wave_errors",
]

BCRE = "BCRE; Makse 1997, sec. II: drift and diffusion, on a slope at repose"
CLIMBING = "BCRE for D = 0; exact wave with Lambert's W (continuum.theory.bcre)"
PERTURBATION = "Makse 1997, sec. IV, eq. (solutionr2)"
SPECTRUM = "linear stability of the scheme (continuum.theory.spectrum)"

THETA_R, RATE, SPEED = 0.6, 1.0, 1.0
WAVES = {
    "capturing": ClimbingWave(climb=0.5, velocity=SPEED, rate=RATE, faint_excess=-0.1, gap=0.3),
    "eroding": ClimbingWave(climb=0.5, velocity=SPEED, rate=RATE, faint_excess=0.02, gap=2.0),
}
LENGTH, TIME = 40.0, 16.0
WAVE_CELLS = (100, 200, 400, 800)
DRIFT_CELLS = (200, 400, 800)


def bcre(poured: Poured) -> Checks:
    """One species (Bouchaud, Cates, Prakash and Edwards).

    A feed onto a slope at repose drifts and spreads as advection and diffusion do; without
    dispersion a wave climbs without change of shape, while it captures or erodes.
    """
    settings = ("pour.duration=1.5", "pour.records=1")
    errors = [
        drift_error(poured("continuum", "bcre", *settings, f"continuum.cells={n}"))
        for n in DRIFT_CELLS
    ]
    what = "a feed drifts and spreads: mean |error| of R / R0"
    yield Check(f"{what}, 800 cells", BCRE, 0.0, errors[-1], 1e-4, "O(dx)")
    yield Check(
        f"{what}, order from 400 to 800 cells",
        SCHEME,
        1.0,
        float(orders_of(errors)[-1]),
        0.3,
        "still on its way to 1: the feed starts at once",
    )
    for scheme, name, order, limits in (
        (GODUNOV, "godunov", 1.0, {"capturing": 1e-4, "eroding": 4e-5}),
        (MUSCL, "muscl", 2.0, {"capturing": 4e-6, "eroding": 2e-7}),
    ):
        for kind, wave in WAVES.items():
            errors = wave_errors(kernel_step, wave, scheme)
            what = f"{name}, a climbing wave that is {kind}: relative error of theta - theta_r"
            yield Check(
                f"{what}, 800 cells", CLIMBING, 0.0, errors[-1], limits[kind], f"O(dx^{order:g})"
            )
            yield Check(
                f"{what}, order from 400 to 800 cells",
                SCHEME,
                order,
                float(orders_of(errors)[-1]),
                0.06,
                POWER,
            )


def drift_error(archive: xr.Dataset) -> float:
    """Mean error of R / R0 where a feed onto the slope of repose has not reached the wall yet.

    Nothing being exchanged, R is the mean over each cell.
    """
    x = values_of(archive, "x")
    found = values_of(archive, "rolling_thickness")[-1, :, 0] / total_inflow(archive)
    dispersion = experiment_of(archive).mixture.dispersion
    time = float(values_of(archive, "time")[-1])
    return float(np.abs(found - poured_step(x, velocity(archive), dispersion, time)).mean())


def one_species_law() -> Law:
    """The law of the climbing waves."""
    return Law(((THETA_R,),), ((RATE,),), ((0.0,),), 0.0, 0.1, 0.0)


def kernel_step(flow: Flow, law: Law, grid: Grid, inflow: float) -> None:
    """One step of the kernel."""
    advance(flow, law, grid, np.array([SPEED]), np.array([[inflow]]))


def wave_errors(
    step: Callable[[Flow, Law, Grid, float], None], wave: ClimbingWave, scheme: int = GODUNOV
) -> list[float]:
    """Mean error of the slope, relative to its excess, that a wave has after TIME, as dx halves.

    Only where nothing that happened at the wall has come to be known: it climbs slower than 0.5.
    """
    errors = []
    for cells in WAVE_CELLS:
        grid = Grid(LENGTH / cells, LENGTH / cells / SPEED, 0.05, scheme=scheme)
        law = one_species_law()
        middles = (np.arange(cells) + 0.5) * grid.dx
        edges = (np.arange(cells) + 1) * grid.dx
        climb = (wave.climb + wave.velocity) / wave.rate * np.log(wave.thickness(middles, 0.0))
        flow = bare_flow(100.0 - THETA_R * middles - climb, np.ones(1), 4000)
        flow.rolling[0] = wave.thickness(edges, 0.0)
        flow.surface[0] = law.surface_depth
        flow.tape[0, :, :1000] = grid.dz
        flow.top[:] = flow.sealed[:] = 1000
        for k in range(round(TIME / grid.dt)):
            step(flow, law, grid, float(wave.thickness(np.zeros(1), k * grid.dt)[0]))
        seen = edges[:-1] < LENGTH - 0.5 * TIME - 2.0
        exact = wave.excess_slope(edges[:-1], TIME)
        found = -np.diff(flow.height) / grid.dx - THETA_R
        error = np.abs(found - exact)[seen]
        errors.append(float(error.mean() / np.abs(exact[seen]).mean()))
    return errors


def patch(poured: Poured) -> Checks:  # noqa: ARG001
    """A flow of large grains over large ones, so faint that the steady slope does not change.

    R_2 ~ (l - x)^omega exp(-gamma delta t): with delta = 0.1 the flow fades, that is it is caught.
    """
    experiment = load("makse-profile", ["mixture.delta=0.1"])
    expected = perturbation_of(steady_state_of(experiment))
    times = (0.3, 0.6)
    (x, early), (_, late) = (faint_flow(experiment, expected, 400, time) for time in times)
    shape = np.polyfit(np.log(expected.reach - x), np.log(late), 1)
    rate = float(np.log(late / early).mean()) / (times[1] - times[0])
    exact = expected.rolling_thickness(x, times[1])
    yield Check(
        "large grains over large ones: omega = (v + v') / v",
        PERTURBATION,
        expected.exponent,
        float(shape[0]),
        0.01,
        "O(dx), 400 cells",
    )
    yield Check(
        "large grains over large ones: growth rate -gamma delta",
        PERTURBATION,
        expected.growth_rate,
        rate,
        0.01,
        "O(dx), 400 cells",
        "1/s",
    )
    yield Check(
        "large grains over large ones: mean |error| of R_2, relative",
        PERTURBATION,
        0.0,
        float(np.abs(late / exact - 1).mean()),
        6e-3,
        "O(dx), 400 cells",
    )


def faint_flow(
    experiment: Experiment, patch: Perturbation, cells: int, time: float
) -> tuple[Floats, Floats]:
    """Edges (cell,) [cm] and R_2 (cell,) after a time [s], of a flow like `patch`'s at t = 0.

    Over large grains, on the upper 12 cm of the steady pile, fed as `patch` tells; it is so faint
    that the slope does not change.
    """
    state, faint, length = steady_state_of(experiment), 1e-9, 12.0
    v = experiment.mixture.drift_velocity[0]
    grid = Grid(length / cells, length / cells / v, 0.01)
    edges = (np.arange(cells) + 1) * grid.dx
    fine = np.linspace(0.0, length, 20001)
    drop = np.concatenate([[0.0], np.cumsum(state.slope(0.5 * (fine[1:] + fine[:-1])))])
    height = 50.0 - np.interp(edges - grid.dx / 2, fine, drop * (fine[1] - fine[0]))
    flow = bare_flow(height, np.array([0.0, 1.0]), 200)
    flow.rolling[1] = faint * patch.rolling_thickness(edges, 0.0)
    law = law_of(experiment.mixture)
    for k in range(round(time / grid.dt)):
        fed = faint * patch.rolling_thickness(np.zeros(1), (k + 0.5) * grid.dt)[0]
        advance(flow, law, grid, np.full(2, v), np.array([[0.0, fed]]))
    return edges[:-1], flow.rolling[1, :-1] / faint


def spectrum(poured: Poured) -> Checks:  # noqa: ARG001
    """Noise on the steady pile grows, or decays, as the leading mode of its spectrum does.

    The spectrum is that of the kernel's own step: this holds the algebra, not the equations.
    """
    for name, depth, size, steps, share in (
        ("grows", 0.1, 1e-9, 500, 0.02),
        ("decays", 0.5, 1e-6, 1500, 1e-3),
    ):
        settings = ["mixture.delta=-0.15", f"mixture.surface_depth={depth}", "continuum.cells=100"]
        expected, found = growth_of_noise(load("makse-segregation", settings), size, steps)
        yield Check(
            f"noise on the steady pile that {name} (delta = -0.15, d = {depth} cm): Re sigma",
            SPECTRUM,
            expected,
            found,
            share * abs(expected),
            "what is left of other modes",
            "1/s",
        )


def growth_of_noise(experiment: Experiment, size: float, steps: int) -> tuple[float, float]:
    """Re sigma [1/s] of the leading mode, and the rate at which noise of this size comes to grow.

    Measured after so many steps over one beat of the wave, whose size pulsates.
    """
    step, found = step_of(experiment), spectrum_of(experiment, 2)
    sigma = found.growth_rate[0]
    noise = size * np.random.default_rng(3).uniform(-1.0, 0.0, found.steady.shape)
    early = after(step, found.steady + noise, steps)
    beat = round(2 * np.pi / abs(sigma.imag) / step.grid.dt) if sigma.imag else 200
    late = after(step, early, beat)
    change = np.linalg.norm(late - found.steady) / np.linalg.norm(early - found.steady)
    return float(sigma.real), float(np.log(change)) / (beat * step.grid.dt)


def after(step: Step, state: Floats, steps: int) -> Floats:
    """The state after a pour of `steps` by the kernel alone, which is told the state only once."""
    flow = step.flow(state)
    inflow = np.tile(step.inflow, (steps - 1, 1))
    advance(flow, step.law, step.grid, step.velocity, inflow)
    species = len(step.inflow)
    reached = np.zeros_like(state)
    reached[:, :species] = flow.rolling.T
    reached[:, species:-1] = flow.surface[:-1].T / step.law.surface_depth
    reached[:-1, -1] = -np.diff(flow.height) / step.grid.dx
    return step(reached)


class Oscillation(NamedTuple):
    """A damped oscillation, fitted where the flow swings most."""

    x: float  # cm
    rate: float  # 1/s
    frequency: float  # 1/s
    misfit: float  # rms, over the amplitude


def oscillations(poured: Poured) -> Checks:
    """Cross rates as large as the direct ones, delta < 0: the paper's last remark.

    The centre of the pile oscillates and calms exponentially (`mcs-oscillations`), which the
    spectrum foretells; that again is of the scheme itself, and holds its algebra.
    """
    settings = ("continuum.cells=400",)
    expected = growth_rates(load("mcs-oscillations", settings), 2)[0]
    found = oscillation_of(poured("continuum", "mcs-oscillations", *settings))
    source = f"Makse 1997, sec. V, end; {SPECTRUM}"
    why = "other modes in the signal"
    yield Check(
        "oscillations of the centre: decay rate",
        source,
        float(expected.real),
        found.rate,
        0.05 * abs(float(expected.real)),
        why,
        "1/s",
    )
    yield Check(
        "oscillations of the centre: angular frequency",
        source,
        abs(float(expected.imag)),
        found.frequency,
        0.015 * abs(float(expected.imag)),
        why,
        "1/s",
    )


def oscillation_of(archive: xr.Dataset, since: float = 1500.0) -> Oscillation:
    """The swing of the rolling thickness after the time `since` [s]."""
    flow = archive["rolling_thickness"].sum("species")
    late = flow.where(flow["time"] > since, drop=True)
    at = int(abs(late - late.isel(time=-1)).max("time").argmax("x"))
    time, signal = late["time"].values - since, late.isel(x=at).values

    def swing(
        t: Floats, rest: float, even: float, odd: float, rate: float, frequency: float
    ) -> Floats:
        wave = even * np.cos(frequency * t) + odd * np.sin(frequency * t)
        return np.asarray(rest + np.exp(rate * t) * wave)

    start = [signal[-1], 0.01, 0.01, -1e-3, 0.01]
    fitted = curve_fit(swing, time, signal, p0=start)[0]
    _, even, odd, rate, frequency = map(float, fitted)
    left = signal - swing(time, signal[-1], even, odd, rate, frequency)
    misfit = float(np.std(left) / np.hypot(even, odd))
    return Oscillation(float(archive["x"][at]), rate, frequency, misfit)
