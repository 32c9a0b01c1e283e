"""Grid convergence: known orders and limits are recovered, and the command writes the table."""

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from test_command_line import refused, stratify

from compare import converge, measure
from compare.convergence import QUANTITIES, limit, refinement_ratio
from compare.table import convergence_record, convergence_table
from experiment import ArchiveError, Experiment, SetupError
from experiment.archive import experiment_of

STRATIFIES = ("cell.length=30.0", "pour.duration=400.0", "pour.records=400")
CALM = ("cell.length=20.0", "pour.duration=50.0", "pour.records=20")
CELLS = (30, 60, 120)

Poured = Callable[..., xr.Dataset]


def grids(poured: Poured, settings: tuple[str, ...] = STRATIFIES) -> list[xr.Dataset]:
    return [
        poured("continuum", "makse-stratification", *settings, f"continuum.cells={n}")
        for n in CELLS
    ]


@pytest.mark.parametrize("ratio", [1.5, 2.0, 3.0])
@pytest.mark.parametrize("order", [1.0, 2.0])
@pytest.mark.parametrize("slope", [0.7, -0.7])
def test_a_known_order_and_its_limit_are_recovered(ratio, order, slope) -> None:
    spacings = [ratio**-k for k in range(4)]
    found = limit([3.0 + slope * dx**order for dx in spacings], ratio)
    assert found.order == pytest.approx(order, rel=1e-12)
    assert found.value == pytest.approx(3.0, rel=1e-13)
    assert found.error == pytest.approx(1.25 * 0.7 * spacings[-1] ** order, rel=1e-12)


@pytest.mark.parametrize(
    ("values", "why"),
    [
        ([1.0, 1.01, 1.11], "diverges"),
        ([1.0, 1.11, 1.21], "converges more slowly than order 1/2"),
        ([0.0, 1.0, 1.1], "converges faster than order 3"),
    ],
)
def test_where_no_order_is_credible_the_bar_is_three_steps_wide(values, why: str) -> None:
    found = limit(values, 2.0)
    step = values[2] - values[1]
    assert math.isnan(found.order), why
    assert found.value == pytest.approx(values[2] + step)
    assert found.error == pytest.approx(3 * abs(step))


def test_a_sequence_that_swings_is_known_no_better_than_its_larger_step() -> None:
    found = limit([1.0, 1.2, 1.17], 2.0)
    assert math.isnan(found.order)
    assert found.value == pytest.approx(1.14)
    assert found.error == pytest.approx(3 * 0.2)


def test_what_no_longer_changes_has_no_error_of_the_grid() -> None:
    assert limit([2.0, 2.0, 2.0], 2.0)[:2] == (2.0, 0.0)


def test_what_was_not_found_on_one_grid_has_no_limit() -> None:
    assert np.isnan(limit([1.0, math.nan, 1.1], 2.0)).all()


@pytest.mark.parametrize(("cells", "ratio"), [([100, 200, 400, 800], 2.0), ([4, 6, 9], 1.5)])
def test_grids_refined_evenly_have_one_ratio(cells, ratio) -> None:
    assert refinement_ratio(cells) == ratio


@pytest.mark.parametrize(
    "cells", [[], [100], [100, 200], [400, 200, 100], [9, 9, 9], [100, 200, 300], [0, 0, 0]]
)
def test_grids_not_refined_evenly_are_refused(cells) -> None:
    with pytest.raises(SetupError, match="at least 3 numbers that grow by one ratio"):
        refinement_ratio(cells)


def test_a_convergence_holds_what_was_measured_and_its_limits(poured: Poured) -> None:
    archives = grids(poured)
    found = converge(archives)
    assert found["cells"].values.tolist() == list(CELLS)
    assert found["dx"].values == pytest.approx([1.0, 0.5, 0.25])
    for name in QUANTITIES:
        alone = [float(measure(archive)[name]) for archive in archives]
        assert np.isfinite(alone).all()
        assert found[name].values.tolist() == alone
        tends, own = limit(alone, 2.0), float(measure(archives[-1])[f"{name}_error"])
        error = math.sqrt(tends.error**2 + own**2)
        assert found[f"{name}_extrapolated"].item() == tends.value
        assert found[f"{name}_extrapolated_error"].item() == pytest.approx(error)
        assert np.array_equal(found[f"{name}_order"].item(), tends.order, equal_nan=True)
        assert found[f"{name}_extrapolated"].attrs["units"] == found[name].attrs["units"]
    for variable in found.variables.values():
        assert variable.attrs["units"]
        assert variable.attrs["long_name"]
    assert experiment_of(found) == experiment_of(archives[-1])


def test_without_kinks_the_table_has_dashes_and_json_has_nulls(poured: Poured) -> None:
    found = converge(grids(poured, CALM))
    column = list(convergence_table(found).columns[3].cells)
    assert column == ["-"] * (len(CELLS) + 2)
    record = convergence_record(found)
    assert record["kink_velocity"] == [None] * len(CELLS)
    assert record["kink_velocity_extrapolated"] is None
    assert record["cells"] == list(CELLS)


