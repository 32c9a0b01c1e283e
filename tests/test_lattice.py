"""The lattice: the kernel lays the reference's grains, conserves them, and maps to cm and s."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ca_model
from ca_model.arrivals import Arrivals
from ca_model.feeding import Feeding
from ca_model.lattice import MANY, Ground, Rule, lattice_of
from ca_model.pile import Pile
from compare.validation.lattice import (
    HEAP,
    SILO,
    LatticeSetup,
    agrees,
    grains_missing,
    kernels_agree,
    poured_by_reference,
    poured_on,
    still_pile,
)
from experiment import NotApplicableError, SetupError, load
from experiment.pouring.recorder import edges_of_steps
from experiment.pouring.slabs import Deposit


@st.composite
def rules(draw: st.DrawFn) -> Rule:
    """Any number of species, in any order of size, every option."""
    species = draw(st.sampled_from([1, 2, 2, 3, 5]))
    heights = draw(st.lists(st.integers(1, 4), min_size=species, max_size=species))
    rows = st.lists(st.integers(0, 12), min_size=species, max_size=species)
    return Rule(
        grain_height=np.array(heights),
        threshold=np.array(draw(st.lists(rows, min_size=species, max_size=species))),
        smallest_first=np.array(draw(st.permutations(range(species)))),
        contacts=draw(st.sampled_from([1, 2, 5, MANY])),
        percolation=draw(st.booleans()),
    )


@st.composite
def set_ups(draw: st.DrawFn) -> LatticeSetup:
    """Silos and heaps, walls and lips, rugged ground, fits of feed, sources that leap."""
    rule = draw(rules())
    species = len(rule.grain_height)
    random = np.random.default_rng(draw(st.integers(0, 2**32)))
    columns = draw(st.integers(2, 9) | st.integers(60, 70))
    sides, steps = draw(st.sampled_from([SILO, HEAP])), draw(st.integers(1, 25))
    straight = draw(st.integers(0, 6)) * np.arange(columns - 1, -1, -1)
    rugged = random.integers(0, 20, columns)
    ground = Ground(
        height=rugged if draw(st.booleans()) else straight,
        species=draw(st.integers(0, species - 1)),
        lips=draw(st.none() | st.tuples(st.integers(-3, 9), st.integers(-3, 9))),
        sides=sides,
    )
    arrivals = random.integers(0, draw(st.integers(1, 5)) + 1, (steps, sides, species))
    leaps = random.integers(0, columns + 1, steps)
    rests = np.full(steps, leaps[0])
    still = np.zeros(steps, dtype=np.int64) if sides == SILO else rests
    return LatticeSetup(
        rule, ground, arrivals, leaps if draw(st.booleans()) and sides == HEAP else still
    )


@settings(max_examples=10_000, deadline=None)
@given(set_ups())
def test_every_kernel_lays_the_references_grains(setup: LatticeSetup) -> None:
    """The one that goes step by step does so wherever the source is; the faster one, at rest."""
    assert kernels_agree(setup)


@settings(max_examples=200, deadline=None)
@given(set_ups())
def test_every_step_conserves_each_species_exactly(setup: LatticeSetup) -> None:
    assert grains_missing(setup) == 0


@settings(max_examples=200, deadline=None)
@given(set_ups(), st.integers(1, 40), st.lists(st.integers(0, 25), max_size=4))
def test_neither_the_size_of_the_log_nor_of_the_calls_changes_a_grain(setup, log, cuts) -> None:
    whole, parts = Deposit(), Deposit()
    pile = still_pile(setup, parts, log)
    for arrivals, source in zip(
        np.split(setup.arrivals, sorted(cuts)), np.split(setup.source, sorted(cuts)), strict=True
    ):
        pile.advance(arrivals, source)
    pile.flush()
    stacks = [parts.stack(i).tolist() for i in range(len(setup.ground.height))]
    assert stacks == poured_on(setup, still_pile(setup, whole, 10_000), whole)[1]


def one_step(rule: Rule, heights: list[int], grains: list[int], ground_species: int = 0):
    """A silo of these heights, one step after these grains arrived."""
    ground, deposit = Ground(np.array(heights), ground_species), Deposit()
    setup = LatticeSetup(rule, ground, np.array([[grains]]), np.zeros(1, dtype=np.int64))
    return poured_on(setup, still_pile(setup, deposit), deposit)


@pytest.mark.parametrize(("threshold", "captured"), [(2, False), (3, True)])
def test_a_grain_is_captured_only_below_its_threshold(threshold: int, captured: bool) -> None:
    rule = Rule(np.array([1, 1]), np.array([[9, 9], [threshold, 9]]), np.array([0, 1]), 1, True)
    pile, stacks = one_step(rule, [4, 2, 0], [0, 1])
    assert stacks[0] == ([1] if captured else [])
    assert pile.rolling[0, 1] == (not captured)


@pytest.mark.parametrize("percolation", [True, False])
def test_percolation_lets_only_the_smallest_species_touch(percolation: bool) -> None:
    rule = Rule(np.array([1, 2]), np.array([[0, 0], [9, 9]]), np.array([0, 1]), 1, percolation)
    pile, _ = one_step(rule, [4, 2, 0], [1, 1])
    assert pile.rolling[0].tolist() == ([1, 1] if percolation else [1, 0])


def test_a_column_sees_its_own_captures_but_not_its_neighbours() -> None:
    rule = Rule(np.array([1]), np.array([[2]]), np.array([0]), MANY, True)
    _, stacks = one_step(rule, [0, 0, 0], [5])
    assert list(map(len, stacks)) == [2, 0, 0], "slopes 0 and 1 capture, slope 2 does not"


def test_slopes_far_beyond_a_small_integer_are_slopes() -> None:
    rule = Rule(np.array([1]), np.array([[10**6]]), np.array([0]), MANY, True)
    _, stacks = one_step(rule, [10**6 - 3, 0, 0], [9])
    assert list(map(len, stacks)) == [3, 0, 0]


def test_the_presets_have_the_designs_lattice_numbers() -> None:
    lattice = lattice_of(load("lattice-stratification"))
    assert lattice.rule.grain_height.tolist() == [1, 2]
    assert lattice.rule.threshold.tolist() == [[4, 8], [1, 5]]
    assert lattice.grains_per_step == pytest.approx([2, 1])
    assert lattice.columns == 200
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
        ("ca_model.column_width=1e-4", "ca_model.unit = 0.0666667: a deposit"),
    ],
)
def test_a_wrong_lattice_is_refused_by_name(setting: str, named: str) -> None:
    with pytest.raises(SetupError) as refusal:
        ca_model.pour(load("makse-stratification", [setting]))
    assert named in str(refusal.value)


def test_heights_beyond_what_integers_hold_are_refused() -> None:
    settings = ["cell.start_slope=100.0", "cell.length=1e9", "ca_model.column_width=1e3"]
    fine = [*settings, "ca_model.unit=1e-6", "mixture.grain_diameter=[1e-6, 1e-6]"]
    with pytest.raises(SetupError, match=r"ca_model\.unit = 1e-06: heights and thresholds come to"):
        lattice_of(load("lattice-stratification", fine))


def test_a_slope_that_is_a_whole_number_but_for_round_off_is_that_number() -> None:
    settings = ["mixture.repose_slope=[[0.4, 0.4], [0.4, 0.4]]", "ca_model.column_width=3.0"]
    lattice = lattice_of(load("lattice-stratification", settings))
    assert 0.4 * 3.0 / 0.1 > 12, "by 2e-15"
    assert (lattice.rule.threshold == 12).all()


def test_the_largest_number_of_species_is_poured_alike_by_both_kernels() -> None:
    for percolation in (False, True):
        rule = Rule(np.ones(64, int), np.full((64, 64), 5), np.arange(64), MANY, percolation)
        arrivals = np.ones((3, HEAP, 64), dtype=np.int64)
        setup = LatticeSetup(
            rule, Ground(np.zeros(6, dtype=np.int64), 0, None, HEAP), arrivals, np.full(3, 3)
        )
        reference = poured_by_reference(setup)
        for source in (3, None):
            deposit = Deposit()
            pile = Pile(rule, setup.ground, deposit.lay, source=source)
            assert agrees(*poured_on(setup, pile, deposit), reference)


def test_a_source_that_moves_is_where_it_is_in_the_middle_of_a_step() -> None:
    """Columns are 1 cm wide and steps 1 s long: from 0.3 to 2.3 cm it is at 1.3 in the middle."""
    path = "feed.source={time=[0.0, 1.0, 2.0], x=[0.3, 2.3, 2.4]}"
    experiment = load("lattice-stratification", ["cell.shape=heap", "cell.length=5.0", path])
    _, source = Feeding(experiment, lattice_of(experiment)).take(np.arange(3.0))
    assert source.tolist() == [5 + 1, 5 + 2]


def test_species_of_different_speed_do_not_apply() -> None:
    with pytest.raises(NotApplicableError, match="at one speed"):
        ca_model.pour(load("makse-stratification", ["mixture.drift_velocity=[1.0, 2.0]"]))


def test_a_fixed_feed_keeps_up_with_any_rate_however_it_is_asked() -> None:
    slow, fed = Arrivals.start("fixed", np.array([0.3])), 0
    for edges in edges_of_steps(0, 10**7, 1.0, 65_536):
        fed += int(slow.take(np.full((len(edges) - 1, 1), 0.3)).sum())
    assert fed == 3_000_000
    many = Arrivals.start("fixed", np.array([150.0]))
    assert (many.take(np.full((65_536, 1), 150.0)) == 150).all()
    rates = np.tile([7.5, 1.0 / 3.0], (3000, 1))
    whole = Arrivals.start("fixed", rates[0]).take(rates)
    assert (np.abs(whole.cumsum(axis=0) - rates.cumsum(axis=0)) <= 1).all()
    assert whole[:, 0].min() == 7
    assert whole[:, 0].max() == 8


@pytest.mark.parametrize("kind", ["fixed", "poisson", "drawn"])
def test_arrivals_do_not_depend_on_how_many_are_taken_at_once(kind) -> None:
    rates = 3.0 + np.sin(np.arange(400.0))[:, None] * [2.0, -1.0, 40.0] + [0.0, 0.0, 40.0]
    whole = Arrivals.start(kind, rates.max(axis=0)).take(rates)
    split = Arrivals.start(kind, rates.max(axis=0))
    parts = [split.take(part) for part in np.split(rates, [1, 7, 200])]
    assert (np.concatenate(parts) == whole).all()


@pytest.mark.parametrize("kind", ["poisson", "drawn"])
def test_random_feeds_have_their_distributions_moments(kind) -> None:
    """Means r_a; variances r_a of Poisson variates, n p (1 - p) of drawn ones."""
    rate = np.array([2.0, 0.5, 37.5])
    steps = 40_000
    grains = Arrivals.start(kind, rate, seed=5).take(np.tile(rate, (steps, 1)))
    variance = rate if kind == "poisson" else rate * (1 - rate / rate.sum())
    error = np.sqrt(variance / steps)
    assert (np.abs(grains.mean(axis=0) - rate) < 4 * error).all()
    np.testing.assert_allclose(grains.var(axis=0), variance, rtol=0.05)
    if kind == "drawn":
        assert (grains.sum(axis=1) == 40).all()


def test_a_species_that_is_not_fed_never_arrives() -> None:
    rates = np.tile([0.0, 3.0, 0.0], (1000, 1))
    for kind in ("fixed", "poisson", "drawn"):
        grains = Arrivals.start(kind, rates[0]).take(rates)
        assert (grains[:, [0, 2]] == 0).all()
        assert grains[:, 1].sum() > 2500


def test_the_stream_is_philox_and_its_use_is_what_the_page_says() -> None:
    """Words of the generator's published key and counter; of each, the upper 53 bits."""
    words = np.random.Philox(key=np.array([7, 6], dtype=np.uint64)).random_raw(500)
    fraction = (words >> np.uint64(11)) * 2.0**-53
    drawn = Arrivals.start("drawn", np.array([1.0, 1.0]), seed=7, pile=3).take(np.ones((250, 2)))
    assert (drawn[:, 0] == (fraction < 0.5).reshape(250, 2).sum(axis=1)).all()
    left = Arrivals.start("drawn", np.array([1.0, 1.0]), seed=7, pile=3, side=1)
    assert (left.take(np.ones((250, 2))) != drawn).any()


