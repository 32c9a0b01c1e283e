"""What diagrams are drawn over is one number each: it is set alone, and the rest stays."""

import math
from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from compare.ensemble import draws
from experiment import Experiment, Feed, Mixture, SetupError, Table, load
from experiment.slopes import stepped_slopes

GRAINS = {"names": ["small", "large"], "grain_diameter": [0.1, 0.2], "drift_velocity": 1.0}
SLOPE = st.floats(0.0, 5.0)
THICKNESS = st.floats(1e-3, 10.0)


def matrices(species: int) -> st.SearchStrategy[list[list[float]]]:
    row = st.lists(st.floats(20.0, 50.0), min_size=species, max_size=species)
    return st.lists(row, min_size=species, max_size=species)


def grains(species: int) -> dict[str, object]:
    diameters = [0.1 * (a + 1) for a in range(species)]
    return {"names": list("abcdefgh")[:species], "grain_diameter": diameters, "drift_velocity": 1.0}


def slopes(fields: dict[str, object]) -> np.ndarray:
    return np.array(Mixture.parse(fields, "mixture").repose_slope)


def test_pure_slopes_and_a_step_make_the_matrix_of_the_ternary_preset() -> None:
    ternary = load("ternary").mixture
    pure = {"theta_11": 0.4877, "theta_22": 0.7002, "theta_33": 0.8098, "psi": 0.2}
    np.testing.assert_allclose(slopes(grains(3) | pure), ternary.repose_slope, rtol=1e-15)


@given(pure=st.lists(SLOPE, min_size=2, max_size=2), psi=st.floats(-5.0, 5.0))
def test_the_step_between_two_species_is_the_papers_psi_with_m1_equal_to_m2(pure, psi) -> None:
    (t11, t12), (t21, t22) = stepped_slopes(pure, psi)
    assert (t11, t22) == tuple(pure)
    assert t11 - t21 == pytest.approx(psi, abs=1e-12)
    assert t12 - t11 == pytest.approx(t22 - t21, abs=1e-12) == pytest.approx(t22 - t11 + psi)


@pytest.mark.parametrize("species", [1, 3, 4])
def test_pure_angles_and_a_step_make_the_slopes_of_any_number_of_species(species: int) -> None:
    angles = [26.0, 30.0, 35.0, 39.0][:species]
    psi = {"psi": 0.1} if species > 1 else {}
    expected = stepped_slopes([math.tan(math.radians(angle)) for angle in angles], 0.1)
    assert slopes(grains(species) | psi | {"repose_angle": angles}) == pytest.approx(
        np.array(expected)
    )


def test_a_pure_slope_beside_angles_is_taken_before_its_angle() -> None:
    angles = {"repose_angle": [26.0, 35.0, 39.0], "psi": 0.2, "theta_22": 0.75}
    assert np.diag(slopes(grains(3) | angles))[1] == 0.75
    two = GRAINS | {"repose_angle": [26.0, 39.0], "psi": 0.3}
    assert slopes(two | {"theta_22": 0.75})[1, 1] == pytest.approx(0.75)
    assert slopes(two | {"delta": 0.1})[1, 1] == pytest.approx(math.tan(math.radians(26)) + 0.1)


@given(matrix=matrices(3), value=st.floats(31.0, 69.0), b=st.integers(0, 2))
def test_of_three_species_a_pure_slope_moves_its_column_and_no_other(matrix, value, b) -> None:
    old = np.array(matrix)
    new = slopes(grains(3) | {"repose_slope": matrix, f"theta_{b + 1}{b + 1}": value})
    assert new[b, b] == value
    others = np.arange(3) != b
    np.testing.assert_array_equal(new[:, others], old[:, others])
    np.testing.assert_allclose(new[:, b] - old[:, b], value - old[b, b], atol=1e-12)


@given(matrix=matrices(4), psi=st.floats(-5.0, 5.0))
def test_of_four_species_the_step_makes_all_but_the_pure_slopes_anew(matrix, psi) -> None:
    new = slopes(grains(4) | {"repose_slope": matrix, "psi": psi})
    np.testing.assert_array_equal(new, stepped_slopes(np.diag(matrix).tolist(), psi))


