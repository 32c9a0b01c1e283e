"""Layers of deposits that are drawn, so that all about them is known."""

import numpy as np
import pytest
import xarray as xr

from compare.deposit import layers_of
from compare.validation.drawn import LENGTH as WIDTH
from compare.validation.drawn import Field, deposit_of, parallel


def renewed(mean: float, scatter: float, seed: int) -> Field:
    """Cycles of independent thickness."""
    thickness = np.random.default_rng(seed).normal(mean, scatter, 200).clip(0.2 * mean)
    edges = np.concatenate([[0.0], np.cumsum(thickness)]) - 3 * mean
    return lambda above, x: np.interp(above + 0 * x, edges, np.arange(len(edges)))


def number(found: xr.Dataset, name: str) -> float:
    return float(found[name])


@pytest.mark.parametrize("wavelength", [0.6, 1.0, 1.9])
@pytest.mark.parametrize("share", [0.3, 0.5, 0.7])
@pytest.mark.parametrize("dip", [-0.02, 0.0, 0.03])
def test_both_estimators_find_the_wavelength_of_tilted_layers(wavelength, share, dip) -> None:
    found = layers_of(deposit_of(parallel(wavelength, dip), share=share))
    for name in ("wavelength", "wavelength_counted"):
        assert number(found, name) == pytest.approx(wavelength, rel=0.01)
    assert number(found, "inclination") == pytest.approx(0.5 + dip, abs=0.01)
    across = wavelength / np.hypot(1.0, 0.5 + dip)
    assert number(found, "wavelength_normal") == pytest.approx(across, rel=0.01)
    assert "comment" not in found.attrs


@pytest.mark.parametrize(
    ("noise", "grains"), [(0.2, False), (0.5, False), (0.1, True), (0.2, True)]
)
@pytest.mark.parametrize("share", [0.35, 0.6])
def test_noise_moves_no_boundary(noise: float, grains: bool, share: float) -> None:
    found = layers_of(deposit_of(parallel(1.2, 0.01), share=share, noise=noise, grains=grains))
    assert number(found, "wavelength") == pytest.approx(1.2, rel=0.01)
    assert number(found, "wavelength_counted") == pytest.approx(1.2, rel=0.01)
    assert number(found, "thickness_small") == pytest.approx(1.2 * share, abs=0.05)
    assert number(found, "thickness_large") == pytest.approx(1.2 * (1 - share), abs=0.05)
    assert number(found, "inclination") == pytest.approx(0.51, abs=0.01)
    assert "comment" not in found.attrs


def test_sublayers_add_up_to_the_wavelength() -> None:
    found = layers_of(deposit_of(parallel(1.5), share=0.3))
    small, large = number(found, "thickness_small"), number(found, "thickness_large")
    assert small == pytest.approx(0.45, abs=0.02)
    assert small + large == pytest.approx(number(found, "wavelength_counted"))


@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_a_wavelength_that_changes_along_the_slope_drifts(noise: float) -> None:
    """From 1 cm at the top to 1.2 cm at the wall: 0.2 cm in 100."""
    found = layers_of(deposit_of(lambda above, x: (above - 15.0) / (1.0 + 0.002 * x), noise=noise))
    assert number(found, "wavelength") == pytest.approx(1.1, rel=0.03)
    assert number(found, "wavelength_drift") == pytest.approx(0.002, rel=0.1)
    assert number(found, "wavelength_drift") > 5 * number(found, "wavelength_drift_error")
    assert float(found["wavelength_at"][-5]) > float(found["wavelength_at"][5]) + 0.15
    assert np.isnan(number(found, "wavelength_step_x"))


def test_layers_of_one_thickness_do_not_drift() -> None:
    found = layers_of(deposit_of(parallel(1.1), noise=0.3))
    assert abs(number(found, "wavelength_drift")) < 3 * number(found, "wavelength_drift_error")


