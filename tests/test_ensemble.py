"""Predictions from uncertain inputs, and how layers scale: on answers that are known."""

import numpy as np
import pytest
import xarray as xr
from scipy.stats import spearmanr

from compare import (
    campaign,
    draw_scaling,
    draws,
    fit_wavelength,
    over_inflow,
    piles,
    piles_mean,
    predict,
)
from compare.ensemble import ranges, with_ranges
from compare.scaling import fit
from experiment import Experiment, SetupError, load

RANGES = {"mixture.psi": (0.1, 0.3), "mixture.collision_rate.0.1": (0.2, 10.0)}
NAMES = ("wavelength", "kink_velocity", "front_velocity")


def found(regime: list[str], **values: list[float]) -> xr.Dataset:
    """A campaign of one model, with `values` of each pour."""
    dims = ("model", "pour")
    table: dict[str, object] = {
        "regime": (dims, [regime]),
        "failure": (dims, [["" if word else "it broke" for word in regime]]),
    }
    for name in NAMES:
        told = {"units": "cm", "long_name": name}
        table[name] = (dims, [values.get(name, [1.0] * len(regime))], told)
        table[f"{name}_error"] = (dims, [values.get(f"{name}_error", [0.01] * len(regime))], told)
    for name in ("total_inflow", "drift_velocity", "collision_rate", "wavelength_of_velocities"):
        table[name] = (dims, [values.get(name, [1.0] * len(regime))], {"units": "1"})
    names = {"model_name": ("model", ["continuum"])}
    return xr.Dataset(table).assign_coords(names).set_xindex("model_name")


def test_draws_are_a_latin_hypercube_of_the_ranges_and_the_same_for_one_seed() -> None:
    experiment = with_ranges(load("makse-stratification"), RANGES)
    drawn, inputs = draws(experiment, 16)
    for key, (low, high) in RANGES.items():
        share = (inputs.sel(input_name=key).values - low) / (high - low)
        assert sorted((16 * share).astype(int)) == list(range(16)), "one in each sixteenth"
    assert abs(spearmanr(inputs.values).statistic) < 0.2
    for one, (psi, rate) in zip(drawn, inputs.values, strict=True):
        assert one.mixture.psi == pytest.approx(psi)
        assert one.mixture.collision_rate == ((1.0, rate), (0.1, 1.0))
        assert one.uncertain == {}
    again, same = draws(experiment, 16)
    assert again == drawn
    xr.testing.assert_identical(same, inputs)
    assert not np.array_equal(draws(experiment, 16, seed=1)[1], inputs)


def test_glass_and_sugar_tell_what_is_uncertain_of_them_and_it_survives_toml() -> None:
    experiment = load("glass-sugar")
    assert experiment.uncertain["mixture.psi"] == (0.1, 0.3)
    assert len(experiment.uncertain) == 5
    assert Experiment.from_toml(experiment.to_toml()) == experiment
    for one in draws(experiment, 3)[0]:
        assert 0.1 <= one.mixture.psi <= 0.3
        assert 0.027 <= one.mixture.surface_depth <= 0.08


@pytest.mark.parametrize(
    ("uncertain", "named"),
    [
        ({"mixture.psi": [0.3, 0.1]}, "psi = [0.3, 0.1]: the first should be less"),
        ({"mixture.psi": [0.1, 3.0]}, "mixture.psi = 3: it makes a repose slope of -2"),
        ({"mixture.colour": [0.1, 0.3]}, "no field 'colour'; allowed: collision_rate"),
        ({"mixture.grain_diameter.7": [0.1, 0.3]}, "mixture.grain_diameter.7: there is no '7'"),
        ({"mixture.psi": [0.1]}, "uncertain.mixture.psi[1]: missing"),
        ({"mixture.psi": [0.1, float("nan")]}, "uncertain.mixture.psi[1] = nan"),
        ({"pour.records": [10, 20]}, "pour.records = 10.0: it should be a valid integer"),
        ({"title": [0.1, 0.2]}, "title = 0.1: it should be a valid string"),
    ],
)
def test_a_range_that_cannot_be_is_refused_in_one_line(uncertain, named: str) -> None:
    tables = load("glass-sugar").model_dump(exclude_none=True)
    with pytest.raises(SetupError) as refusal:
        Experiment.parse(tables | {"uncertain": uncertain})
    assert named in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_where_nothing_is_uncertain_there_is_nothing_to_draw() -> None:
    with pytest.raises(SetupError, match="uncertain: missing"):
        draws(load("makse-stratification"), 4)


