"""A feed varies as its schedule says: at any time, on average, and in what either model poured."""

from collections.abc import Callable

import numpy as np
import pytest

import ca_model
import continuum
from experiment import Experiment, Feed, SetupError, Sine, Table, load
from experiment.archive import experiment_of

STEP = 0.5  # s, of both models in the pours below
SCHEDULES = {
    "constant": "feed.schedule={kind='constant'}",
    "pulses": "feed.schedule={kind='pulses',period=20.0,share=0.25,inflow=[0.8,0.1]}",
    "sine": "feed.schedule={kind='sine',period=20.0,amplitude=[0.5,-0.25]}",
    "table": "feed={schedule={kind='table',time=[0,10,30],inflow=[[0.6,0.2],[0.2,0.2],[0,1]]}}",
}
KINDS = pytest.mark.parametrize("kind", SCHEDULES)


def poured_in_pulses(t: np.ndarray) -> np.ndarray:
    in_pulses = 5 * (t // 20) + np.minimum(t % 20, 5)
    return 0.5 * t[:, None] + np.outer(in_pulses, [0.3, -0.4])


def poured_in_waves(t: np.ndarray) -> np.ndarray:
    swing = 10 / np.pi * (1 - np.cos(np.pi * t / 10))
    return 0.5 * t[:, None] + np.outer(swing, [0.5, -0.25])


def poured_by_table(t: np.ndarray) -> np.ndarray:
    first, second = np.minimum(t, 10), np.clip(t - 10, 0, 20)
    after = np.maximum(t - 30, 0)
    small = 0.6 * first - 0.02 * first**2 + 0.2 * second - 0.005 * second**2
    large = 0.2 * first + 0.2 * second + 0.02 * second**2 + after
    return np.stack([small, large], axis=1)


POURED: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "constant": lambda t: np.outer(t, [0.5, 0.5]),
    "pulses": poured_in_pulses,
    "sine": poured_in_waves,
    "table": poured_by_table,
}


def pour_of(kind: str) -> Experiment:
    """A pour of 50 s by one schedule, at v = 1 cm/s and in steps of `STEP` in both models."""
    return load(
        "makse-stratification",
        [
            "cell.length=20.0",
            "pour.duration=50.0",
            "pour.records=50",
            "continuum.cells=40",
            "ca_model.column_width=0.5",
            SCHEDULES[kind],
        ],
    )


@KINDS
def test_the_continuum_pours_what_the_schedule_says(kind: str) -> None:
    archive = continuum.pour(pour_of(kind))
    expected = POURED[kind](archive["time"].values)
    np.testing.assert_allclose(archive["poured_volume"], expected, rtol=1e-12, atol=1e-12)


@KINDS
def test_the_lattice_pours_what_the_schedule_says_within_a_grain(kind: str) -> None:
    experiment = pour_of(kind)
    archive = ca_model.pour(experiment)
    grain = ca_model.lattice_of(experiment).grain_volume
    missing = np.abs(archive["poured_volume"] - POURED[kind](archive["time"].values))
    assert (missing < grain + 1e-9).all()


@KINDS
@pytest.mark.parametrize("model", [ca_model, continuum])
def test_an_archive_keeps_its_schedule_and_mean_inflow(kind: str, model) -> None:
    experiment = pour_of(kind)
    archive = model.pour(experiment)
    assert experiment_of(archive) == experiment
    poured = archive["poured_volume"].values[-1] / experiment.pour.duration
    fed = archive["inflow"].values * archive["drift_velocity"].values
    np.testing.assert_allclose(poured, fed, rtol=1e-12 if model is continuum else 0.01)


@KINDS
def test_mean_and_largest_inflow_are_those_over_time(kind: str) -> None:
    feed = pour_of(kind).feed
    span = 30.0 if kind == "table" else 20.0
    times = (np.arange(100_000) + 0.5) * span / 100_000
    thickness = feed.thickness(times)
    mean = feed.mean_thickness(np.array([0.0, span]))[0]
    assert thickness.mean(axis=0) == pytest.approx(mean, abs=1e-8)
    assert thickness.max(axis=0) == pytest.approx(feed.largest_inflow, abs=1e-4)
    assert thickness.min() >= 0