@given(matrix=matrices(2), value=st.floats(31.0, 69.0))
def test_of_two_species_theta_22_moves_its_column_alone_as_delta_does(matrix, value) -> None:
    old = np.array(matrix)
    new = slopes(GRAINS | {"repose_slope": matrix, "theta_22": value})
    moved = old + np.array([0.0, value - old[1, 1]])
    np.testing.assert_allclose(new, moved, atol=1e-12)
    delta = slopes(GRAINS | {"repose_slope": matrix, "delta": value - old[0, 0]})
    np.testing.assert_allclose(new, delta, atol=1e-12)


@given(matrix=matrices(2), first=st.floats(31.0, 69.0), second=st.floats(31.0, 69.0))
def test_both_pure_slopes_of_two_species_move_both_columns(matrix, first, second) -> None:
    new = slopes(GRAINS | {"repose_slope": matrix, "theta_11": first, "theta_22": second})
    moved = np.array(matrix) + np.array([first, second]) - np.diag(matrix)
    np.testing.assert_allclose(new, moved, atol=1e-12)


@pytest.mark.parametrize(
    ("preset", "values"),
    [
        ("ternary", {"mixture.theta_22": 0.6, "mixture.theta_33": 0.7, "mixture.psi": 0.1}),
        ("glass-sugar", {"mixture.theta_22": 0.6, "mixture.psi": 0.1, "mixture.cross_rate": 5.0}),
        ("glass-sugar", {"feed.total_inflow": 0.3, "feed.share_2": 0.7, "mixture.m1": 0.4}),
    ],
)
def test_the_order_of_what_is_set_does_not_matter(preset: str, values: dict[str, float]) -> None:
    settings = [f"{key}={value}" for key, value in values.items()]
    expected = load(preset, [*settings, "uncertain={}"])
    for order in permutations(settings):
        assert load(preset, [*order, "uncertain={}"]) == expected
    for order in permutations(values.items()):
        varied = load(preset).with_values(dict(order))
        assert varied.feed == expected.feed
        assert varied.mixture.collision_rate == expected.mixture.collision_rate
        assert varied.mixture.repose_slope == pytest.approx(
            np.array(expected.mixture.repose_slope), rel=1e-14
        )


@given(matrix=matrices(3), cross=st.floats(0.0, 100.0))
def test_the_cross_rate_is_that_of_all_unlike_grains_and_leaves_the_diagonal(matrix, cross) -> None:
    fields = grains(3) | {"repose_slope": matrix, "collision_rate": matrix, "cross_rate": cross}
    rates = np.array(Mixture.parse(fields).collision_rate)
    np.testing.assert_array_equal(np.diag(rates), np.diag(matrix))
    assert (rates[~np.eye(3, dtype=bool)] == cross).all()


@given(inflow=st.lists(THICKNESS, min_size=1, max_size=4), total=THICKNESS)
def test_the_total_inflow_scales_the_feed_and_keeps_its_composition(inflow, total) -> None:
    scaled = np.array(Feed.parse({"inflow": inflow, "total_inflow": total}).inflow)
    assert scaled.sum() == pytest.approx(total)
    np.testing.assert_allclose(scaled / total, np.array(inflow) / sum(inflow), rtol=1e-12)


@given(inflow=st.lists(THICKNESS, min_size=2, max_size=2), share=st.floats(0.0, 1.0))
def test_the_share_of_species_2_is_set_and_the_total_kept(inflow, share) -> None:
    first, second = Feed.parse({"inflow": inflow, "share_2": share}).inflow
    assert first + second == pytest.approx(sum(inflow))
    assert second / (first + second) == pytest.approx(share)


@given(inflow=st.lists(THICKNESS, min_size=2, max_size=2), share=st.floats(0.0, 1.0))
def test_total_and_share_together_say_the_whole_feed(inflow, share) -> None:
    feed = Feed.parse({"inflow": inflow, "share_2": share, "total_inflow": 0.5})
    assert feed.inflow == pytest.approx((0.5 * (1 - share), 0.5 * share))


def test_what_a_schedule_adds_stays_when_the_total_changes() -> None:
    pulses = "feed.schedule={kind='pulses',period=20.0,share=0.25,inflow=[0.8,0.1]}"
    feed = load("makse-stratification", [pulses, "feed.total_inflow=0.0"]).feed
    assert feed.inflow == (0.0, 0.0)
    assert feed.largest_inflow.tolist() == [0.8, 0.1]


