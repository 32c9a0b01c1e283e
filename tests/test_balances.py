"""Balances between deposit, kymograph and scales, on numbers that are known."""

import numpy as np
import pytest
import xarray as xr

from compare import measure
from compare.balances import Measured, balances, unbalanced, volume_residual
from compare.quantities import flux, rise_velocity, total_inflow
from compare.validation.drawn import archive_of, calm, stripes


@pytest.fixture
def archive() -> xr.Dataset:
    """A cell of 100 cm."""
    return archive_of(calm, stripes(1.0))


def test_each_balance_is_its_formula_with_its_error(archive: xr.Dataset) -> None:
    told = balances(
        archive,
        wavelength=Measured(3.0, 0.03),
        period=Measured(290.0, 5.8),
        front=Measured(0.8, 0.016),
        kink=Measured(0.5, 0.02),
    )
    rate, r0 = flux(archive), total_inflow(archive)
    assert told["wavelength_of_period"] == pytest.approx((2.9 * rate, 0.058 * rate))
    expected = rate * 3.25, rate * np.hypot(0.025, 0.08)
    assert told["wavelength_of_velocities"] == pytest.approx(expected)
    assert told["wavelength_of_kinks"] == pytest.approx((r0 + rate / 0.5, rate * 0.08))
    for name in ("period", "velocities", "kinks"):
        right, residual = told[f"wavelength_of_{name}"], told[f"{name}_residual"]
        ratio = 3.0 / right.value
        assert residual.value == pytest.approx(ratio - 1)
        assert residual.error == pytest.approx(ratio * np.hypot(0.01, right.error / right.value))


@pytest.mark.parametrize(
    ("value", "error", "told"),
    [
        (0.04, 0.001, False),
        (0.10, 0.05, False),
        (0.10, 0.02, True),
        (-0.10, 0.02, True),
        (0.30, 0.5, True),
        (np.nan, np.nan, False),
    ],
)
def test_a_residual_is_told_beyond_its_error_and_in_any_case_where_it_is_large(
    value: float, error: float, told: bool
) -> None:
    line = unbalanced(Measured(value, error))
    assert bool(line) == told
    assert not told or f"{value:+.0%}" in line


def test_the_volume_that_is_missing_is_the_largest_of_any_species(archive: xr.Dataset) -> None:
    volumes = archive.copy(deep=True)
    time = volumes["time"].values[:, None]
    volumes["poured_volume"].values[:] = time * [1.0, 2.0]
    volumes["deposited_volume"].values[:] = time * [1.0, 1.8]
    volumes["outflow_volume"].values[:] = time * [0.0, 0.1]
    assert volume_residual(volumes) == pytest.approx(0.05)
    assert measure(volumes)["volume_residual"].item() == pytest.approx(0.05)


def test_a_pile_rises_over_what_it_covers_less_what_fell_off(archive: xr.Dataset) -> None:
    assert rise_velocity(archive) == pytest.approx(flux(archive) / 100.0)
    half = archive.copy(deep=True)
    half["height"].values[:, 50:] = half["base_height"].values[50:]
    assert rise_velocity(half) == pytest.approx(flux(archive) / 50.0)
    lossy = archive.copy(deep=True)
    time = lossy["time"].values[:, None]
    lossy["poured_volume"].values[:] = time * [0.5, 0.5]
    lossy["outflow_volume"].values[:] = time * [0.1, 0.1]
    assert rise_velocity(lossy) == pytest.approx(0.8 * flux(archive) / 100.0)