def test_ranges_are_read_and_what_is_none_is_refused() -> None:
    assert ranges(["mixture.psi=0.1:0.3", "cell.length = 2:3e1"]) == {
        "mixture.psi": (0.1, 0.3),
        "cell.length": (2.0, 30.0),
    }
    for text in (
        "mixture.psi",
        "mixture.psi=0.1",
        "=1:2",
        "a..b=1:2",
        "mixture.psi=1:2:3",
        "a=b:c",
    ):
        with pytest.raises(SetupError, match="KEY=LOW:HIGH"):
            ranges([text])


def test_a_prediction_counts_the_draws_that_stratify_and_no_others() -> None:
    """The quantiles of 0, 0.01 ... 1 in 101 draws; 20 have no layers, and 2 failed."""
    random = np.random.default_rng(0)
    order = random.permutation(101) / 100
    wavelength = [*order, *np.full(22, np.nan)]
    regime = ["stratified"] * 101 + ["mixed"] * 20 + [""] * 2
    kinks = [np.nan, *np.full(122, 3.0)]
    pours = found(regime, wavelength=wavelength, kink_velocity=kinks)
    unrelated = random.uniform(size=123)
    inputs = xr.DataArray(
        np.transpose([[*-order, *np.zeros(22)], unrelated]),
        dims=("pour", "input"),
        coords={"input_name": ("input", ["falls", "unrelated"])},
    ).set_xindex("input_name")
    told = predict(pours, inputs).sel(model_name="continuum")
    np.testing.assert_allclose(told["predicted_wavelength"], told["quantile"])
    assert told["predicted_wavelength_draws"] == 101
    assert told["predicted_kink_velocity_draws"] == 100
    assert (told["predicted_kink_velocity"] == 3.0).all()
    assert told["predicted_draws"] == 121
    falls, other = told["predicted_wavelength_follows"].values
    assert falls == pytest.approx(-1.0)
    assert abs(other) < 0.3
    for name in told.data_vars:
        assert told[name].attrs["units"]
        assert told[name].attrs["long_name"]


def test_without_layers_there_is_no_prediction_and_no_error() -> None:
    regime = ["segregated"] * 8
    pours = found(regime, wavelength=[np.nan] * 8)
    _, inputs = draws(with_ranges(load("makse-stratification"), RANGES), 8)
    told = predict(pours, inputs)
    assert told["predicted_wavelength"].isnull().all()
    assert told["predicted_wavelength_follows"].isnull().all()
    assert told["predicted_wavelength_draws"] == 0
    assert told["predicted_draws"] == 8
    assert piles_mean(pours)["piles_wavelength"].isnull().all()


def test_piles_differ_by_their_number_and_their_mean_has_a_standard_error() -> None:
    assert [one.pour.pile for one in piles(load("glass-sugar"), 3)] == [0, 1, 2]
    pours = found(["stratified"] * 4 + ["mixed"], wavelength=[1.0, 2.0, 3.0, 4.0, 99.0])
    told = piles_mean(pours)
    assert told["piles_wavelength"].item() == 2.5
    assert told["piles_wavelength_error"].item() == pytest.approx(np.sqrt(5 / 3 / 4))
    assert told["piles_wavelength_count"].item() == 4


