"""The bridge: grains at the continuum's rates come to the continuum; what the studies write."""

import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from compare.bridge import STUDIES, Study
from compare.bridge.ensembles import means_over_piles, pour_piles, with_own_errors
from compare.bridge.limit import CAUSES, lattice, limit, power_law
from compare.bridge.limit_table import limit_table
from compare.bridge.record import study_record
from compare.cli import main
from compare.convergence import QUANTITIES
from compare.pictures.bridge.limit import draw_limit
from experiment.archive.storage import read_whole

COARSE, FINE, WIDTH = 4, 64, 0.5
SEEDS = 3
ERRORS, PERCENT = 4.0, 4.0


def unheard(_: float) -> None:
    """What progress is told to."""


@pytest.fixture(scope="module")
def small() -> xr.Dataset:
    """Two sizes of grains in a few piles each, a deeper layer, and coarse grids."""
    return limit(
        SEEDS,
        1,
        unheard,
        plan={WIDTH: (COARSE, FINE)},
        causes={"d: twice": CAUSES["d: twice"]},
        grids=(25, 50, 100),
        examples=(FINE,),
    )


def differences(means: xr.Dataset, continuum: xr.Dataset) -> dict[str, float]:
    """By how many percent each quantity differs from the continuum's on the same grid."""
    return {
        name: 100 * float(means[name] / continuum[f"{name}_continuum"].item() - 1)
        for name in QUANTITIES
    }


def is_the_continuum(means: xr.Dataset, continuum: xr.Dataset) -> bool:
    """Within ERRORS standard errors, and within so many PERCENT, of all three quantities."""
    return all(
        abs(percent) < PERCENT
        and abs(percent) < 100 * ERRORS * float(means[f"{name}_error"] / means[name])
        for name, percent in differences(means, continuum).items()
    )


def test_ever_smaller_grains_come_to_the_continuum_on_their_grid(small: xr.Dataset) -> None:
    coarse, fine = (small.isel(width=0).sel(fineness=n) for n in (COARSE, FINE))
    assert is_the_continuum(fine, small)
    assert not is_the_continuum(coarse, small)
    far = differences(coarse, small)
    assert far["wavelength"] > 10
    assert max(far["kink_velocity"], far["front_velocity"]) < -5
    for name, percent in differences(fine, small).items():
        assert abs(percent) < abs(far[name]) / 4


@pytest.mark.parametrize("broken", [{"ca_model.amplification": 0.0}, {"ca_model.sharpness": 2.0}])
def test_another_rule_does_not_come_to_the_continuum(small: xr.Dataset, broken) -> None:
    found = pour_piles([lattice(FINE, WIDTH).with_values(broken)], SEEDS, workers=1)
    assert not is_the_continuum(means_over_piles(found).isel(setup=0), small)


def test_in_a_layer_of_more_grains_these_matter_less(small: xr.Dataset) -> None:
    """Twice as deep, with grains between the coarse and the fine: the wavelength is 3 % off."""
    there = small.isel(cause=0)
    off = there["cause_wavelength"] / there["cause_wavelength_continuum"] - 1
    assert 0 < off < 0.05


def test_a_finer_unit_for_the_same_grains_changes_nothing() -> None:
    """What counts is the grain, not in what its height is told."""
    coarse = lattice(COARSE, WIDTH).with_values({"pour.duration": 300.0, "pour.records": 60})
    fine = coarse.with_values({"ca_model.unit": min(coarse.mixture.grain_diameter) / 4})
    one, other = (pour_piles([setup], 1, workers=1) for setup in (coarse, fine))
    for name in ("kink_velocity", "front_velocity", "cycle_period"):
        np.testing.assert_allclose(one[name], other[name], rtol=1e-9)


def test_the_law_of_the_difference_is_found_with_its_errors() -> None:
    u, error = 0.5 ** np.arange(7), np.full(7, 0.01)
    exact = power_law(u, 0.3 * u**0.8 - 0.05, error)
    np.testing.assert_allclose(exact.values, [0.3, 0.8, -0.05], rtol=1e-5)
    assert exact.chi2_dof < 1e-6
    numbers = np.random.default_rng(1)
    found = np.array(
        [power_law(u, 0.3 * u**0.8 - 0.05 + error * numbers.normal(size=7), error).values
         for _ in range(400)]
    )  # fmt: skip
    np.testing.assert_allclose(found.std(axis=0), exact.errors, rtol=0.25)
    scattered = power_law(u, 0.3 * u**0.8 + 0.1 * numbers.normal(size=7), error)
    assert scattered.chi2_dof > 5
    assert (scattered.errors > 3 * exact.errors).all()


def test_a_law_of_three_numbers_is_not_told_from_four_sizes() -> None:
    u = 0.5 ** np.arange(7)
    few = np.where(u > 0.1, 0.3 * u, np.nan)
    told = power_law(u, few, np.full(7, 0.01))
    assert np.isnan([*told.values, *told.errors, told.chi2_dof]).all()


def test_no_law_is_told_where_the_difference_is_within_its_error() -> None:
    u = 0.5 ** np.arange(5)
    within = 0.01 * np.array([-0.6, -1.0, -0.6, -0.4, -0.1])
    assert np.isnan(power_law(u, within, np.full(5, 0.01)).values).all()


