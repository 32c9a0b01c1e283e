"""Cells: what lies in a silo, a heap or a drum before pouring, and which of them make sense."""

import numpy as np
import pytest

import ca_model
from experiment import Cell, Experiment, NotApplicableError, SetupError, load
from experiment.experiment import parse_toml

TURNING = ("cell.shape=drum", "cell.turning_rate=0.1", "cell.length=20.0")
DRUM = (*TURNING, "feed.inflow=[0.0, 0.0]")
HEAP = ("cell.shape=heap", "cell.length=20.0")


def test_a_cell_is_a_silo_with_a_wall_unless_told() -> None:
    cell = Cell(length=20.0, start_slope=0.5)
    assert (cell.shape, cell.end, cell.left, cell.right) == ("silo", "wall", 0.0, 20.0)
    assert cell.base_height(np.array([0.0, 5.0, 20.0])).tolist() == [10.0, 7.5, 0.0]


def test_a_heap_is_the_same_on_both_sides() -> None:
    cell = Cell(shape="heap", length=20.0, start_slope=0.5)
    x = np.linspace(cell.left, cell.right, 41)
    assert (cell.left, cell.right) == (-20.0, 20.0)
    assert (cell.base_height(x) == cell.base_height(-x)).all()
    assert cell.base_height(np.array([-20.0, 0.0, 10.0])).tolist() == [0.0, 10.0, 5.0]


def test_a_drums_surface_falls_through_its_middle() -> None:
    cell = Cell(shape="drum", length=20.0, start_slope=0.5, turning_rate=0.1)
    assert (cell.left, cell.right) == (-10.0, 10.0)
    assert cell.base_height(np.array([-10.0, 0.0, 10.0])).tolist() == [15.0, 10.0, 5.0]


def test_a_given_surface_is_linear_between_its_points() -> None:
    cell = Cell(length=20.0, start_surface=((0.0, 4.0), (10.0, 0.0), (20.0, 2.0)))
    assert cell.base_height(np.array([0.0, 5.0, 10.0, 15.0])).tolist() == [4.0, 2.0, 0.0, 1.0]


def test_the_lip_of_an_open_end_is_as_high_as_the_surface_was() -> None:
    silo = Cell(length=20.0, end="open", start_surface=((0.0, 4.0), (30.0, 1.0)))
    assert silo.base_at_end.tolist() == [2.0]
    heap = Cell(shape="heap", length=5.0, end="open", start_surface=((-5.0, 1.0), (5.0, 3.0)))
    assert heap.base_at_end.tolist() == [1.0, 3.0]
    assert Cell(length=20.0, end="open", start_slope=0.5).base_at_end.tolist() == [0.0]


@pytest.mark.parametrize(
    "settings",
    [
        DRUM,
        (*HEAP, "cell.end=open", "mixture.dispersion=0.3"),
        ("cell.start_slope=0.0", "cell.start_surface=[[0.0, 1.0], [60.0, 3.5], [100.0, 0.0]]"),
    ],
)
def test_a_cell_survives_toml(settings: tuple[str, ...]) -> None:
    experiment = load("makse-stratification", settings)
    assert Experiment.from_toml(experiment.to_toml()) == experiment


def test_a_drum_needs_no_feed_and_nothing_else_does_without() -> None:
    tables = parse_toml(load("makse-stratification", DRUM).to_toml())
    unfed = Experiment.parse({name: tables[name] for name in tables if name != "feed"})
    assert unfed.feed.inflow == (0.0, 0.0)
    assert Experiment.from_toml(unfed.to_toml()) == unfed
    silo = {name: tables[name] for name in ("title", "mixture", "pour")} | {"cell": {"length": 9.0}}
    with pytest.raises(SetupError, match=r"^feed: missing; only a drum does without"):
        Experiment.parse(silo)


def test_what_is_wrong_elsewhere_is_named_before_a_missing_feed() -> None:
    with pytest.raises(SetupError, match=r"^mixture: missing"):
        Experiment.parse({"title": "x", "cell": {"length": 9.0}, "pour": {"duration": 1.0}})


def test_a_drum_is_filled_with_equal_parts_and_a_silo_starts_on_small_grains() -> None:
    assert load("makse-stratification", DRUM).start_composition == (0.5, 0.5)
    assert load("makse-stratification", HEAP).start_composition == (1.0, 0.0)
    told = load("makse-stratification", [*DRUM, "cell.start_composition=[0.25, 0.75]"])
    assert told.start_composition == (0.25, 0.75)


