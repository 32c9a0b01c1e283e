"""Theory as code: simplified forms, collision matrix, perturbation, and where closed forms end."""

import numpy as np
import pytest
from flows import law_with

from compare import layers
from compare.validation.waves import faint_flow
from continuum import pour
from continuum.theory import (
    SimplifiedSteadyState,
    collision_matrix,
    minimal_model_of,
    perturbation_of,
    silo_of,
    steady_state_of,
)
from experiment import NotApplicableError, load
from experiment.law import interaction


def test_the_simplified_forms_have_the_numbers_that_the_papers_figure_shows() -> None:
    """And their faults: twice too much at 25 cm, and a jump of theta at x_m."""
    state = SimplifiedSteadyState.of(steady_state_of(load("makse-profile")))
    x = np.array([15.0, 17.5, 20.0, 25.0])
    assert state.surface_fraction(x)[:, 0] == pytest.approx(
        [0.3679, 0.1353, 0.0498, 0.0067], abs=5e-5
    )
    before, after = state.slope(np.array([np.nextafter(12.5, 0), 12.5]))
    assert after - before == pytest.approx(-10.0 / (20.0 * 17.5), rel=1e-6)


def test_the_simplified_forms_are_those_of_a_short_mixing_length() -> None:
    """Their error is O(r / L): it falls tenfold as r does."""
    errors = []
    for rate in (200.0, 2000.0):
        rates = f"mixture.collision_rate=[[{rate}, {rate / 2}], [{rate / 2}, {rate}]]"
        full = steady_state_of(load("makse-profile", [rates]))
        simple = SimplifiedSteadyState.of(full)
        x = full.middle + np.linspace(0.0, 5.0, 50) * full.mixing_length
        errors.append(np.abs(simple.surface_fraction(x) - full.surface_fraction(x)).max())
    assert errors[1] == pytest.approx(errors[0] / 10, rel=0.15)


def test_the_simplified_forms_need_equal_volumes() -> None:
    state = steady_state_of(load("makse-profile", ["feed.inflow=[0.15, 0.1]"]))
    with pytest.raises(NotApplicableError, match=r"feed\.inflow = \[0\.15, 0\.1\]"):
        SimplifiedSteadyState.of(state)


@pytest.mark.parametrize("smoothing", [0.0, 0.1])
def test_the_collision_matrix_times_the_flow_is_the_exchange(smoothing: float) -> None:
    random = np.random.default_rng(3)
    mu = np.array([[0, 0.3, 0.1], [0.2, 0, 0.4], [0.5, 0.6, 0]])
    law = law_with(3, smoothing=smoothing, cross_amplification=mu)
    rolling = random.uniform(0, 1, (3, 40))
    phi = random.dirichlet(np.ones(3), 40).T
    slope = random.uniform(0.4, 1.8, 40)
    product = np.einsum("abi,bi->ai", collision_matrix(phi, slope, law), rolling)
    np.testing.assert_allclose(product, interaction(rolling, phi, slope, law), rtol=1e-12)


def test_the_perturbation_solves_its_equation_and_its_slope_is_the_steady_one() -> None:
    state = steady_state_of(load("makse-profile", ["mixture.delta=0.1"]))
    patch, small = perturbation_of(state), 1e-5
    x, time = np.linspace(2.0, 12.0, 6), 0.3

    def flow(x: np.ndarray, time: float) -> np.ndarray:
        return patch.rolling_thickness(x, time)

    change = (flow(x, time + small) - flow(x, time - small)) / (2 * small)
    drift = (flow(x + small, time) - flow(x - small, time)) / (2 * small)
    lost = patch.loss_rate(x) * flow(x, time)
    np.testing.assert_allclose(change, -10.0 * drift - lost, rtol=1e-6)
    np.testing.assert_allclose(patch.loss_rate(x), 20.0 * (state.theta_22 - state.slope(x)))


@pytest.mark.parametrize("delta", [-0.25, -0.1, -0.05])
def test_a_patch_is_caught_below_where_the_steady_slope_is_its_repose_slope(delta: float) -> None:
    state = steady_state_of(load("makse-segregation", [f"mixture.delta={delta}"]))
    patch = perturbation_of(state)
    highest = np.array([patch.highest_capture])
    assert 0 < highest < state.middle
    assert patch.loss_rate(highest) == pytest.approx(0.0, abs=1e-12)
    assert state.slope(highest) == pytest.approx(state.theta_22)


def test_a_patch_of_rougher_grains_is_caught_all_along_the_slope() -> None:
    patch = perturbation_of(steady_state_of(load("makse-stratification")))
    assert patch.highest_capture == 0.0


@pytest.mark.parametrize(
    "settings",
    [
        ["mixture.delta=-0.1"],
        ["mixture.delta=-0.05"],
        ["mixture.delta=-0.2", "mixture.psi=0.5"],
        ["mixture.delta=-0.15", "mixture.cross_rate=0.5"],
    ],
)
def test_no_layers_begin_above_where_a_patch_would_be_caught(settings: list[str]) -> None:
    """In all of some 400 pours of the phase diagrams; the four here are among them."""
    experiment = load("makse-segregation", ["continuum.cells=200", "pour.records=60", *settings])
    patch = perturbation_of(steady_state_of(experiment))
    found = layers(pour(experiment))
    assert found["layered_share"] > 0.2
    assert patch.highest_capture <= found["zone_layered_begin"] < 60.0


@pytest.mark.parametrize("delta", [0.1, 0.02])
def test_a_faint_flow_of_large_grains_over_their_own_kind_fades_as_the_perturbation(delta) -> None:
    """On the slope of the steady state, which so little does not change: first order in dx."""
    experiment = load("makse-profile", [f"mixture.delta={delta}"])
    patch, errors = perturbation_of(steady_state_of(experiment)), []
    for cells in (100, 200, 400):
        edges, rolling = faint_flow(experiment, patch, cells, 0.6)
        errors.append(np.abs(rolling / patch.rolling_thickness(edges, 0.6) - 1).mean())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (orders > 0.9).all(), (errors, orders)
    assert errors[-1] < 0.005


@pytest.mark.parametrize(
    ("closed_form", "preset", "setting", "named"),
    [
        (steady_state_of, "makse-profile", "cell.end=open", "cell.end: wall"),
        (steady_state_of, "makse-profile", "cell.shape=heap", "cell.shape: silo"),
        (silo_of, "de-gennes-silo", "cell.end=open", "cell.end: wall"),
        (silo_of, "glass-sugar", "cell.end=wall", "mixture: one species"),
        (silo_of, "de-gennes-drum", "cell.end=wall", "cell.shape: silo"),
        (minimal_model_of, "bdg-minimal", "mixture.smoothing=0.1", "mixture.smoothing: 0"),
        (
            minimal_model_of,
            "bdg-minimal",
            "mixture.repose_slope.0.1=0.7",
            "mixture.repose_slope: the same",
        ),
        (
            steady_state_of,
            "makse-profile",
            "feed.schedule={kind='sine', period=1.0, amplitude=[0.1, 0.1]}",
            "feed.schedule: constant",
        ),
    ],
)
def test_a_closed_form_says_where_it_does_not_hold(closed_form, preset, setting, named) -> None:
    with pytest.raises(NotApplicableError, match=named):
        closed_form(load(preset, [setting]))