def test_piles_without_layers_do_not_count_in_a_mean() -> None:
    regime = [["stratified", "mixed", "layered-and-segregated"], ["mixed", "mixed", "stratified"]]
    values = [[1.0, 50.0, 3.0], [7.0, 8.0, 9.0]]
    attributes = {"units": "cm", "long_name": "of a test"}
    dims = ("setup", "pile")
    piles = xr.Dataset({"regime": (dims, np.array(regime))}).assign(
        {name: (dims, np.array(values), attributes) for name in QUANTITIES}
    )
    told = means_over_piles(piles)
    np.testing.assert_allclose(told["wavelength"], [2.0, 9.0])
    np.testing.assert_allclose(told["wavelength_error"], [1.0, np.nan])
    np.testing.assert_allclose(told["wavelength_scatter"], [np.sqrt(2), np.nan])
    assert told["wavelength_count"].values.tolist() == [2, 1]


def test_piles_that_are_all_alike_have_the_error_of_one() -> None:
    dims, attributes = ("setup", "pile"), {"units": "cm", "long_name": "of a test"}
    values = [[0.1] * 6, [1.0, 2.0, 3.0, 1.0, 2.0, 3.0]]
    piles = xr.Dataset({"regime": (dims, np.full((2, 6), "stratified"))})
    for name in QUANTITIES:
        piles[name] = dims, np.array(values), attributes
        piles[f"{name}_error"] = dims, np.full((2, 6), 0.02)
    means = means_over_piles(piles)
    assert means["wavelength_error"][0] < 1e-9
    told = with_own_errors(means, piles)
    for name in QUANTITIES:
        np.testing.assert_allclose(told[f"{name}_error"], [0.02, means[f"{name}_error"][1]])


def test_a_study_is_told_in_words_numbers_and_a_picture(small: xr.Dataset) -> None:
    for there in small.variables.values():
        assert "long_name" in there.attrs
        assert ("units" in there.attrs) == (there.dtype.kind in "if")
    sheet = limit_table(small)
    assert sheet.row_count == 5, "two sizes, the continuum on their grid, as dx -> 0, the change"
    record = study_record(small)
    assert "deposit" not in record
    assert record["wavelength_exponent"] == [None]
    assert np.shape(record["wavelength"]) == (1, 2)
    assert record["wavelength"] == small["wavelength"].values.tolist()
    figure = draw_limit(small)
    panels = [axes for axes in figure.axes if axes.get_title(loc="left").startswith("$")]
    drawn = [axes.containers[0].lines[0].get_ydata() for axes in panels[:3]]
    for points, name in zip(drawn, QUANTITIES, strict=True):
        np.testing.assert_array_equal(points, small[name].values[0])


Command = Callable[..., tuple[int, str, str]]


@pytest.fixture
def bridge(monkeypatch, capsys, small: xr.Dataset) -> Command:
    """The command as a user gives it, in this process, with a study that was made before."""
    asked: list[tuple[int, int | None]] = []

    def made_before(seeds: int, workers: int | None, progress) -> xr.Dataset:
        asked.append((seeds, workers))
        progress(1.0)
        return small.copy()

    def run(*arguments: str | Path) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["stratify", "bridge", *map(str, arguments)])
        try:
            main()
        except SystemExit as end:
            return int(end.code or 0), *capsys.readouterr()
        return 0, *capsys.readouterr()

    monkeypatch.setitem(STUDIES, "limit", Study(made_before, draw_limit, limit_table))
    run.asked = asked  # type: ignore[attr-defined]
    return run


def test_the_command_writes_what_was_found_and_its_picture(tmp_path: Path, bridge, small) -> None:
    status, said, _ = bridge("limit", "-o", tmp_path / "new", "--seeds", 5, "--workers", 3)
    assert status == 0
    assert bridge.asked == [(5, 3)]
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == ["limit.nc", "limit.png"]
    found = read_whole(tmp_path / "new" / "limit.nc")
    xr.testing.assert_allclose(found, small)
    assert found.attrs["Conventions"] == "CF-1.11"
    assert "The limit of small grains" in said
    assert "wrote" in said


def test_the_command_prints_numbers_for_programs(tmp_path: Path, bridge, small) -> None:
    _, printed, _ = bridge("limit", "-o", tmp_path, "--json")
    assert json.loads(printed) == study_record(small)


def test_the_command_replaces_nothing_unless_told(tmp_path: Path, bridge) -> None:
    (tmp_path / "limit.png").write_text("mine")
    status, _, said = bridge("limit", "-o", tmp_path)
    assert (status, said.count("\n")) == (2, 1)
    assert "limit.png' exists already; --force replaces it" in said
    assert bridge.asked == []
    assert bridge("limit", "-o", tmp_path, "--force")[0] == 0
    assert (tmp_path / "limit.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["kinks"], "'kinks'"),
        (["limit", "--seeds", "1"], "1 is not in the range"),
        (["limit", "--workers", "0"], "0 is not in the range"),
        (["limit", "-o", "file"], "cannot be written"),
    ],
)
def test_bad_input_is_told_in_one_line(
    tmp_path: Path, bridge, monkeypatch, arguments: list[str], complaint: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("file").write_text("mine")
    status, _, said = bridge(*arguments)
    assert (status, said.count("\n")) == (2, 1)
    assert complaint in said
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
