"""A pour as far as it has come is the shorter pour, and is measured as that is."""

import numpy as np
import pytest
import xarray as xr
from conftest import MODELS

from compare import measure
from compare.so_far import so_far
from experiment import load

THEN = 1500.0
Pours = tuple[xr.Dataset, xr.Dataset]


@pytest.fixture(scope="module", params=sorted(MODELS))
def pours(request: pytest.FixtureRequest) -> Pours:
    """One of 2400 s and one that ends after 1500."""
    setup = load("makse-stratification", ["continuum.cells=100"])
    whole, shorter = (
        setup.with_values({"pour.duration": duration, "pour.records": round(duration / 6)})
        for duration in (2400.0, THEN)
    )
    return MODELS[request.param].pour(whole), MODELS[request.param].pour(shorter)


def test_what_is_cut_is_the_shorter_pour(pours: Pours) -> None:
    whole, shorter = pours
    cut = so_far(whole, THEN)
    for name in ("time", "height", "rolling_thickness", "surface_fraction", "poured_volume"):
        np.testing.assert_array_equal(cut[name], shorter[name])


def test_its_deposit_differs_only_where_grains_were_taken_up_again(pours: Pours) -> None:
    whole, shorter = pours
    cut = so_far(whole, THEN)["deposit_fraction"].isel(species=0)
    cut, deposit = xr.align(cut, shorter["deposit_fraction"].isel(species=0), join="inner")
    there, lies = cut.notnull(), deposit.notnull()
    assert float((there != lies).sum()) < 0.002 * float(lies.sum())
    assert float((abs(cut - deposit) > 0.1).sum()) < 0.05 * float(lies.sum())


def test_it_is_measured_as_the_shorter_pour_is(pours: Pours) -> None:
    whole, shorter = pours
    cut, alone = measure(so_far(whole, THEN)), measure(shorter)
    assert cut["regime"].item() == alone["regime"].item() == "stratified"
    assert float(cut["kink_velocity"]) == float(alone["kink_velocity"])
    error = float(np.hypot(cut["wavelength_error"], alone["wavelength_error"]))
    assert float(cut["wavelength"]) == pytest.approx(float(alone["wavelength"]), abs=error)


@pytest.mark.parametrize("time", [-1.0, 0.0])
def test_before_the_first_layers_there_is_nothing_to_tell(pours: Pours, time: float) -> None:
    cut = so_far(pours[0], time)
    assert measure(cut)["regime"].item() == "unsettled"
    assert cut["time"][-1] == pours[0]["time"][1]


def test_at_the_end_it_is_the_whole(pours: Pours) -> None:
    whole = pours[0]
    assert measure(so_far(whole, float(whole["time"][-1]))).equals(measure(whole))