def test_cycles_that_thicken_as_the_pile_grows_have_their_mean_and_their_spread() -> None:
    """From 0.9 to 1.3 cm over the deposit: a chirp."""

    def chirp(above: np.ndarray, x: np.ndarray) -> np.ndarray:
        return 15.0 / 0.4 * np.log(0.9 + 0.4 * np.clip(above + 0 * x, -5, 20) / 15.0)

    found = layers_of(deposit_of(chirp))
    mean = 0.4 / np.log(1.3 / 0.9)
    assert number(found, "wavelength_counted") == pytest.approx(mean, rel=0.03)
    assert number(found, "wavelength") == pytest.approx(mean, rel=0.06)
    assert 0.08 < number(found, "wavelength_spread") < 0.2


@pytest.mark.parametrize("seed", range(3))
def test_dislocations_do_not_change_the_wavelength(seed: int) -> None:
    """Layers that end within the deposit: the blocks between slip by any part of a wavelength."""
    slips = np.random.default_rng(seed).uniform(size=6)

    def slipped(above: np.ndarray, x: np.ndarray) -> np.ndarray:
        return above / 1.3 + slips[(x / WIDTH * 6).astype(int)]

    found = layers_of(deposit_of(slipped, noise=0.2))
    assert number(found, "wavelength") == pytest.approx(1.3, rel=0.02)
    assert number(found, "wavelength_counted") == pytest.approx(1.3, rel=0.02)
    assert "comment" not in found.attrs


def test_two_unlike_pairs_a_cycle_are_one_wavelength_and_are_told() -> None:
    def paired(above: np.ndarray, x: np.ndarray) -> np.ndarray:
        phase = (above + 0 * x) / 1.6 % 1.0
        return np.where((phase > 0.12) & (phase < 0.45) | (phase > 0.75), 0.9, 0.1)

    found = layers_of(deposit_of(paired))
    assert number(found, "wavelength") == pytest.approx(1.6, rel=0.01)
    assert number(found, "wavelength_counted") == pytest.approx(1.6, rel=0.02)
    assert number(found, "pairs_a_cycle") == 2
    assert "2 pairs of layers" in found.attrs["comment"]


@pytest.mark.parametrize("ratio", [2, 3])
def test_short_layers_above_and_long_ones_below_are_two_wavelengths(ratio: int) -> None:
    """Dual stratification: below x = 60 every second or third layer is missing."""
    found = layers_of(
        deposit_of(lambda above, x: above / np.where(x < 60, 0.8, 0.8 * ratio), thickness=20.0)
    )
    assert number(found, "wavelength_upper") == pytest.approx(0.8, rel=0.03)
    assert number(found, "wavelength_lower") == pytest.approx(0.8 * ratio, rel=0.03)
    assert number(found, "wavelength_step_x") == pytest.approx(60, abs=3)
    assert "two wavelengths" in found.attrs["comment"]


def test_estimators_that_do_not_agree_say_so() -> None:
    """A cycle of five pairs, of which two are too faint to count."""
    random = np.random.default_rng(5)
    inner = np.cumsum(random.uniform(0.5, 1.5, 5))
    edges = np.concatenate([[0.0], inner / inner[-1]])

    def uneven(above: np.ndarray, x: np.ndarray) -> np.ndarray:
        cycle = (above + 0 * x) / 3.0 % 1.0
        pair = np.interp(cycle, edges, np.arange(6)) % 1.0
        weak = cycle < edges[2]
        return np.where(pair > 0.5, np.where(weak, 0.66, 0.9), np.where(weak, 0.55, 0.1))

    found = layers_of(deposit_of(uneven, thickness=20.0))
    assert number(found, "pairs_a_cycle") > 1 or "do not agree" in found.attrs["comment"]
    assert "comment" in found.attrs


