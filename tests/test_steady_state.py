"""The steady state of section III: its closed form, and the solver's way to it."""

from collections.abc import Callable

import numpy as np
import pytest
import xarray as xr

from compare.validation.steady import CELLS, mixing_length, orders_of, slope_error, unbalanced
from continuum.theory import steady_state_of
from experiment import NotApplicableError, load


def test_the_closed_form_has_the_numbers_of_the_profile_figure() -> None:
    state = steady_state_of(load("makse-profile"))
    assert (state.mixing_length, state.middle) == pytest.approx((2.5, 12.5))
    x = np.array([0.0, np.nextafter(12.5, 0), 12.5])
    assert state.slope(x) == pytest.approx([0.5111, 0.4, 0.4], abs=5e-5)
    phi_1 = state.surface_fraction(np.array([15.0, 17.5, 20.0, 25.0]))[:, 0]
    assert phi_1 == pytest.approx([0.3844, 0.1299, 0.0409, 0.0034], abs=5e-5)


def test_the_closed_form_satisfies_the_equations_it_came_from() -> None:
    """v dR_a/dx = -(v R0/L) phi_a in both regions, and all that was fed is at rest at the end."""
    state = steady_state_of(load("makse-profile"))
    x = np.linspace(0.0, 29.9, 4001)
    slope = np.gradient(state.rolling_thickness(x), x, axis=0)
    expected = -state.total_inflow / state.length * state.surface_fraction(x)
    smooth = np.abs(x - state.middle) > 0.1
    np.testing.assert_allclose(slope[smooth], expected[smooth], atol=2e-5)
    fine = np.linspace(0.0, 30.0, 200_001)
    laid = np.trapezoid(state.surface_fraction(fine)[:, 0], fine)
    assert laid == pytest.approx(15.0, rel=1e-4)


def test_the_closed_form_leaves_nothing_of_the_exchange_unbalanced() -> None:
    """phi_a dh/dt = -Gamma_a, by the kernel's own law of exchange."""
    assert unbalanced(steady_state_of(load("makse-profile"))) < 1e-13


@pytest.fixture(scope="module")
def profiles(poured: Callable[..., xr.Dataset]) -> dict[int, xr.Dataset]:
    return {
        cells: poured("continuum", "makse-profile", f"continuum.cells={cells}").isel(time=-1)
        for cells in CELLS
    }


def test_rolling_thicknesses_reach_the_closed_form_at_the_cells_edges(profiles) -> None:
    """To 1e-6 of R0 where x_m lies on an edge; elsewhere the cell it lies in errs by O(dx^2)."""
    state = steady_state_of(load("makse-profile"))
    for cells, allowed in ((300, 1e-8), (150, 1e-4), (75, 1e-4)):
        edges = profiles[cells]["x"].values + 15.0 / cells
        error = profiles[cells]["rolling_thickness"].values - state.rolling_thickness(edges)
        assert np.abs(error).max() < allowed * state.total_inflow


def test_composition_reaches_the_closed_form(profiles) -> None:
    state = steady_state_of(load("makse-profile"))
    for cells in CELLS:
        expected = state.surface_fraction(profiles[cells]["x"].values)
        error = np.abs(profiles[cells]["surface_fraction"].values - expected)
        assert error.max() < 1e-3


def test_the_slope_converges_to_the_closed_form_at_first_order(profiles) -> None:
    errors = [slope_error(profiles[cells]) for cells in CELLS]
    orders = orders_of(errors)
    assert errors[-1] < 7e-4
    assert ((orders > 0.85) & (orders < 1.2)).all(), (errors, orders)


def test_muscl_reaches_the_closed_form_at_second_order(poured: Callable[..., xr.Dataset]) -> None:
    """Also across x_m, where the slope has a corner."""
    settings = [("continuum.scheme=muscl", f"continuum.cells={cells}") for cells in CELLS]
    found = [poured("continuum", "makse-profile", *chosen).isel(time=-1) for chosen in settings]
    errors = [slope_error(profile) for profile in found]
    orders = orders_of(errors)
    assert errors[-1] < 3e-5
    assert (orders > 1.8).all(), (errors, orders)


def test_species_mix_over_v_over_gamma_psi(profiles) -> None:
    assert mixing_length(profiles[300]) == pytest.approx(2.5, rel=1e-6)


@pytest.mark.parametrize(
    ("setting", "named"),
    [
        ("mixture.drift_velocity=[10.0, 5.0]", "drift_velocity"),
        ("mixture.collision_rate=[[20.0, 1.0], [1.0, 10.0]]", "gamma_11 = gamma_22"),
        ("mixture.m1=0.3", "theta_12 - theta_11"),
        ("mixture.psi=-0.1", "psi"),
        ("mixture.dispersion=0.1", "dispersion"),
        ("mixture.smoothing=0.1", "smoothing"),
        ("feed.inflow=[0.01, 0.24]", "x_m = -1.3"),
    ],
)
def test_set_ups_without_a_closed_form_are_told_so(setting: str, named: str) -> None:
    with pytest.raises(NotApplicableError) as refusal:
        steady_state_of(load("makse-profile", [setting]))
    assert named in str(refusal.value)