@KINDS
@pytest.mark.parametrize("steps", [7, 33, 1000])
def test_steps_are_fed_the_mean_over_them_wherever_their_edges_lie(kind: str, steps: int) -> None:
    """So that a pulse that falls between two steps is not missed."""
    feed = pour_of(kind).feed
    edges = np.linspace(0.0, 47.3, steps + 1)
    fine = np.linspace(0.0, 47.3, 1000 * steps + 1)
    sampled = feed.thickness(0.5 * (fine[1:] + fine[:-1])).reshape(steps, 1000, -1).mean(axis=1)
    np.testing.assert_allclose(feed.mean_thickness(edges), sampled, atol=2e-3)
    assert feed.mean_thickness(edges).min() >= 0


@pytest.mark.parametrize("period", [0.3, 0.7, 1.0])
def test_short_pulses_pour_what_they_promise(period: float) -> None:
    """Also where their edges lie between steps, or several periods in one."""
    schedule = f"{{kind='pulses', period={period}, share=0.35, inflow=[1.0, 0.0]}}"
    settings = [f"feed={{inflow=[0.0, 0.0], schedule={schedule}}}", "pour.duration=210.0"]
    archive = continuum.pour(load("makse-stratification", settings))
    poured = float(archive["poured_volume"][-1, 0])
    assert poured == pytest.approx(0.35 * 210.0, rel=1e-9)


def test_a_ramp_is_averaged_over_the_pour_and_not_over_its_table() -> None:
    table = "{kind='table', time=[0.0, 10.0], inflow=[[0.0, 0.0], [1.0, 1.0]]}"
    settings = [f"feed={{schedule={table}}}", "pour.duration=500.0"]
    experiment = load("makse-stratification", settings)
    assert experiment.mean_inflow == pytest.approx([0.99, 0.99])


def test_a_feed_is_constant_unless_told() -> None:
    thickness = Feed(inflow=(0.5, 0.25)).thickness(np.array([0.0, 1.0, 7.0]))
    assert thickness.tolist() == [[0.5, 0.25]] * 3


def test_a_pulse_comes_first_in_its_period() -> None:
    times = np.array([0.0, 4.9, 5.1, 19.9, 20.1, 25.1])
    fed = pour_of("pulses").feed.thickness(times)
    assert fed[:, 0].tolist() == [0.8, 0.8, 0.5, 0.5, 0.8, 0.5]


def test_amplitudes_of_opposite_sign_vary_the_composition_alone() -> None:
    feed = Feed(inflow=(0.5, 0.5), schedule=Sine(period=8.0, amplitude=(0.5, -0.5)))
    thickness = feed.thickness(np.array([0.0, 2.0, 6.0]))
    np.testing.assert_allclose(thickness, [[0.5, 0.5], [1.0, 0.0], [0.0, 1.0]], atol=1e-15)


def test_a_table_ends_with_its_last_row_and_tells_the_mean() -> None:
    feed = Feed(schedule=Table(time=(0.0, 1.0, 4.0), inflow=((2.0,), (0.0,), (2.0,))))
    assert feed.thickness(np.array([0.5, 2.5, 9.0])).tolist() == [[1.0], [1.0], [2.0]]
    assert feed.inflow == (1.0,)
    assert Feed.parse(feed.model_dump()) == feed


@KINDS
def test_a_schedule_survives_toml(kind: str) -> None:
    experiment = pour_of(kind)
    assert experiment.feed.schedule.kind == kind
    assert Experiment.from_toml(experiment.to_toml()) == experiment


def test_a_setting_changes_one_number_of_a_schedule() -> None:
    text = pour_of("sine").to_toml()
    changed = Experiment.from_toml(text, ["feed.schedule.period=7.0"]).feed.schedule
    assert changed == Sine(period=7.0, amplitude=(0.5, -0.25))


PULSES = "period=20.0,share=0.25,inflow=[0.8,0.1]"


