"""The lattice: the kernel lays the reference's grains, conserves them, and maps to cm and s."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ca_model
from ca_model.arrivals import Arrivals
from ca_model.kernel import Pile, advance, grains_at_rest
from ca_model.lattice import MANY, Rule, lattice_of
from ca_model.reference import ReferencePile
from experiment import NotApplicableError, SetupError, load
from experiment.recorder import edges_of_steps


@st.composite
def set_ups(draw: st.DrawFn) -> tuple[Rule, np.ndarray, int, np.ndarray]:
    """A rule, base heights, base species and arrivals: any number of species, every option."""
    species = draw(st.integers(1, 4))
    heights = draw(st.lists(st.integers(1, 4), min_size=species, max_size=species))
    rows = st.lists(st.integers(0, 12), min_size=species, max_size=species)
    rule = Rule(
        grain_height=np.array(heights),
        threshold=np.array(draw(st.lists(rows, min_size=species, max_size=species))),
        smallest_first=np.argsort(heights, kind="stable"),
        contacts=draw(st.sampled_from([1, 2, 5, MANY])),
        percolation=draw(st.booleans()),
    )
    columns = draw(st.integers(2, 12))
    slope = draw(st.integers(0, 6))
    base = slope * np.arange(columns - 1, -1, -1)
    seed = draw(st.integers(0, 2**32))
    most = draw(st.integers(1, 5))
    arrivals = np.random.default_rng(seed).integers(0, most + 1, (60, species))
    return rule, base, draw(st.integers(0, species - 1)), arrivals


def still(base: np.ndarray, base_species: int, species: int, places: int) -> Pile:
    return Pile(
        height=base.astype(np.int64),
        rolling=np.zeros((len(base), species), dtype=np.int64),
        stack=np.zeros((len(base), places), dtype=np.int8),
        grains=np.zeros(len(base), dtype=np.int64),
        base_species=base_species,
    )


@settings(max_examples=400, deadline=None)
@given(set_ups())
def test_kernel_and_reference_lay_the_same_grains(set_up) -> None:
    rule, base, base_species, arrivals = set_up
    pile = still(base, base_species, len(rule.grain_height), places=int(arrivals.sum()) + 1)
    reference = ReferencePile(rule, base, base_species)
    for grains in arrivals:
        reference.step(grains)
    assert advance(pile, rule, arrivals) == len(arrivals)
    stacks = [list(pile.stack[i, : pile.grains[i]]) for i in range(len(base))]
    assert stacks == reference.stacks
    assert pile.height.tolist() == reference.heights
    assert pile.rolling.tolist() == reference.rolling


@settings(max_examples=50, deadline=None)
@given(set_ups())
def test_every_step_conserves_each_species_exactly(set_up) -> None:
    rule, base, base_species, arrivals = set_up
    pile = still(base, base_species, len(rule.grain_height), places=int(arrivals.sum()) + 1)
    fed = np.zeros(len(rule.grain_height), dtype=np.int64)
    for k in range(len(arrivals)):
        advance(pile, rule, arrivals[k : k + 1])
        fed += arrivals[k]
        assert (grains_at_rest(pile) + pile.rolling.sum(axis=0) == fed).all()
        assert (pile.height - base).sum() == grains_at_rest(pile) @ rule.grain_height


def test_a_full_stack_stops_the_kernel_before_the_step_that_would_overflow() -> None:
    rule = Rule(np.array([1]), np.array([[3]]), np.array([0]), 1, True)
    pile = still(np.zeros(4, dtype=np.int64), 0, 1, places=5)
    arrivals = np.full((100, 1), 2)
    done = advance(pile, rule, arrivals)
    assert 0 < done < 100
    before = pile.grains.copy()
    assert advance(pile, rule, arrivals[done:]) == 0
    assert (pile.grains == before).all()
    assert pile.grains.max() <= 5


@pytest.mark.parametrize(("threshold", "captured"), [(2, False), (3, True)])
def test_a_grain_is_captured_only_below_its_threshold(threshold: int, captured: bool) -> None:
    rule = Rule(np.array([1, 1]), np.array([[9, 9], [threshold, 9]]), np.array([0, 1]), 1, True)
    pile = still(np.array([4, 2, 0]), 0, 2, places=9)
    advance(pile, rule, np.array([[0, 1]]))
    assert pile.grains[0] == captured
    assert pile.rolling[0, 1] == (not captured)


@pytest.mark.parametrize("percolation", [True, False])
def test_percolation_lets_only_the_smallest_species_touch(percolation: bool) -> None:
    rule = Rule(np.array([1, 2]), np.array([[0, 0], [9, 9]]), np.array([0, 1]), 1, percolation)
    pile = still(np.array([4, 2, 0]), 0, 2, places=9)
    advance(pile, rule, np.array([[1, 1]]))
    assert pile.rolling[0].tolist() == ([1, 1] if percolation else [1, 0])


def test_a_column_sees_its_own_captures_but_not_its_neighbours() -> None:
    rule = Rule(np.array([1]), np.array([[2]]), np.array([0]), MANY, True)
    pile = still(np.array([0, 0, 0]), 0, 1, places=30)
    advance(pile, rule, np.array([[5]]))
    assert pile.grains.tolist() == [2, 0, 0], "slopes 0 and 1 capture, slope 2 does not"


def test_the_presets_have_the_designs_lattice_numbers() -> None:
    lattice = lattice_of(load("lattice-stratification"))
    assert lattice.rule.grain_height.tolist() == [1, 2]
    assert lattice.rule.threshold.tolist() == [[4, 8], [1, 5]]
    assert lattice.grains_per_step == pytest.approx([2, 1])
    assert len(lattice.base) == 200
    segregating = lattice_of(load("lattice-segregation")).rule
    assert segregating.threshold.tolist() == [[5, 7], [2, 4]]


def test_a_physical_set_up_maps_to_lattice_units_and_back() -> None:
    experiment = load("glass-sugar")
    lattice = lattice_of(experiment)
    assert (lattice.unit, lattice.column_width) == pytest.approx((0.027, 0.27))
    assert lattice.rule.grain_height.tolist() == [1, 3]
    assert lattice.step == pytest.approx(0.027)
    slopes = np.array(experiment.mixture.repose_slope)
    assert (lattice.rule.threshold == np.ceil(10 * slopes)).all()
    assert lattice.grains_per_step * lattice.grain_thickness == pytest.approx([0.125, 0.125])
    archive = ca_model.pour(experiment.model_copy(update={"pour": short(experiment, 5.0)}))
    poured = archive["poured_volume"].isel(time=-1)
    np.testing.assert_allclose(poured, 0.125 * 10.0 * 5.0, rtol=0.02)
    rolling = archive["rolling_thickness"] / lattice.grain_thickness
    np.testing.assert_allclose(rolling, rolling.round(), atol=1e-9)


def short(experiment, duration: float):
    return experiment.pour.model_copy(update={"duration": duration, "records": 10})


@pytest.mark.parametrize(
    ("setting", "named"),
    [
        ("ca_model.contacts=0", "ca_model.contacts"),
        ("ca_model.arrivals='late'", "ca_model.arrivals"),
        ("ca_model.contacts='some'", "ca_model.contacts = 'some': it should be a whole number"),
        ("feed.inflow=[1e6, 1.0]", "feed.inflow = [1000000.0, 1.0]: it makes 1.5e+07 grains"),
        ("ca_model.unit=0.07", "ca_model.unit = 0.07"),
        ("cell.start_composition=[0.5, 0.5]", "cell.start_composition = [0.5, 0.5]"),
        ("ca_model.column_width=90.0", "ca_model.column_width = 90"),
        ("ca_model.width=1.0", "no field 'width'"),
    ],
)
def test_a_wrong_lattice_is_refused_by_name(setting: str, named: str) -> None:
    with pytest.raises(SetupError) as refusal:
        ca_model.pour(load("makse-stratification", [setting]))
    assert named in str(refusal.value)


def test_species_of_different_speed_do_not_apply() -> None:
    with pytest.raises(NotApplicableError, match="at one speed"):
        ca_model.pour(load("makse-stratification", ["mixture.drift_velocity=[1.0, 2.0]"]))


def test_a_fixed_feed_keeps_up_with_any_rate_however_it_is_asked() -> None:
    rates = np.tile([7.5, 1.0 / 3.0], (3000, 1))
    slow, poured = Arrivals("fixed", np.random.default_rng(0), np.zeros(1, dtype=np.int64)), 0
    for edges in edges_of_steps(0, 10**7, 1.0):
        poured += int(slow.take(np.full((len(edges) - 1, 1), 0.3)).sum())
    assert poured == 3_000_000
    many = Arrivals("fixed", np.random.default_rng(0), np.zeros(1, dtype=np.int64))
    assert (many.take(np.full((65_536, 1), 150.0)) == 150).all()
    whole = Arrivals("fixed", np.random.default_rng(0), np.zeros(2, dtype=np.int64)).take(rates)
    split = Arrivals("fixed", np.random.default_rng(0), np.zeros(2, dtype=np.int64))
    assert (np.concatenate([split.take(rates[:7]), split.take(rates[7:])]) == whole).all()
    assert (np.abs(whole.cumsum(axis=0) - rates.cumsum(axis=0)) <= 1).all()
    assert whole[:, 0].min() == 7
    assert whole[:, 0].max() == 8


@pytest.mark.parametrize("kind", ["poisson", "drawn"])
def test_random_feeds_have_the_right_mean_and_repeat_with_their_seed(kind) -> None:
    rates = np.tile([2.0, 1.0], (4000, 1))
    grains = Arrivals(kind, np.random.default_rng(5), np.zeros(2, dtype=np.int64)).take(rates)
    again = Arrivals(kind, np.random.default_rng(5), np.zeros(2, dtype=np.int64)).take(rates)
    other = Arrivals(kind, np.random.default_rng(6), np.zeros(2, dtype=np.int64)).take(rates)
    assert (grains == again).all()
    assert (grains != other).any()
    np.testing.assert_allclose(grains.mean(axis=0), [2.0, 1.0], rtol=0.1)
    if kind == "drawn":
        assert (grains.sum(axis=1) == 3).all()


def test_the_seed_of_the_set_up_decides_a_random_pour() -> None:
    common = ["ca_model.arrivals='poisson'", "pour.duration=300.0"]
    pours = [
        ca_model.pour(load("lattice-stratification", [*common, f"pour.seed={seed}"]))["height"]
        for seed in (1, 1, 2)
    ]
    assert pours[0].identical(pours[1])
    assert not pours[0].identical(pours[2])


def test_a_feed_that_outgrows_the_surface_is_reported() -> None:
    thick = ca_model.pour(load("makse-stratification", ["ca_model.contacts=1"]))
    thin = ca_model.pour(load("makse-stratification"))
    assert "the wall column outgrew the pile" in thick.attrs["comment"]
    assert "comment" not in thin.attrs