def test_noise_has_no_layers_and_one_kind_of_grain_has_none() -> None:
    random = np.random.default_rng(0)
    for noise in (
        lambda above, x: random.uniform(size=(above + x).shape),
        lambda above, x: 0 * above + 0.9 + 0 * x,
        lambda above, x: np.where(x < 50, 0.1, 0.9) + 0 * above,
    ):
        found = layers_of(deposit_of(noise))
        assert number(found, "layering") < 0.15
        if number(found, "layering") == 0:
            assert np.isnan(number(found, "wavelength"))


def test_equal_layers_of_pure_grains_have_strength_one() -> None:
    assert number(layers_of(deposit_of(parallel(1.0))), "layering") == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("columns", [120, 600])
def test_ragged_layers_in_narrow_columns_are_layers_and_random_grains_are_none(columns) -> None:
    """Two grains of ten are misplaced, in columns as wide as a sublayer and a fifth of that."""
    x = (np.arange(columns) + 0.5) * WIDTH / columns
    z = np.arange(0.1, 66.0, 0.2)
    above = z[:, None] - 0.5 * (WIDTH - x)
    inside = (above > 0) & (above < 15.0)
    random = np.random.default_rng(2).uniform(size=above.shape)
    layered = np.where(random < 0.2, above / 1.6 % 1.0 < 0.5, above / 1.6 % 1.0 > 0.5)
    for large, some in ((layered, True), (random > 0.5, False)):
        coarse = np.where(inside, large, np.nan)
        found = layers_of(xr.DataArray(coarse, {"z": z, "x": x}, ("z", "x")))
        assert (number(found, "layered_share") > 0.5) == some
        assert (number(found, "layered_share") < 0.05) != some


def test_what_alternates_grain_by_grain_is_no_layer() -> None:
    deposit = deposit_of(parallel(0.4))
    assert number(layers_of(deposit), "wavelength") == pytest.approx(0.4, rel=0.02)
    assert np.isnan(number(layers_of(deposit, grain=0.15), "wavelength"))


def test_a_bare_toe_hides_no_layers() -> None:
    """Of a growing heap, whose lowest columns have only just been reached."""
    whole = deposit_of(parallel(1.2), noise=0.2)
    growing = whole.where(whole["z"] > 0.5 * (WIDTH - whole["x"]) + 0.18 * whole["x"])
    found = layers_of(growing)
    assert number(found, "wavelength") == pytest.approx(1.2, rel=0.02)
    assert number(found, "wavelength_counted") == pytest.approx(1.2, rel=0.03)
    assert number(found, "layering") > 0.7


@pytest.mark.parametrize("scatter", [0.3, 0.4, 0.5])
def test_irregular_cycles_give_their_mean_or_say_that_the_estimators_differ(scatter) -> None:
    """A longer lag that fits by chance is not told as a cycle of several pairs."""
    wrong = []
    for seed in range(12):
        found = layers_of(deposit_of(renewed(1.2, 1.2 * scatter, seed), noise=0.1, seed=seed))
        off = abs(number(found, "wavelength") - 1.2) / number(found, "wavelength_error")
        if off > 4 and "do not agree" not in found.attrs.get("comment", ""):
            wrong.append(number(found, "wavelength"))
    assert len(wrong) <= 1, "a deposit of a dozen cycles may repeat itself by chance"


def test_two_wavelengths_that_have_no_common_one_are_not_told_as_their_multiple() -> None:
    found = layers_of(
        deposit_of(lambda above, x: above / np.where(x < 50, 1.0, 1.5), thickness=20.0)
    )
    assert 1.0 <= number(found, "wavelength") <= 1.55
    assert number(found, "wavelength_upper") == pytest.approx(1.0, rel=0.03)
    assert number(found, "wavelength_lower") == pytest.approx(1.5, rel=0.03)


def test_parts_of_the_slope_that_differ_are_an_error() -> None:
    """Every cycle is alike, but from 1 cm at the top to 1.2 cm at the wall."""
    found = layers_of(deposit_of(lambda above, x: (above - 15.0) / (1.0 + 0.002 * x)))
    assert 0.02 < number(found, "wavelength_counted_error") < 0.06