SURFACE = "cell.start_surface=[[0.0, 1.0], [100.0, 0.0]]"


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        (["cell.shape=cone"], "cell.shape = 'cone': it should be 'silo', 'heap' or 'drum'"),
        (["cell.end=ajar"], "cell.end = 'ajar': it should be 'wall' or 'open'"),
        (["cell.turning_rate=0.1"], "cell.turning_rate = 0.1: only a drum turns"),
        (["cell.shape=drum"], "cell.turning_rate: missing; a drum has to turn"),
        ([*DRUM, "cell.turning_rate=0.0"], "cell.turning_rate = 0.0: it should be greater than 0"),
        ([*DRUM, "cell.end=open"], "cell.end = 'open': it should be 'wall' in a drum"),
        (
            [*DRUM, "cell.turning_rate=0.1", "cell.start_slope=2.0"],
            "cell.start_slope = 2: it should be at most 1.5 in a drum",
        ),
        (["cell.length=1e-300"], "cell.length = 1e-300: it should be at least 1e-09"),
        ([*TURNING], "feed.inflow = [0.5, 0.5]: it should be 0 in a drum"),
        ([*DRUM, "cell.start_composition=[1.0]"], "cell.start_composition = [1.0]: it should be 2"),
        ([*DRUM, "cell.start_slope=0.0", SURFACE], "cell.start_surface = [[0.0, 1.0], [100.0, 0."),
        ([SURFACE], "cell.start_slope = 1: it should be 0 where a start_surface is given"),
        (
            ["cell.start_slope=0.0", "cell.start_surface=[[0.0, 1.0], [50.0, 0.0]]"],
            "cell.start_surface = [[0.0, 1.0], [50.0, 0.0]]: it should reach from x = 0 to 100",
        ),
        (
            [*HEAP, "cell.start_slope=0.0", "cell.start_surface=[[0.0, 1.0], [20.0, 0.0]]"],
            "cell.start_surface = [[0.0, 1.0], [20.0, 0.0]]: it should reach from x = -20 to 20",
        ),
        (
            ["cell.start_slope=0.0", "cell.start_surface=[[0.0, 1.0], [0.0, 2.0], [100.0, 0.0]]"],
            "cell.start_surface = [[0.0, 1.0], [0.0, 2.0], [100.0, 0.0]]: its x should grow",
        ),
        (["cell.start_surface=[[0.0, -1.0], [100.0, 0.0]]"], "cell.start_surface[0][1] = -1.0: it"),
        (["cell.start_surface=[[0.0, 1.0]]"], "cell.start_surface = "),
        (["cell.start_surface=[0.0, 1.0]"], "cell.start_surface[0] = 0.0: it should be a"),
        (["mixture.dispersion=-1.0"], "mixture.dispersion = -1.0: it should be greater than or"),
    ],
)
def test_a_cell_that_makes_no_sense_is_refused_by_name(settings: list[str], named: str) -> None:
    with pytest.raises(SetupError) as refusal:
        load("makse-stratification", settings)
    assert str(refusal.value).startswith(named)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        (DRUM, "cell.shape = 'drum': the lattice pours silos and heaps"),
        (("mixture.dispersion=0.5",), "mixture.dispersion = 0.5: lattice grains roll without"),
    ],
)
def test_the_lattice_says_which_cells_it_cannot_fill(settings, named: str) -> None:
    experiment = load("makse-stratification", settings)
    for refuse in (ca_model.check, ca_model.pour):
        with pytest.raises(NotApplicableError) as refusal:
            refuse(experiment)
        assert str(refusal.value).startswith(named)


def test_the_lattice_pours_onto_a_given_surface() -> None:
    """Rounded to whole units; grains roll down the part that is too steep, and fill the hollow."""
    surface = "cell.start_surface=[[0.0, 20.0], [10.0, 0.0], [20.0, 5.0]]"
    settings = ["cell.length=20.0", "cell.start_slope=0.0", "pour.duration=20.0", surface]
    experiment = load("makse-stratification", settings)
    archive = ca_model.pour(experiment)
    unit = ca_model.lattice_of(experiment).unit
    base, expected = archive["base_height"], experiment.cell.base_height(archive["x"].values)
    np.testing.assert_allclose(base, expected, atol=unit / 2)
    np.testing.assert_allclose(base / unit, (base / unit).round(), atol=1e-9)
    grown = archive["height"].isel(time=-1) - base
    assert float(grown.sel(x=slice(0.0, 5.0)).max()) == 0
    assert float(grown.sel(x=slice(9.0, 11.0)).min()) > 0


def test_nothing_falls_off_a_wall(small_pour: Experiment) -> None:
    assert (ca_model.pour(small_pour)["outflow_volume"] == 0).all()