@pytest.mark.parametrize(
    ("preset", "setting"),
    [
        ("ternary", "mixture.theta_33=0.9"),
        ("ternary", "mixture.psi=0.1"),
        ("glass-sugar", "mixture.theta_22=0.7"),
        ("glass-sugar", "mixture.cross_rate=5.0"),
        ("glass-sugar", "feed.total_inflow=0.4"),
        ("glass-sugar", "feed.share_2=0.4"),
    ],
)
def test_a_set_up_is_written_in_plain_fields(preset: str, setting: str) -> None:
    text = load(preset, [setting, "uncertain={}"]).to_toml()
    assert setting.split("=")[0].split(".")[1] not in text
    assert Experiment.from_toml(text) == load(preset, [setting, "uncertain={}"])


def test_what_is_uncertain_may_be_any_of_them() -> None:
    ranges = {
        "mixture.theta_22": [0.6, 0.8],
        "mixture.cross_rate": [1.0, 5.0],
        "feed.total_inflow": [0.1, 0.4],
        "feed.share_2": [0.2, 0.8],
    }
    tables = load("glass-sugar").model_dump(exclude_none=True) | {"uncertain": ranges}
    drawn, values = draws(Experiment.parse(tables), 4)
    for one, (theta_22, cross, total, share) in zip(drawn, values.values, strict=True):
        assert one.mixture.repose_slope[1][1] == pytest.approx(theta_22)
        assert one.mixture.collision_rate == ((20.0, cross), (cross, 20.0))
        assert one.feed.inflow == pytest.approx((total * (1 - share), total * share))


TABLE = "feed={schedule={kind='table',time=[0,1],inflow=[[1,1],[1,1]]}}"


@pytest.mark.parametrize(
    ("preset", "settings", "named"),
    [
        ("ternary", ["mixture.theta_44=1.0"], "mixture.theta_44 = 1.0: not for 3 species; allowed"),
        ("ternary", ["mixture.delta=0.1"], "allowed: theta_11, theta_22, theta_33, psi"),
        ("ternary", ["mixture.m1=0.1"], "mixture.m1 = 0.1: not for 3 species"),
        ("ternary", ["mixture.theta_12=0.1"], "no field 'theta_12'; allowed: collision_rate"),
        ("ternary", ["mixture.theta_22=-1.0"], "mixture.theta_22 = -1.0: it should be a number fr"),
        ("ternary", ["mixture.theta_33=true"], "mixture.theta_33 = True: it should be a number"),
        ("ternary", ["mixture.theta_33=nan"], "mixture.theta_33 = nan: it should be a number"),
        ("ternary", ["mixture.theta_11=0.3"], "theta_11 = 0.3: it makes a repose slope of -0.1"),
        ("ternary", ["mixture.psi=0.3"], "mixture.psi = 0.3: it makes a repose slope of -0.11"),
        (
            "ternary",
            ["mixture.psi=0.3", "mixture.repose_slope=[[1.0]]"],
            "mixture.repose_slope = [[1.0]]: it should be a 3 x 3 matrix",
        ),
        (
            "ternary",
            ["mixture.psi=0.3", "mixture.repose_slope.0.1=nan"],
            "mixture.repose_slope[0][1] = nan: it should be a number",
        ),
        ("bcre", ["mixture.psi=0.1"], "mixture.psi = 0.1: not for 1 species; allowed: theta_11"),
        ("glass-sugar", ["mixture.theta_33=0.1"], "allowed: theta_11, theta_22, psi, delta, m1"),
        (
            "makse-stratification",
            ["mixture.theta_22=1.2"],
            "mixture.theta_22 = 1.2: it should be left out, for delta = 0.25 tells it",
        ),
        (
            "makse-stratification",
            ["mixture.psi=4.0", "mixture.m1=0.4"],
            "mixture.psi = 4: it makes a repose slope of -3",
        ),
        ("lattice-stratification", ["mixture.cross_rate=2.0"], "cross_rate = 2: it needs a coll"),
        ("bcre", ["mixture.cross_rate=2.0"], "cross_rate = 2: it needs a collision_rate beside"),
        ("ternary", ["mixture.collision_rate=3.0", "mixture.cross_rate=2.0"], "it needs a collis"),
        ("ternary", ["mixture.cross_rate=-1.0"], "mixture.cross_rate = -1.0: it should be a numb"),
        ("ternary", ["mixture.cross_rate='high'"], "mixture.cross_rate = 'high': it should be a n"),
        (
            "ternary",
            ["mixture.cross_rate=2.0", "mixture.collision_rate.1.1=0.0"],
            "mixture.collision_rate[1][1] = 0: it should be greater than 0",
        ),
        ("makse-stratification", ["feed.share_2=1.5"], "share_2 = 1.5: it should be a number from"),
        ("makse-stratification", ["feed.share_2=-0.1"], "feed.share_2 = -0.1: it should be a numb"),
        (
            "makse-stratification",
            ["feed.total_inflow=inf"],
            "feed.total_inflow = inf: it should be",
        ),
        ("makse-stratification", ["feed.total_inflow=0"], "feed.inflow = [0.0, 0.0]: at least one"),
        ("makse-stratification", ["feed={total_inflow=1.0}"], "feed.inflow: missing; total_inflow"),
        (
            "makse-stratification",
            ["feed.inflow=[0.0, 0.0]", "feed.share_2=0.5"],
            "feed.share_2 = 0.5: it should be left out, for inflow = [0.0, 0.0] is no feed",
        ),
        (
            "makse-stratification",
            ["feed.inflow=[0.5, -0.5]", "feed.total_inflow=0.5"],
            "feed.inflow[1] = -0.5: it should be greater than or equal to 0",
        ),
        (
            "makse-stratification",
            [TABLE, "feed.share_2=0.5"],
            "feed.share_2 = 0.5: it should be left out, for schedule.inflow tells the feed",
        ),
        ("drum-mixture", ["feed.total_inflow=0.5"], "feed.inflow: missing; total_inflow changes"),
        (
            "ternary",
            ["feed.share_2=0.5"],
            "share_2 = 0.5: it should be left out, for inflow = [0.1, 0.1, 0.1] is not of two",
        ),
    ],
)
def test_what_cannot_be_set_is_refused_by_name(preset: str, settings: list[str], named) -> None:
    with pytest.raises(SetupError) as refusal:
        load(preset, settings)
    assert named in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("preset", "settings", "key"),
    [
        ("drum-mixture", [], "feed.total_inflow"),
        ("makse-stratification", [TABLE], "feed.total_inflow"),
        ("makse-stratification", [TABLE], "feed.share_2"),
    ],
)
def test_a_sound_set_up_refuses_what_its_feed_has_not(preset, settings, key: str) -> None:
    with pytest.raises(SetupError, match=rf"^{key} = 0.5: it should be left out, for "):
        load(preset, settings).with_values({key: 0.5})