def test_half_of_what_the_estimators_differ_by_is_an_error() -> None:
    for seed in range(6):
        found = layers_of(deposit_of(renewed(1.2, 0.5, seed), seed=seed))
        apart = abs(number(found, "wavelength") - number(found, "wavelength_counted"))
        assert number(found, "wavelength_error") >= apart / 2


def test_zones_begin_and_end_at_edges_of_columns() -> None:
    found = layers_of(deposit_of(lambda above, x: np.where(x < 40, 0.1, 0.9) + 0 * above))
    told = [number(found, f"zone_{name}") for name in ("small_begin", "small_end")]
    assert told == pytest.approx([0.0, 40.0])
    told = [number(found, f"zone_{name}") for name in ("large_begin", "large_end")]
    assert told == pytest.approx([40.0, 100.0])
    assert np.isnan(number(found, "zone_layered_begin"))
    assert number(found, "pure_share") == 1.0
    assert number(found, "segregation") == pytest.approx(1.0)


def test_thin_sublayers_and_coarse_cells_are_remarked() -> None:
    thin = layers_of(deposit_of(parallel(1.2), share=0.06))
    assert "cannot be told" in thin.attrs["comment"]
    coarse = deposit_of(parallel(1.2)).isel(z=slice(None, None, 8))
    assert "cells of the deposit" in layers_of(coarse).attrs["comment"]


def test_errors_of_inclination_and_of_what_lies_across_follow_from_the_deposit() -> None:
    """Layers that fan out are not of one slope: the error grows, and that across with it."""
    straight = layers_of(deposit_of(parallel(1.2), noise=0.2))
    fanned = layers_of(
        deposit_of(lambda above, x: (above + 0.0008 * (x - 50) ** 2) / 1.2, noise=0.2)
    )
    assert number(straight, "inclination_error") < 0.004
    assert 0.005 < number(fanned, "inclination_error") < 0.05
    for found in (straight, fanned):
        slope = number(found, "inclination")
        along = number(found, "wavelength_error") / np.hypot(1, slope)
        turned = number(found, "wavelength") * slope / np.hypot(1, slope) ** 3
        expected = np.hypot(along, turned * number(found, "inclination_error"))
        assert number(found, "wavelength_normal_error") == pytest.approx(expected)


def test_errors_are_those_of_cycles_that_scatter() -> None:
    """Over 40 deposits of cycles 1 +- 0.15 cm, deviations over errors are of order one."""
    pulls, count_pulls = [], []
    for seed in range(40):
        found = layers_of(deposit_of(renewed(1.0, 0.15, seed), noise=0.2, seed=seed))
        pulls.append((number(found, "wavelength") - 1.0) / number(found, "wavelength_error"))
        count_pulls.append(
            (number(found, "wavelength_counted") - 1.0) / number(found, "wavelength_counted_error")
        )
        assert number(found, "wavelength_spread") == pytest.approx(0.15, abs=0.09)
    for pull in (pulls, count_pulls):
        assert 0.6 < np.sqrt(np.mean(np.square(pull))) < 1.6


def test_a_deposit_of_one_column_or_none_gives_no_numbers_and_no_errors() -> None:
    deposit = deposit_of(parallel(1.0))
    for part in (deposit.isel(x=[40]), deposit.where(False)):
        found = layers_of(part)
        assert set(found.data_vars) == set(layers_of(deposit).data_vars)
    assert number(layers_of(deposit.isel(x=[40])), "wavelength") == pytest.approx(1.0, rel=0.02)


def test_every_number_has_its_unit_and_its_meaning() -> None:
    for name, variable in layers_of(deposit_of(parallel(1.0))).data_vars.items():
        assert variable.attrs["units"] in ("cm", "1"), name
        assert variable.attrs["long_name"]
