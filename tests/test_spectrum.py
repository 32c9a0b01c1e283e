"""The spectrum of the steady pile: it is the kernel's own, and tells where waves begin."""

import numpy as np
import pytest

from compare.validation.waves import after, growth_of_noise
from continuum.kernel import advance
from continuum.theory import critical_delta, growth_rates, leading_growth_rate, spectrum_of
from continuum.theory.spectrum import step_of
from continuum.theory.steady_state import steady_state_of
from experiment import Experiment, NotApplicableError, load


def segregation(*settings: str) -> Experiment:
    """The preset on a coarse grid."""
    return load("makse-segregation", ["continuum.cells=100", *settings])


def test_the_steady_pile_has_the_closed_forms_rolling_thicknesses() -> None:
    experiment = load("makse-profile")
    steady = spectrum_of(experiment, 2)
    edges = steady.x + experiment.cell.length / len(steady.x) / 2
    closed = steady_state_of(experiment)
    np.testing.assert_allclose(steady.steady[:, :2], closed.rolling_thickness(edges), atol=1e-8)


def test_the_steady_pile_rises_without_change_for_a_thousand_steps() -> None:
    experiment = segregation("mixture.surface_depth=0.5")
    steady = spectrum_of(experiment, 2).steady
    np.testing.assert_allclose(after(step_of(experiment), steady, 1000), steady, atol=1e-8)


def test_what_lies_below_the_surface_does_not_matter() -> None:
    experiment = segregation()
    step, steady = step_of(experiment), spectrum_of(experiment, 2).steady
    empty, filled = step.flow(steady), step.flow(steady)
    filled.filling[1] = 1.0
    for flow in (empty, filled):
        advance(flow, step.law, step.grid, step.velocity, step.inflow[np.newaxis])
    assert (empty.filling.sum(axis=0) > 0).all()
    np.testing.assert_array_equal(filled.surface, empty.surface)
    np.testing.assert_array_equal(filled.height, empty.height)


@pytest.mark.parametrize("depth", [0.1, 0.5])
def test_the_leading_modes_are_those_of_all_modes(depth: float) -> None:
    experiment = segregation(f"mixture.surface_depth={depth}")
    step, found = step_of(experiment), spectrum_of(experiment, 4)
    factors = np.linalg.eigvals(step.jacobian(found.steady).toarray())
    expected = np.sort(np.log(np.abs(factors[np.abs(factors) > 1e-3])))[::-1] / step.grid.dt
    np.testing.assert_allclose(found.growth_rate.real, expected[:4], atol=1e-7)


def test_the_jacobian_is_the_differences_of_every_single_disturbance() -> None:
    """Cells that are disturbed together lie out of each other's reach."""
    experiment = segregation("continuum.cells=40")
    step, steady = step_of(experiment), spectrum_of(experiment, 2).steady
    jacobian = step.jacobian(steady).toarray()
    for k in range(steady.size):
        disturbed = np.zeros(steady.size)
        disturbed[k] = 1e-6
        disturbed = disturbed.reshape(steady.shape)
        change = (step(steady + disturbed) - step(steady - disturbed)) / 2e-6
        np.testing.assert_allclose(jacobian[:, k], change.ravel(), atol=1e-7)


@pytest.mark.parametrize(
    ("settings", "steps", "grows"),
    [(("mixture.delta=-0.1",), 60, True), (("mixture.surface_depth=0.5",), 400, False)],
)
def test_a_disturbance_in_a_pour_grows_or_decays_as_its_mode_says(
    settings: tuple[str, ...], steps: int, grows: bool
) -> None:
    experiment = segregation(*settings)
    step, found = step_of(experiment), spectrum_of(experiment, 2)
    sigma, mode = found.growth_rate[0], found.mode[0] / np.abs(found.mode[0]).max()
    assert (sigma.real > 0) == grows
    disturbance = after(step, found.steady + 1e-6 * mode.real, steps) - found.steady
    expected = 1e-6 * (mode * np.exp(sigma * steps * step.grid.dt)).real
    assert np.abs(disturbance - expected).max() < 0.01 * np.abs(expected).max()


@pytest.mark.parametrize(
    ("depth", "size", "steps"), [(0.1, 1e-9, 500), (0.5, 1e-6, 1500)], ids=["grows", "decays"]
)
def test_any_disturbance_comes_to_grow_or_decay_at_the_leading_rate(
    depth: float, size: float, steps: int
) -> None:
    """Measured over one beat of the wave, whose size pulsates."""
    settings = ("mixture.delta=-0.15", f"mixture.surface_depth={depth}")
    expected, found = growth_of_noise(segregation(*settings), size, steps)
    assert (found > 0) == (expected > 0)
    assert found == pytest.approx(expected, rel=0.03)


def test_waves_begin_where_full_runs_have_them() -> None:
    """Pours with d = 0.1 keep waves at delta = -0.1, none at -0.2, and none where d >= 0.5."""
    assert -0.2 < critical_delta(segregation(), (-0.2, -0.1)) < -0.1
    assert leading_growth_rate(segregation("mixture.surface_depth=0.5")).real < 0


def test_the_onset_of_waves_does_not_depend_on_the_grid() -> None:
    onsets = [
        critical_delta(segregation(f"continuum.cells={cells}"), (-0.19, -0.15))
        for cells in (203, 300)
    ]
    assert onsets[0] == pytest.approx(onsets[1], abs=0.01)


def test_a_single_species_lies_steady() -> None:
    one = (
        "mixture={names=['a'], grain_diameter=[0.1], drift_velocity=1.0, repose_slope=[[1.0]], "
        "collision_rate=[[1.0]]}"
    )
    rates = growth_rates(segregation(one, "feed.inflow=[1.0]", "cell.length=20.0"), 3)
    assert (np.diff(rates.real) <= 0).all()
    assert (rates.real < 0).all()


def test_three_species_that_segregate_have_a_steady_pile_too() -> None:
    """There is no closed form for them: a pour leads to it, and a step of theirs keeps it."""
    experiment = segregation(
        "mixture={names=['a','b','c'], grain_diameter=[0.05,0.1,0.15], drift_velocity=1.0, "
        "repose_slope=[[1.0,0.95,0.9],[0.8,0.75,0.7],[0.6,0.55,0.5]], "
        "collision_rate=[[1.0,0.1,0.1],[0.1,1.0,0.1],[0.1,0.1,1.0]]}",
        "feed.inflow=[0.3,0.3,0.3]",
        "cell.length=50.0",
    )
    found = spectrum_of(experiment, 2)
    assert found.growth_rate[0].real < 0
    rolling = found.steady[:, :3]
    np.testing.assert_allclose(rolling.sum(axis=1), 0.9 * (1 - (found.x + 0.25) / 50), atol=1e-8)


def test_without_an_onset_in_the_bracket_the_error_says_so() -> None:
    with pytest.raises(NotApplicableError, match=r"mixture\.delta: .* at 0 and .* at 0\.1"):
        critical_delta(segregation(), (0.0, 0.1))
