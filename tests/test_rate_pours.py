"""Pours by the rate rule: what kinds there are, what their archives say, and what they promise."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import ca_model
from ca_model.stream import pour_to_disk, read_section
from compare import measure
from compare.cli import cli
from compare.pictures import draw
from compare.prediction import base, models_with_chance
from experiment import Experiment, NotApplicableError, SetupError, load
from experiment.archive import experiment_of, read
from experiment.archive.digest import DIGEST
from experiment.archive.storage import read_whole, told_by

MODELS = ("ca_model", "continuum")
RATE = "ca_model.rule=rate"
SMALL = [RATE, "mixture.grain_diameter=[0.0083,0.0167]", "ca_model.column_width=0.5"]
CELLS = {
    "silo": ("makse-stratification", [*SMALL, "pour.duration=100.0"]),
    "heap": ("heap", [RATE, "pour.duration=20.0"]),
    "open end": ("makse-stratification", [*SMALL, "cell.end=open", "pour.duration=150.0"]),
    "moving source": (
        "stockpile",
        [RATE, "mixture.collision_rate=[[20.0,2.0],[2.0,20.0]]", "pour.duration=50.0"],
    ),
    "three species": ("ternary", [RATE, "pour.duration=20.0"]),
    "mixed ground": (
        "makse-stratification",
        [*SMALL, "cell.start_composition=[0.5,0.5]", "pour.duration=100.0"],
    ),
    "pulses": ("pulsed-feed", [RATE, "pour.duration=400.0"]),
}
Poured = Callable[..., xr.Dataset]


def setup(cell: str) -> Experiment:
    preset, settings = CELLS[cell]
    return load(preset, ["pour.records=10", *settings])


@pytest.mark.parametrize("cell", CELLS)
def test_all_that_the_lattice_pours_is_poured_at_rates(cell: str) -> None:
    archive = ca_model.pour(setup(cell))
    poured, *there = (
        archive[f"{name}_volume"].values for name in ("poured", "rolling", "deposited", "outflow")
    )
    np.testing.assert_allclose(sum(there), poured, rtol=1e-12, atol=1e-12)
    assert (poured[-1] > 0).all()
    np.testing.assert_allclose(archive["surface_fraction"].sum("species"), 1.0)
    assert draw([archive]).axes


@pytest.mark.parametrize("cell", CELLS)
def test_the_deposit_on_its_grid_holds_what_lies_at_rest(cell: str) -> None:
    """Rows may be several units high: each is whole, but for the lowest and the topmost one."""
    archive = ca_model.pour(setup(cell))
    there = archive["deposit_fraction"].sum("species").values
    z, dx = archive["z"].values, np.diff(archive["x"].values[:2])[0]
    dz = z[1] - z[0]
    top, bottom = archive["height"].values[-1], archive["base_height"].values
    low, high = z[:, None] - dz / 2, z[:, None] + dz / 2
    filled = np.clip(np.minimum(high, top) - np.maximum(low, bottom), 0, dz) * (there > 0)
    laid = (archive["deposit_fraction"].fillna(0).values * filled[..., None]).sum(axis=(0, 1)) * dx
    np.testing.assert_allclose(laid.sum(), archive["deposited_volume"].values[-1].sum(), rtol=1e-6)
    np.testing.assert_allclose(laid, archive["deposited_volume"].values[-1], rtol=0.01)


@pytest.mark.parametrize(
    ("preset", "settings"),
    [
        ("makse-stratification", [RATE, "pour.duration=400.0"]),
        ("makse-stratification", [*SMALL, "pour.duration=400.0"]),
        ("heap", [RATE, "pour.duration=60.0", "cell.end=open"]),
        ("franks", ["pour.duration=100.0"]),
    ],
)
def test_a_pile_on_disk_holds_the_deposit_that_memory_holds(
    preset: str, settings: list[str], tmp_path: Path
) -> None:
    experiment = load(preset, ["pour.records=5", *settings])
    path, whole = tmp_path / "pile.nc", ca_model.pour(experiment)
    pour_to_disk(experiment, path)
    units = ca_model.lattice_of(experiment).row
    rows = -(-round(float(whole["height"][-1].max()) / whole.attrs["unit_cm"]) // units)
    section = read_section(path, (max(2, rows), 10_000))
    xr.testing.assert_allclose(section.drop_attrs(), whole.drop_attrs(), rtol=1e-12)


def test_piles_of_a_seed_are_unlike_and_each_is_the_same_again() -> None:
    settings = [*SMALL, "cell.length=20.0", "pour.duration=50.0", "pour.records=5"]
    heights = [
        ca_model.pour(load("makse-stratification", [*settings, f"pour.pile={pile}"]))["height"]
        for pile in (0, 1, 0)
    ]
    assert (heights[0].values != heights[1].values).any()
    assert heights[0].identical(heights[2])


def test_a_comparison_pours_piles_and_draws_by_the_rule_that_poured(poured: Poured) -> None:
    brief = ("cell.length=20.0", "pour.duration=60.0", "pour.records=12", *SMALL)
    archives = [poured(model, "makse-stratification", *brief) for model in MODELS]
    experiment = base(archives)
    assert experiment.ca_model["rule"] == "rate"
    assert models_with_chance(experiment, MODELS) == ["ca_model"]


def test_the_preset_of_small_grains_is_poured_alike_by_both_models(poured: Poured) -> None:
    """On columns twice as wide, of grains an eighth as large, which chance moves by 2 %."""
    quicker = (
        "ca_model.column_width=0.5",
        "continuum.cells=200",
        "mixture.grain_diameter=[0.00052,0.00104]",
    )
    found = [measure(poured(model, "makse-grains", *quicker)) for model in MODELS]
    for name, within in (("wavelength", 0.05), ("kink_velocity", 0.05), ("front_velocity", 0.03)):
        grains, equations = (float(one[name]) for one in found)
        assert grains == pytest.approx(equations, rel=within), name


def test_an_archive_says_what_the_lattice_made_of_the_lengths_of_the_law(poured: Poured) -> None:
    brief = ("cell.length=20.0", "pour.duration=10.0", "pour.records=5")
    fine = poured("ca_model", "makse-grains", *brief)
    assert fine.attrs["effective_surface_depth_cm"] == pytest.approx(0.1)
    assert fine.attrs["effective_curvature_length_cm"] == pytest.approx(0.1 + 0.125)
    assert "comment" not in fine.attrs
    coarse = poured("ca_model", "makse-stratification", *brief, RATE, "mixture.surface_depth=0.06")
    assert coarse.attrs["comment"] == (
        "the surface layer, 0.0667 cm, is thinner than the largest grains, 0.133 cm: one of these "
        "is all there is of it; columns 0.667 cm wide add half of that to curvature_length = 0.1 "
        "cm: they damp waves more than it does"
    )


def test_a_wall_that_outgrows_the_pile_by_what_rates_need_is_not_the_feeds_fault(
    poured: Poured,
) -> None:
    """The continuum's does as well; grains that may not touch the pile pile up at it."""
    brief = ("cell.length=20.0", "pour.duration=400.0", "pour.records=100", *SMALL)
    late = slice(-10, None)
    outgrown = []
    for model in MODELS:
        archive = poured(model, "makse-stratification", *brief, "continuum.cells=40")
        grown = (archive["height"][late].mean("time") - archive["height"][0]).values
        outgrown.append(grown[-1] - grown[-2])
        assert "outgrew" not in archive.attrs.get("comment", "")
    assert outgrown[0] == pytest.approx(outgrown[1], abs=0.15)
    few = poured("ca_model", "makse-stratification", *brief, "ca_model.contacts=1")
    assert "what the surface can capture with ca_model.contacts = 1" in few.attrs["comment"]