def test_the_slope_that_was_set_is_blamed_and_no_other() -> None:
    """Of two species theta_22 moves theta_12 too, which neither m1 nor psi was told to change."""
    matrix = {"repose_slope": [[1.0, 0.2], [1.0, 0.5]]}
    with pytest.raises(SetupError, match=r"^mixture.theta_22 = 0.1: it makes .* slope of -0.2,"):
        slopes(GRAINS | matrix | {"theta_22": 0.1})
    with pytest.raises(SetupError, match=r"^mixture.delta = -0.9: it makes .* slope of -0.2,"):
        slopes(GRAINS | matrix | {"delta": -0.9})


def test_a_table_refuses_a_total_in_python_as_in_toml() -> None:
    table = Table(time=(0.0, 1.0), inflow=((1.0,), (2.0,)))
    with pytest.raises(SetupError, match=r"^total_inflow = 1: it should be left out, for schedule"):
        Feed.parse({"schedule": table, "total_inflow": 1.0})


def test_slopes_that_are_not_all_given_are_missed_by_name() -> None:
    with pytest.raises(SetupError, match=r"^mixture.names = \[\]: it should not be empty"):
        load("ternary", ["mixture.names=[]", "mixture.theta_33=1.0"])
    with pytest.raises(SetupError, match=r"^mixture.names: missing"):
        slopes({"theta_11": 1.0, "theta_22": 1.0, "theta_33": 1.0, "psi": 0.1})
    with pytest.raises(SetupError, match=r"^mixture.theta_22: missing; theta_11, theta_22, theta"):
        slopes(grains(3) | {"theta_11": 1.0, "theta_33": 1.0, "psi": 0.1})
    with pytest.raises(SetupError, match=r"^mixture.psi: missing; theta_11, theta_22, theta_33 a"):
        slopes(grains(3) | {"theta_11": 1.0, "theta_22": 1.0, "theta_33": 1.0})
    with pytest.raises(SetupError, match=r"^mixture.theta_11: missing"):
        slopes(GRAINS | {"theta_22": 1.0, "psi": 0.1})
    with pytest.raises(SetupError, match="a matrix in degrees, or 3 pure species' angles with psi"):
        slopes(grains(3) | {"repose_angle": [26.0, 35.0, 39.0]})