def test_the_seed_and_the_pile_of_a_set_up_decide_a_random_pour() -> None:
    common = ["ca_model.arrivals='poisson'", "pour.duration=300.0"]
    first, again, other_seed, other_pile = (
        ca_model.pour(load("lattice-stratification", [*common, *more]))["height"]
        for more in ([], [], ["pour.seed=2"], ["pour.pile=2"])
    )
    assert first.identical(again)
    assert not first.identical(other_seed)
    assert not first.identical(other_pile)


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_a_pile_of_an_ensemble_is_that_pile_alone_on_any_number_of_threads(threads: int) -> None:
    common = ["ca_model.arrivals='drawn'", "pour.duration=500.0", "pour.records=5"]
    set_ups = [load("lattice-stratification", [*common, f"pour.pile={k}"]) for k in range(6)]
    together = ca_model.pour_many(set_ups, threads=threads)
    for set_up, archive in zip(set_ups, together, strict=True):
        assert archive.drop_attrs().identical(ca_model.pour(set_up).drop_attrs())


def test_a_feed_that_outgrows_the_surface_is_reported() -> None:
    thick = ca_model.pour(load("makse-stratification", ["ca_model.contacts=1"]))
    thin = ca_model.pour(load("makse-stratification"))
    assert "the wall column outgrew the pile" in thick.attrs["comment"]
    assert "comment" not in thin.attrs