@pytest.mark.parametrize(
    ("setting", "named"),
    [
        ("schedule=3", "feed.schedule = 3: it should be a table with a kind; allowed: constant"),
        ("schedule.period=3.0", "feed.schedule.kind: missing; allowed: constant, pulses, sine,"),
        ("schedule.kind=saw", "feed.schedule.kind = 'saw': it should be one of constant, pulses"),
        ("schedule.kind=[]", "feed.schedule.kind = []: it should be one of constant, pulses"),
        ("schedule={kind='constant',period=1.0}", "feed.schedule: no field 'period'; allowed: k"),
        ("schedule={kind='sine',period=1.0}", "feed.schedule.amplitude: missing"),
        (
            "schedule={kind='sine',period=0.0,amplitude=[0.1,0.1]}",
            "feed.schedule.period = 0.0: it should be greater than 0",
        ),
        (
            "schedule={kind='sine',period=9.0,amplitude=[0.1,-0.9]}",
            "feed.schedule.amplitude[1] = -0.9: it should be at most inflow[1] = 0.5 in size",
        ),
        (
            "schedule={kind='sine',period=9.0,amplitude=[0.1,nan]}",
            "feed.schedule.amplitude[1] = nan: it should be a number",
        ),
        (
            "schedule={kind='sine',period=9.0,amplitude=[0.1]}",
            "feed.schedule.amplitude = [0.1]: it should have 2 values, one a species",
        ),
        (
            "schedule={kind='pulses',period=9.0,share=1.0,inflow=[1.0,1.0]}",
            "feed.schedule.share = 1.0: it should be less than 1",
        ),
        (
            "schedule={kind='pulses',period=9.0,share=0.5,inflow=[1.0,1.0,1.0]}",
            "feed.schedule.inflow = [1.0, 1.0, 1.0]: it should have 2 values, one a species",
        ),
        (
            "schedule={kind='table',time=[0,1],inflow=[[1,1],[1,1]]}",
            "feed.inflow = [0.5, 0.5]: it should be left out, for schedule.inflow tells it",
        ),
    ],
)
def test_a_wrong_schedule_is_refused_by_name(setting: str, named: str) -> None:
    check_refusal(f"feed.{setting}", named)


@pytest.mark.parametrize(
    ("time", "inflow", "named"),
    [
        ("[0]", "[[1,1]]", "time = [0.0]: it should be 2 or more values that grow from 0 on"),
        ("[1,2]", "[[1,1],[1,1]]", "time = [1.0, 2.0]: it should be 2 or more"),
        ("[0,2,2]", "[[1,1],[1,1],[1,1]]", "time = [0.0, 2.0, 2.0]: it should be 2 or more"),
        ("[0,1]", "[[1,1]]", "inflow = [[1.0, 1.0]]: it should have 2 rows, one a time"),
        ("[0,1]", "[[1,1],[1]]", "inflow[1] = [1.0]: it should have 2 values, one a species"),
        ("[0,1]", "[[],[]]", "inflow[0] = []: it should not be empty"),
        ("[0,1]", "[[1],[1]]", "inflow[0] = [1.0]: it should have 2 values, one a species"),
        ("[0,1]", "[[1,1],[1,-1]]", "inflow[1][1] = -1: it should be greater than or equal to 0"),
    ],
)
def test_a_wrong_table_is_refused_by_name(time: str, inflow: str, named: str) -> None:
    check_refusal(
        f"feed={{schedule={{kind='table',time={time},inflow={inflow}}}}}", f"feed.schedule.{named}"
    )


def test_a_feed_without_inflow_is_refused_unless_a_table_tells_it() -> None:
    check_refusal("feed={}", "feed.inflow: missing; it has no default, unless")
    check_refusal("feed={schedule={kind='constant'}}", "feed.inflow: missing")
    check_refusal("feed.inflow=[0.0,0.0]", "feed.inflow = [0.0, 0.0]: at least one should be")
    paused = f"feed={{inflow=[0.0,0.0],schedule={{kind='pulses',{PULSES}}}}}"
    assert load("makse-stratification", [paused]).mean_inflow == pytest.approx(
        [0.2, 0.025], rel=1e-3
    )


def test_the_lattice_counts_the_grains_of_the_largest_feed() -> None:
    flood = "feed.schedule={kind='pulses',period=9.0,share=0.5,inflow=[1e6,0.0]}"
    with pytest.raises(SetupError, match=r"it makes 1.5e\+07 grains a step"):
        ca_model.check(load("makse-stratification", [flood]))


def check_refusal(setting: str, named: str) -> None:
    with pytest.raises(SetupError) as refusal:
        load("makse-stratification", [setting])
    assert str(refusal.value).startswith(named)
    assert "\n" not in str(refusal.value)
