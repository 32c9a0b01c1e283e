"""One species: BCRE and de Gennes. The solver against their closed forms, and at what order."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from flows import law_with, still, take

import continuum
from compare.validation.steady import drum_errors, orders_of
from compare.validation.waves import DRIFT_CELLS, WAVES, drift_error, kernel_step, wave_errors
from continuum.limiters import LIMITERS
from continuum.state import MUSCL, Flow, Grid
from continuum.theory.bcre import spread_step
from continuum.theory.de_gennes import drum_of, silo_of
from experiment import NotApplicableError, load
from experiment.law import Law

SPEED, RATE = 1.0, 1.0


def trapped_step(flow: Flow, law: Law, grid: Grid, inflow: float) -> None:
    """The trap: each cell finishes its exchange against a neighbour already a step ahead."""
    rolling, height = flow.rolling[0], flow.height
    rolling[1:] = rolling[:-1].copy()
    rolling[0] = inflow
    for i in range(len(height) - 2, -1, -1):
        excess = (height[i] - height[i + 1]) / grid.dx - law.repose_slope[0][0]
        settled = -math.expm1(-abs(excess) * grid.dt * RATE) * rolling[i] * -np.sign(excess)
        rolling[i] -= settled
        height[i] += settled


def assert_first_order(errors: list[float]) -> None:
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (orders > 0.9).all(), (errors, orders)


@pytest.mark.parametrize("kind", WAVES)
def test_a_climbing_wave_is_followed_at_first_order(kind: str) -> None:
    errors = wave_errors(kernel_step, WAVES[kind])
    assert_first_order(errors)
    assert errors[-1] < 0.01


@pytest.mark.parametrize("kind", WAVES)
def test_a_climbing_wave_is_followed_at_second_order_by_muscl(kind: str) -> None:
    errors = np.array(wave_errors(kernel_step, WAVES[kind], MUSCL))
    orders = np.log2(errors[:-1] / errors[1:])
    assert (orders > 1.4).all(), (errors, orders)
    assert orders[-1] > 1.9
    assert errors[-1] < 2e-6


@pytest.mark.parametrize("kind", WAVES)
def test_the_trap_fails_the_order_test(kind: str) -> None:
    """It looks converged, to a wrong slope."""
    errors = wave_errors(trapped_step, WAVES[kind])
    with pytest.raises(AssertionError):
        assert_first_order(errors)
    assert errors[-1] > 0.5 * errors[-2]


@pytest.mark.parametrize("kind", WAVES)
def test_the_climbing_wave_solves_the_equations(kind: str) -> None:
    wave, small = WAVES[kind], 1e-4
    x = np.linspace(1.0, 30.0, 7)

    def rate(values: Callable[[np.ndarray, float], np.ndarray], along: str) -> np.ndarray:
        if along == "t":
            return (values(x, 3.0 + small) - values(x, 3.0 - small)) / (2 * small)
        return (values(x + small, 3.0) - values(x - small, 3.0)) / (2 * small)

    thickness, excess = wave.thickness(x, 3.0), wave.excess_slope(x, 3.0)
    gain = rate(wave.thickness, "t") + SPEED * rate(wave.thickness, "x")
    np.testing.assert_allclose(gain, RATE * excess * thickness, rtol=1e-6)
    exchange = rate(lambda x, t: RATE * wave.thickness(x, t) * wave.excess_slope(x, t), "x")
    np.testing.assert_allclose(rate(wave.excess_slope, "t"), exchange, rtol=1e-6)


def spread_error(cells: int, velocity: float, limiter: int) -> float:
    """L1 error of a smooth step that drifts, slower than the other species, and disperses."""
    length, dispersion, time, start = 20.0, 0.2, 4.0, 2.0
    dx = length / cells
    grid = Grid(dx, dx / 2.0, 0.1, limiter=limiter)
    law = law_with(
        2,
        repose_slope=np.ones((2, 2)),
        collision_rate=np.eye(2),
        curvature_length=0.0,
        dispersion=dispersion,
    )
    x = (np.arange(cells) + 0.5) * dx
    flow = still(law, cells, base=length - x)
    flow.rolling[1] = 0.1 * spread_step(x - 7.0, dispersion, start)
    feed = np.tile([0.0, 0.1], (round(time / grid.dt), 1))
    take(flow, law, grid, np.array([2.0, velocity]), feed)
    exact = 0.1 * spread_step(x - 7.0 - velocity * time, dispersion, start + time)
    return float(np.abs(flow.rolling[1] - exact)[: cells * 9 // 10].sum() * dx)


@pytest.mark.parametrize("limiter", LIMITERS)
def test_drift_and_dispersion_of_a_smooth_step_are_of_second_order(limiter: str) -> None:
    place = LIMITERS.index(limiter)
    errors = np.array([spread_error(cells, 1.2, place) for cells in (100, 200, 400)])
    orders = np.log2(errors[:-1] / errors[1:])
    assert (orders > 1.7).all(), (errors, orders)


def test_the_feed_of_the_bcre_preset_drifts_and_spreads_as_advection_and_diffusion_do() -> None:
    """On the slope of repose nothing is exchanged before the flow has reached the wall."""
    errors = []
    for cells in DRIFT_CELLS:
        settings = ["pour.duration=1.5", "pour.records=1", f"continuum.cells={cells}"]
        errors.append(drift_error(continuum.pour(load("bcre", settings))))
    assert errors[-1] < 1e-4
    orders = orders_of(errors)
    assert orders[-1] > orders[0], "it tends to 1 from below, for the feed starts at once"
    assert orders[-1] > 0.8


@pytest.mark.parametrize("cells", [75, 150, 300])
def test_de_gennes_silo_is_reached(cells: int) -> None:
    experiment = load("de-gennes-silo", [f"continuum.cells={cells}", "pour.duration=300.0"])
    state, archive = silo_of(experiment), continuum.pour(experiment)
    dx = experiment.cell.length / cells
    edges = archive["x"].values + dx / 2
    last = archive.isel(time=-1)
    rolling = last["rolling_thickness"].values[:-1, 0]
    np.testing.assert_allclose(rolling, state.rolling_thickness(edges[:-1]), atol=1e-6)
    slope = -np.diff(last["height"].values) / dx
    inner = edges[:-1] < 28.0
    error = np.abs(slope - state.slope(edges[:-1]))[inner].mean()
    assert error < 0.02 * dx
    rise = archive["height"].isel(time=[-2, -1]).diff("time") / archive["time"].diff("time")
    np.testing.assert_allclose(rise.isel(time=0), state.rise_velocity, rtol=1e-5)


def drum(*settings: str) -> tuple[float, float]:
    return drum_errors(continuum.pour(load("de-gennes-drum", ["pour.duration=200.0", *settings])))


@pytest.mark.parametrize("turning_rate", [0.05, 0.1, 0.3])
def test_the_drum_takes_de_gennes_shape_at_any_turning_rate(turning_rate: float) -> None:
    of_flow, of_slope = drum(f"cell.turning_rate={turning_rate}")
    assert of_flow < 2e-3
    assert of_slope < 2e-3


def test_the_drums_surface_converges_at_first_order() -> None:
    errors = [drum("cell.turning_rate=0.3", f"continuum.cells={n}") for n in (50, 100, 200)]
    assert_first_order([of_slope for _, of_slope in errors])


@pytest.mark.parametrize(("scheme", "allowed"), [("godunov", 0.01), ("muscl", 0.002)])
def test_a_drum_may_lift_more_than_a_surface_layer_in_a_step(scheme: str, allowed: float) -> None:
    """0.12 cm at the rim against d = 0.05 cm; all of it has to be released."""
    settings = ["cell.turning_rate=0.3", "continuum.cells=50", f"continuum.scheme={scheme}"]
    of_flow, of_slope = drum(*settings)
    assert of_flow < 2e-3
    assert of_slope < allowed


def test_the_drums_closed_form_is_its_own_slope() -> None:
    state = drum_of(load("de-gennes-drum"))
    x, small = np.linspace(-9.0, 9.0, 19), 1e-5
    slope = -(state.height(x + small) - state.height(x - small)) / (2 * small)
    np.testing.assert_allclose(slope, state.slope(x), rtol=1e-8)
    gain = (state.rolling_thickness(x + small) - state.rolling_thickness(x - small)) / (2 * small)
    np.testing.assert_allclose(state.velocity * gain, -state.turning_rate * x, atol=1e-8)


@pytest.mark.parametrize("setting", ["mixture.smoothing=0.1", "mixture.dispersion=1.0"])
def test_de_gennes_solutions_are_refused_where_they_do_not_hold(setting: str) -> None:
    with pytest.raises(NotApplicableError, match=setting.partition("=")[0]):
        silo_of(load("de-gennes-silo", [setting]))