def test_a_wall_that_is_higher_only_at_the_last_moment_is_not_reported() -> None:
    settings = ["cell.length=100.0", "feed.inflow=[1.6, 1.6]", "pour.duration=6225.0"]
    variant = ["ca_model.contacts=all", "ca_model.arrivals=drawn", "pour.pile=1"]
    archive = ca_model.pour(load("lattice-stratification", [*settings, *variant]))
    last = archive["height"].isel(time=-1)
    assert float(last[-1] - last[-2]) > 0.8, "the highest threshold, in cm"
    assert "comment" not in archive.attrs


def test_a_ground_that_is_high_by_the_wall_is_not_the_feeds_fault() -> None:
    surface = "cell.start_surface=[[0.0, 40.0], [198.5, 0.0], [200.0, 50.0]]"
    few = ("cell.start_slope=0.0", "pour.duration=10.0", "pour.records=5")
    archive = ca_model.pour(load("lattice-stratification", [surface, *few]))
    assert "comment" not in archive.attrs


def test_slopes_that_the_lattice_cannot_tell_apart_are_named() -> None:
    """Lattice slopes are whole numbers: what a repose slope does climbs a devil's staircase."""
    few = ("pour.duration=10.0", "pour.records=1")
    setting = "mixture.repose_slope=[[0.41, 0.8], [0.1, 0.5]]"
    alike = ca_model.pour(load("lattice-stratification", [setting, *few]))
    assert alike.attrs["comment"] == (
        "theta_11 = 0.41, theta_22 = 0.5 act alike: on the lattice each is a slope of 5"
    )
    equal = "mixture.repose_slope=[[0.4, 0.4], [0.1, 0.1]]"
    for known in ([], [equal]):
        assert "comment" not in ca_model.pour(load("lattice-stratification", [*few, *known])).attrs