def test_a_line_is_fitted_with_the_errors_that_it_has() -> None:
    """Pulls of slope and intercept have mean 0 and standard deviation 1; so has the bend's."""
    random = np.random.default_rng(1)
    x, errors = np.linspace(0.1, 0.8, 8), np.linspace(0.01, 0.05, 8)
    pulls = []
    for _ in range(1000):
        y = 1.0 + 2.0 * x + errors * random.standard_normal(8)
        line, bend = fit(x, y, errors), fit(x, y, errors, 2)
        pulls.append([*((line.values - [1.0, 2.0]) / line.errors), bend.values[2] / bend.errors[2]])
    np.testing.assert_allclose(np.mean(pulls, axis=0), 0.0, atol=0.1)
    np.testing.assert_allclose(np.std(pulls, axis=0), 0.92, atol=0.08)  # errors inflate, by chance


def test_a_bent_law_is_told_from_a_line_and_few_points_from_a_fit() -> None:
    x = np.linspace(0.1, 0.8, 8)
    bend = fit(x, 1.0 + 2.0 * x - 0.5 * x**2, np.full(8, 0.01), 2)
    np.testing.assert_allclose(bend.values, [1.0, 2.0, -0.5])
    assert bend.errors[2] < 0.1
    assert fit(x, 1.0 + 2.0 * x - 0.5 * x**2, np.full(8, 0.001)).chi2_dof > 10
    assert np.isnan(fit(x, np.where(x < 0.15, 1.0, np.nan), np.full(8, 0.1)).values).all()


def test_the_linear_law_of_a_campaign_is_recovered_by_inflow() -> None:
    """lambda = 1 + 2 R0 from five piles each; piles that do not stratify, or lay two pairs, do not
    count."""
    random = np.random.default_rng(2)
    inflow = np.repeat([0.1, 0.2, 0.4, 0.8], 7)
    scatter = 0.05 * random.standard_normal(28)
    wavelength = 1.0 + 2.0 * inflow + scatter
    cycle = wavelength.copy()
    odd, halved = np.arange(28) % 7 == 5, np.arange(28) % 7 == 6
    wavelength = np.where(odd, np.nan, np.where(halved, wavelength / 2, wavelength))
    pours = found(
        ["mixed" if one else "stratified" for one in odd],
        wavelength=wavelength.tolist(),
        wavelength_of_velocities=cycle.tolist(),
        total_inflow=inflow.tolist(),
        drift_velocity=[2.0] * 28,
        collision_rate=[10.0] * 28,
    )
    points = over_inflow(pours)
    assert points["total_inflow"].values.tolist() == [0.1, 0.2, 0.4, 0.8]
    assert (points["pours"] == 6).all()
    assert (points["one_pair"] == 5).all()
    np.testing.assert_allclose(points["exchange"], 10.0 * points["total_inflow"] / 2.0)
    scaled = points["wavelength"] / points["total_inflow"]
    np.testing.assert_allclose(points["wavelength_scaled"].values, scaled.values)
    line = fit_wavelength(points).sel(model_name="continuum")
    assert abs(line["slope"] - 2.0) < 3 * line["slope_error"] < 0.6
    assert abs(line["intercept"] - 1.0) < 3 * line["intercept_error"] < 0.3
    assert abs(line["curvature"]) < 3 * line["curvature_error"]
    titles = [axes.get_xlabel() for axes in draw_scaling(points).axes]
    assert titles == ["R0 (cm)", "v / v_k", "gamma R0 / v"]


def test_glass_and_sugar_are_predicted_to_lie_in_layers_of_a_centimetre() -> None:
    """The measured 1.2 cm is at the upper end; the depth of the surface layer matters most."""
    drawn, inputs = draws(load("glass-sugar"), 16)
    told = predict(campaign(drawn, ["continuum"], workers=1), inputs).isel(model=0)
    assert told["predicted_wavelength_draws"] == 16
    low, middle, high = told["predicted_wavelength"].sel(quantile=[0.05, 0.5, 0.95]).values
    assert 0.8 < low < 0.95
    assert 0.98 < middle < 1.1
    assert 1.1 < high < 1.3
    follows = told["predicted_wavelength_follows"]
    assert follows["input_name"][abs(follows).argmax("input")] == "mixture.surface_depth"