@pytest.mark.parametrize(
    ("odd", "why"),
    [
        ("feed.inflow=[0.4,0.6]", "their feed is not the same"),
        ("continuum.bins_per_depth=3", "more than their continuum.cells differs"),
    ],
)
def test_archives_that_differ_in_more_than_cells_are_refused(poured, odd: str, why: str) -> None:
    coarse, middle, _ = grids(poured, CALM)
    fine = poured("continuum", "makse-stratification", *CALM, f"continuum.cells={CELLS[2]}", odd)
    with pytest.raises(ArchiveError, match=why):
        converge([coarse, middle, fine])


def test_archives_of_the_lattice_are_refused(poured: Poured) -> None:
    archives = [
        poured("ca_model", "makse-stratification", *CALM, f"ca_model.column_width={20 / n}")
        for n in CELLS
    ]
    assert [archive.sizes["x"] for archive in archives] == list(CELLS)
    with pytest.raises(ArchiveError, match="model = 'ca_model'; allowed: 'continuum'"):
        converge(archives)


@pytest.fixture
def small(small_pour: Experiment, tmp_path: Path) -> str:
    (tmp_path / "small.toml").write_text(small_pour.to_toml())
    return "small.toml"


def test_the_command_writes_the_table_and_the_file(small: str, tmp_path: Path) -> None:
    settings = [f"--set={setting}" for setting in STRATIFIES]
    done = stratify("converge", small, "--cells=30,60,120", *settings, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "120 cells: poured in" in done.stdout
    assert "kink velocity (cm/s)" in done.stdout
    assert "grid convergence index" in done.stdout
    folder = tmp_path / "pours" / "small"
    assert [path.name for path in folder.iterdir()] == ["convergence.nc"]
    with xr.open_dataset(folder / "convergence.nc") as found:
        assert found["cells"].values.tolist() == list(CELLS)
        assert np.isfinite(found["wavelength_extrapolated_error"])
        assert experiment_of(found).cell.length == 30.0
        assert experiment_of(found).continuum["cells"] == 120


def test_the_command_prints_json_and_nothing_else_for_programs(small: str, tmp_path: Path) -> None:
    options = ["--cells=10,20,40", "--json", "-o", "out.nc"]
    done = stratify("converge", small, *options, folder=tmp_path)
    record = json.loads(done.stdout)
    assert record["dx"] == [2.0, 1.0, 0.5]
    assert record["wavelength_order"] is None
    with xr.open_dataset(tmp_path / "out.nc") as found:
        assert set(record) == {"title", "comment", *map(str, found.variables)}


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (["--cells=10,20"], "cells = 10,20: it should be at least 3 numbers"),
        (["--cells=10,20,30"], "cells = 10,20,30: it should be"),
        (["--cells=40,20,10"], "cells = 40,20,10: it should be"),
        (["--cells=10,20,many"], "cells = 10,20,many: it should be numbers"),
        (["--cells=1,2,4"], "continuum.cells = 1: it should be"),
        (["--set=ca_model.contacts=0"], "ca_model.contacts"),
        (["-o", "small.toml/x.nc"], "folder 'small.toml' cannot be written"),
    ],
)
def test_bad_grids_are_refused_and_nothing_is_written(options, named: str, small, tmp_path) -> None:
    assert named in refused(stratify("converge", small, *options, folder=tmp_path))
    assert [path.name for path in tmp_path.iterdir()] == [small]


def test_a_mixture_without_collision_rates_has_no_continuum(tmp_path: Path) -> None:
    done = stratify("converge", "lattice-stratification", folder=tmp_path)
    assert "mixture.collision_rate: missing" in refused(done)
    assert list(tmp_path.iterdir()) == []


def test_a_drum_is_refused_before_anything_is_poured(tmp_path: Path) -> None:
    done = stratify("converge", "de-gennes-drum", folder=tmp_path)
    assert "cell.shape = 'drum'" in refused(done)
    assert list(tmp_path.iterdir()) == []


def test_an_existing_convergence_stays_without_force(small: str, tmp_path: Path) -> None:
    (tmp_path / "out.nc").write_text("precious")
    options = ["--cells=10,20,40", "-o", "out.nc"]
    done = stratify("converge", small, *options, folder=tmp_path)
    assert "exists already; --force replaces it" in refused(done)
    assert "poured" not in done.stdout
    assert (tmp_path / "out.nc").read_text() == "precious"
    assert stratify("converge", small, *options, "--force", folder=tmp_path).returncode == 0
    with xr.open_dataset(tmp_path / "out.nc") as found:
        assert found.sizes["cells"] == 3


def test_converge_has_help_with_an_example(tmp_path: Path) -> None:
    assert "Example: stratify converge" in stratify("converge", "--help", folder=tmp_path).stdout


@pytest.mark.parametrize(
    ("scheme", "length", "warned"),
    [("godunov", 0.5, True), ("godunov", 1.0, False), ("muscl", 0.5, False)],
)
def test_grids_on_which_the_scheme_smooths_as_much_as_the_grains_do_are_called_too_coarse(
    poured: Poured, scheme: str, length: float, warned: bool
) -> None:
    """First order adds dx / 2, here 0.125 cm on the finest grid, to the curvature length."""
    settings = (f"mixture.curvature_length={length}", f"continuum.scheme={scheme}", *STRATIFIES)
    found = converge(grids(poured, settings))
    assert ("too short" in found.attrs["comment"]) is warned
