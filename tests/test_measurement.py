"""The instrument, on deposits whose answers are known, and the table and picture of it all."""

from collections.abc import Callable

import numpy as np
import pytest
import xarray as xr

from compare import compare, draw, fronts, kinks, layers, measure
from compare.quantities import settled_thickness, total_inflow
from compare.regimes import regime
from compare.table import as_records, table, with_error
from compare.validation.drawn import archive_of, calm, stripes
from experiment import ArchiveError


@pytest.mark.parametrize("wavelength", [0.7, 1.0, 1.6])
@pytest.mark.parametrize("share", [0.3, 0.5])
def test_the_wavelength_of_stripes_is_found(wavelength: float, share: float) -> None:
    found = layers(archive_of(calm, stripes(wavelength, share)))
    assert float(found["wavelength"]) == pytest.approx(wavelength, rel=0.02)
    assert float(found["wavelength_spread"]) < 0.03 * wavelength
    assert float(found["wavelength_normal"]) == pytest.approx(
        wavelength / np.hypot(1, 0.5), rel=0.02
    )


def test_equal_layers_of_pure_grains_have_strength_one_and_noise_has_none() -> None:
    pure = layers(archive_of(calm, stripes(1.0)))
    assert float(pure["layering"]) == pytest.approx(1.0, abs=0.05)
    random = np.random.default_rng(0)
    noise = layers(archive_of(calm, lambda above, x: random.uniform(size=above.shape) + 0 * x))
    assert float(noise["layering"]) < 0.15


def test_two_unlike_pairs_a_cycle_are_one_wavelength() -> None:
    def double(above: np.ndarray, x: np.ndarray) -> np.ndarray:
        phase = (above + 0 * x) % 1.6
        return ((phase > 0.2) & (phase < 0.8) | (phase > 1.2)).astype(float)

    found = layers(archive_of(calm, double))
    assert float(found["wavelength"]) == pytest.approx(1.6, rel=0.02)


def test_segregation_is_one_for_species_apart_and_zero_for_stripes() -> None:
    apart = archive_of(calm, lambda above, x: (x > 50) + 0 * above)
    assert float(apart.strata.layers()["segregation"]) == pytest.approx(1.0)
    assert float(archive_of(calm, stripes(0.73)).strata.layers()["segregation"]) < 0.1
    assert measure(apart)["regime"].item() == "segregated"


@pytest.mark.parametrize(
    ("layered", "apart", "thickness", "word"),
    [
        (0.9, 0.1, 20.0, "stratified"),
        (0.1, 0.9, 20.0, "segregated"),
        (0.6, 0.7, 20.0, "layered-and-segregated"),
        (0.1, 0.2, 20.0, "mixed"),
        (0.9, 0.1, 2.0, "unsettled"),
    ],
)
def test_a_regime_is_named_after_its_order_parameters(layered, apart, thickness, word) -> None:
    assert regime(layered, apart, thickness) == word


@pytest.fixture(scope="module")
def comparison(poured: Callable[..., xr.Dataset]) -> xr.Dataset:
    return compare([poured(model, "glass-sugar") for model in ("ca_model", "continuum")])


def test_a_comparison_has_both_models_scaled_and_the_published_values(comparison) -> None:
    assert comparison["model_name"].values.tolist() == ["ca_model", "continuum"]
    one = comparison.sel(model_name="continuum")
    assert one["wavelength_scaled"].item() == pytest.approx(one["wavelength"].item() / 0.25)
    assert one["kink_velocity_scaled"].item() == pytest.approx(one["kink_velocity"].item() / 10)
    assert one["cycle_period_scaled"].item() == pytest.approx(one["cycle_period"].item() / 3)
    assert comparison["published_wavelength"].item() == 1.2
    assert "flux is not stated" in comparison.attrs["comment"]
    for name in comparison.data_vars:
        assert comparison[name].attrs["long_name"]


def test_a_comparison_prints_as_a_table_and_as_plain_numbers(comparison) -> None:
    rows = table([comparison]).columns[0]
    assert "wavelength, vertical (cm)" in list(rows.cells)
    record = as_records(comparison)["ca_model"]
    assert record["regime"] == "stratified"
    assert isinstance(record["wavelength"], float)


@pytest.mark.parametrize(
    ("model", "preset", "settings"),
    [
        ("ca_model", "lattice-stratification", ["pour.duration=30.0"]),
        ("ca_model", "lattice-stratification", ["cell.length=3.0", "pour.duration=30.0"]),
        ("ca_model", "lattice-stratification", ["cell.length=3.0", "pour.records=1"]),
        ("continuum", "makse-stratification", ["pour.duration=5.0", "cell.start_slope=0.0"]),
        ("continuum", "makse-stratification", ["continuum.cells=3", "pour.records=3"]),
    ],
)
def test_a_pour_too_short_or_small_to_measure_gives_no_numbers_and_no_errors(
    poured, model: str, preset: str, settings: list[str]
) -> None:
    archive = poured(model, preset, *settings)
    found = measure(archive)
    assert np.isnan(found["wavelength"])
    if settled_thickness(archive) < 5 * total_inflow(archive):
        assert found["regime"].item() == "unsettled"
    draw([archive])


def test_archives_of_different_pours_are_not_set_side_by_side(poured) -> None:
    pair = [poured("ca_model", "lattice-stratification"), poured("continuum", "glass-sugar")]
    with pytest.raises(ArchiveError, match="different pours: their mixture"):
        compare(pair)


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (3.0213, 0.0123, "3.021 ± 0.012"),
        (854.2, 4.7, "854.2 ± 4.7"),
        (1.0, 1e-15, "1.0000 ± 0.0000"),
        (2.5, float("nan"), "2.5"),
        (float("nan"), 1.0, "-"),
    ],
)
def test_numbers_have_the_digits_that_their_error_warrants(value, error, text) -> None:
    assert with_error(value, error) == text


def test_a_picture_shows_every_archive_and_its_lines(poured) -> None:
    archives = [poured(model, "glass-sugar") for model in ("ca_model", "continuum")]
    figure = draw(archives)
    titles = {axes.get_title() for axes in figure.axes} - {""}
    assert titles == {
        f"{model}: {what}"
        for model in ("lattice", "continuum")
        for what in ("deposit", "rolling grains")
    }
    kymograph = next(
        axes for axes in figure.axes if axes.get_title() == "continuum: rolling grains"
    )
    events = kinks(archives[1]).sizes["event"] + fronts(archives[1]).sizes["event"]
    assert len(kymograph.lines) == events + 1