BRIEF = [
    "--set=cell.length=20.0",
    "--set=pour.duration=10.0",
    "--set=pour.records=5",
    "--set=continuum.cells=20",
]
LONGER = [*BRIEF, "--set=pour.duration=200.0"]


def stratify(*arguments: str) -> None:
    cli.main(arguments, standalone_mode=False)


def test_the_rule_is_told_by_an_option_and_kept_by_the_archive(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    stratify("pour", "makse-stratification", *BRIEF, "--rule", "rate", "-o", "run")
    stratify("pour", "makse-stratification", *BRIEF, "--rule", "rate", "-o", "run.zarr")
    assert told_by(Path("run/ca_model.nc"), DIGEST) == told_by(Path("run.zarr/ca_model"), DIGEST)
    assert experiment_of(read(Path("run/ca_model.nc"))).ca_model["rule"] == "rate"
    stratify("pour", "run/ca_model.nc", "-o", "again")
    assert "it holds what run/ca_model.nc holds, bit for bit" in capsys.readouterr().out
    stratify("pour", "run/ca_model.nc", "--rule", "threshold", "-o", "other")
    assert experiment_of(read(Path("other/ca_model.nc"))).ca_model["rule"] == "threshold"
    stratify("show", "run/ca_model.nc")
    stratify("compare", "run")
    assert Path("run/comparison.png").exists()


def test_a_diagram_is_mapped_by_the_rule_that_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    vary = ["--vary", "mixture.delta=-0.1,0.2", "--lines", "0", "--workers", "1"]
    for rule in ("rate", "threshold"):
        stratify("phase", "makse-segregation", *LONGER, *vary, "--rule", rule, "-o", f"{rule}.nc")
    rate, threshold = (read_whole(Path(f"{rule}.nc")) for rule in ("rate", "threshold"))
    assert (rate["failure"] == "").all()
    segregation = [
        diagram["segregation"].sel(model_name="ca_model") for diagram in (rate, threshold)
    ]
    assert (segregation[0].values != segregation[1].values).any()


@pytest.mark.parametrize(
    ("command", "refusal"),
    [
        ("pour glass-sugar --set ca_model.rule=rate", "--set 'ca_model.rule=rate' says it too"),
        ("pour glass-sugar --set ca_model={unit=0.01}", "allowed: either"),
        ("pour glass-sugar --model continuum", "--rule rate: the continuum has none; allowed: "),
        ("pour glass-sugar --set ca_model.percolation=false", "only where rule = 'threshold'"),
        ("pour franks", "ca_model.threshold_spread = 1: only where rule = 'toppling' it applies"),
        ("pour lattice-segregation", "mixture.collision_rate: missing"),
        ("pour drum-mixture", "cell.shape = 'drum': the lattice pours silos and heaps"),
        ("phase glass-sugar --vary ca_model.rule=rate,threshold", "says it too; allowed: either"),
        ("phase lattice-segregation --vary mixture.psi=0.1,0.2", "collision_rate: missing"),
    ],
)
def test_a_rule_that_cannot_be_is_refused_in_a_line_and_nothing_is_poured(
    command: str, refusal: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises((SetupError, NotApplicableError)) as refused:
        stratify(*command.split(), "--rule", "rate")
    assert refusal in str(refused.value)
    assert "\n" not in str(refused.value)
    assert not list(tmp_path.iterdir())
