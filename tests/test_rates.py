"""The rate rule: its kernel lays the reference's grains; its limits are the other two models."""

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from ca_model.draws import binomial, chance_within, random_state
from ca_model.lattice import MANY, Ground, RateRule, Rule, lattice_of
from ca_model.pile import Pile
from ca_model.rates.pile import RatePile
from ca_model.rates.reference import ReferenceRates
from experiment import SetupError, load
from experiment.arrays import Ints
from experiment.law import Law
from experiment.pouring.slabs import Deposit

SILO, HEAP = 1, 2


class Setup(NamedTuple):
    """A rule, a ground, what arrives (step, side, species) beside the edge `source` (step,)."""

    rule: RateRule
    ground: Ground
    arrivals: Ints
    source: Ints
    seed: int


def rule_of(slopes: list[list[float]], rates: list[list[float]], **others: object) -> RateRule:
    """Columns as wide as ten units, in a second of which grains roll through one."""
    n = len(slopes)
    law = Law(
        repose_slope=tuple(map(tuple, slopes)),
        collision_rate=tuple(map(tuple, rates)),
        cross_amplification=((0.0,) * n,) * n,
        smoothing=0.0,
        surface_depth=0.2,
        curvature_length=0.0,
    )
    rule = RateRule(
        grain_height=np.arange(1, n + 1),
        smallest_first=np.arange(n),
        law=law,
        rigid_fraction=(1.0,) + (0.0,) * (n - 1),
        contacts=MANY,
        sharpness=1.0,
        amplification=1.0,
        depth=4,
        unit=0.1,
        width=1.0,
        step=1.0,
    )
    return rule._replace(**others)


@st.composite
def rules(draw: st.DrawFn) -> RateRule:
    """Any number of species, in any order of size, every option."""
    n = draw(st.sampled_from([1, 2, 2, 3]))
    numbers = np.random.default_rng(draw(st.integers(0, 2**32)))
    mu = numbers.uniform(0, 0.3, (n, n)) * draw(st.sampled_from([0.0, 1.0]))
    np.fill_diagonal(mu, 0.0)
    rule = rule_of(
        numbers.uniform(0, 1, (n, n)).tolist(),
        (numbers.uniform(0, 1, (n, n)) * draw(st.sampled_from([0.3, 1.0, 5.0]))).tolist(),
        grain_height=numbers.integers(1, 5, n),
        smallest_first=numbers.permutation(n),
        rigid_fraction=tuple(numbers.dirichlet(np.ones(n)).tolist()),
        contacts=draw(st.sampled_from([1, 3, MANY])),
        sharpness=draw(st.sampled_from([1.0, 7.0, 1e12])),
        amplification=draw(st.sampled_from([0.0, 0.3, 1.0])),
        depth=draw(st.integers(1, 12)),
    )
    law = rule.law._replace(
        cross_amplification=tuple(map(tuple, mu.tolist())),
        smoothing=draw(st.sampled_from([0.0, 0.2])),
        curvature_length=draw(st.sampled_from([0.0, 0.3])),
    )
    return rule._replace(law=law)


@st.composite
def set_ups(draw: st.DrawFn) -> Setup:
    """Silos and heaps, walls and lips, rugged ground, fits of feed, sources that leap."""
    rule = draw(rules())
    species = len(rule.grain_height)
    numbers = np.random.default_rng(draw(st.integers(0, 2**32)))
    columns, sides = draw(st.integers(2, 9)), draw(st.sampled_from([SILO, HEAP]))
    steps = draw(st.integers(1, 20))
    straight = draw(st.integers(0, 9)) * np.arange(columns - 1, -1, -1)
    ground = Ground(
        height=numbers.integers(0, 20, columns) if draw(st.booleans()) else straight,
        species=0,
        lips=draw(st.none() | st.tuples(st.integers(-3, 9), st.integers(-3, 9))),
        sides=sides,
    )
    arrivals = numbers.integers(0, draw(st.integers(1, 30)) + 1, (steps, sides, species))
    leaps = numbers.integers(0, columns + 1, steps)
    rests = np.full(steps, leaps[0])
    still = np.zeros(steps, dtype=np.int64) if sides == SILO else rests
    source = leaps if draw(st.booleans()) and sides == HEAP else still
    return Setup(rule, ground, arrivals, source, draw(st.integers(0, 2**32)))


def bare(setup: Setup, deposit: Deposit, most_places: int | None = None) -> RatePile:
    return RatePile(
        setup.rule, setup.ground, deposit, random_state(setup.seed), most_places=most_places
    )


def told(pile: RatePile, deposit: Deposit) -> dict[str, object]:
    """All that can be asked of a pile, and its stacks."""
    rest = pile.rest()
    stacks = [
        [*deposit.stack(i).tolist(), *rest.share(i).tolist()] for i in range(len(pile.height))
    ]
    return {
        "height": pile.height.tolist(),
        "rolling": pile.rolling.tolist(),
        "outflow": pile.outflow.tolist(),
        "at rest": pile.grains_at_rest.tolist(),
        "surface": pile.surface_fraction.tolist(),
        "stacks": stacks,
    }


def told_by_reference(pile: ReferenceRates) -> dict[str, object]:
    """The same of the reference; of a layer, which has no order, the tallest grains first."""
    species = range(len(pile.outflow))
    stacks = [
        [*buried, *(a for a in reversed(pile.species) for _ in range(layer[a]))]
        for buried, layer in zip(pile.buried, pile.layer, strict=True)
    ]
    flows = np.sum(pile.rolling, axis=0)
    surfaces = [pile.surface(i)[0] for i in range(pile.columns)]
    return {
        "height": pile.heights,
        "rolling": flows.tolist(),
        "outflow": pile.outflow,
        "at rest": [sum(stack.count(a) for stack in stacks) for a in species],
        "surface": [[surface[a] for a in species] for surface in surfaces],
        "stacks": stacks,
    }


@settings(max_examples=1000, deadline=None)
@given(set_ups())
def test_the_kernel_lays_the_references_grains(setup: Setup) -> None:
    deposit = Deposit()
    pile = bare(setup, deposit)
    reference = ReferenceRates(setup.rule, setup.ground, random_state(setup.seed))
    pile.advance(setup.arrivals, setup.source)
    for grains, source in zip(setup.arrivals, setup.source, strict=True):
        reference.step(grains.tolist(), int(source))
    assert told(pile, deposit) == told_by_reference(reference)


@settings(max_examples=300, deadline=None)
@given(set_ups())
def test_every_step_conserves_each_species_exactly(setup: Setup) -> None:
    pile = bare(setup, Deposit())
    poured = np.zeros(len(setup.rule.grain_height), dtype=np.int64)
    for step in range(len(setup.arrivals)):
        pile.advance(setup.arrivals[step : step + 1], setup.source[step : step + 1])
        poured += setup.arrivals[step].sum(axis=0)
        there = pile.rolling.sum(axis=0) + pile.grains_at_rest + pile.outflow
        assert (there == poured).all()
        raised = pile.height.sum() - setup.ground.height.sum()
        assert raised == pile.grains_at_rest @ setup.rule.grain_height


@settings(max_examples=300, deadline=None)
@given(set_ups(), st.lists(st.integers(0, 20), max_size=4))
def test_neither_what_is_handed_on_nor_the_size_of_the_calls_changes_a_grain(
    setup: Setup, cuts: list[int]
) -> None:
    whole, parts = Deposit(), Deposit()
    at_once, in_parts = bare(setup, whole), bare(setup, parts, most_places=1)
    at_once.advance(setup.arrivals, setup.source)
    for arrivals, source in zip(
        np.split(setup.arrivals, sorted(cuts)), np.split(setup.source, sorted(cuts)), strict=True
    ):
        in_parts.advance(arrivals, source)
    assert told(in_parts, parts) == told(at_once, whole)


def test_what_was_handed_on_is_taken_back_where_the_flow_digs() -> None:
    rule = rule_of([[0.4, 0.8], [0.1, 0.5]], [[2.0, 2.0], [2.0, 2.0]])
    flat = Ground(height=np.zeros(12, dtype=np.int64), species=0)
    grains = np.zeros((4000, 1, 2), dtype=np.int64)
    grains[:3000, 0, 0] = 4
    grains[3000:, 0, 1] = 40
    setup = Setup(rule, flat, grains, np.zeros(len(grains), dtype=np.int64), 5)
    whole, parts = Deposit(), Deposit()
    at_once, in_parts = bare(setup, whole), bare(setup, parts, most_places=1)
    laid, taken = [], []
    lay, take_back = parts.lay, parts.take_back
    parts.lay = lambda slab: (laid.append(1), lay(slab))[1]  # type: ignore[method-assign]
    parts.take_back = lambda: (taken.append(1), take_back())[1]  # type: ignore[method-assign]
    for pile in (at_once, in_parts):
        pile.advance(setup.arrivals, setup.source)
    assert told(in_parts, parts) == told(at_once, whole)
    assert laid
    assert taken


@settings(max_examples=200, deadline=None)
@given(set_ups(), st.integers(0, 20))
def test_a_state_put_back_goes_on_as_if_nothing_had_been(setup: Setup, cut: int) -> None:
    deposit = Deposit()
    pile, other = bare(setup, deposit), bare(setup, deposit)
    pile.advance(setup.arrivals[:cut], setup.source[:cut])
    state = {name: array.copy() for name, array in pile.state().items()}
    pile.advance(setup.arrivals[cut:], setup.source[cut:])
    other.restore(state)
    other.advance(setup.arrivals[cut:], setup.source[cut:])
    assert told(other, deposit) == told(pile, deposit)


@settings(max_examples=200, deadline=None)
@given(st.integers(0, 2**32), st.sampled_from([2, 3]))
def test_ever_sharper_capture_of_single_grains_is_the_threshold_rule(
    seed: int, species: int
) -> None:
    """One contact a step, nothing set rolling, a surface of one grain: the same stacks."""
    numbers = np.random.default_rng(seed)
    thresholds = numbers.integers(0, 12, (species, species))
    slopes = (thresholds - 0.5) / 10
    rates = np.full((species, species), 1e-3)
    sharp = rule_of(
        slopes.tolist(), rates.tolist(), contacts=1, sharpness=1e12, amplification=0.0, depth=1
    )
    rule = Rule(sharp.grain_height, thresholds, sharp.smallest_first, 1, True)
    columns, steps = 9, 200
    ground = Ground(3 * np.arange(columns)[::-1], 0)
    arrivals = numbers.integers(0, 3, (steps, 1, species))
    still = np.zeros(steps, dtype=np.int64)
    here, there = Deposit(), Deposit()
    by_rates = RatePile(sharp, ground, here, random_state(seed))
    by_threshold = Pile(rule, ground, there.lay)
    for pile in (by_rates, by_threshold):
        pile.advance(arrivals, still)
    by_threshold.flush()
    stacks = [there.stack(i).tolist() for i in range(columns)]
    assert told(by_rates, here)["stacks"] == stacks
    assert by_rates.rolling.tolist() == by_threshold.rolling.tolist()


@pytest.mark.parametrize("expected", [0.0, 1e-12, 1e-3, 0.1, 1.0, 5.0, 16.0, 39.9, 41.0, 1e300])
def test_a_chance_is_that_of_a_rate_to_eight_decimals(expected: float) -> None:
    exact = -np.expm1(-expected)
    assert chance_within(expected) == pytest.approx(exact, abs=1e-8, rel=1e-8)
    assert 0 <= chance_within(expected) <= 1


@pytest.mark.parametrize(
    ("n", "chance"), [(1, 0.3), (9, 0.02), (30, 0.5), (200, 0.97), (5000, 0.01), (5000, 0.4)]
)
def test_a_binomial_variate_has_its_distribution(n: int, chance: float) -> None:
    random = random_state(11)
    drawn = np.array([binomial(random, n, chance) for _ in range(20_000)])
    law = stats.binom(n, chance)
    assert drawn.min() >= 0
    assert drawn.max() <= n
    assert drawn.mean() == pytest.approx(law.mean(), abs=5 * law.std() / np.sqrt(len(drawn)))
    edges = np.unique(law.ppf(np.linspace(0.02, 0.98, 13)))
    seen = np.array([(drawn <= edge).mean() for edge in edges])
    assert np.abs(seen - law.cdf(edges)).max() < 1.95 / np.sqrt(len(drawn)), "Kolmogorov, 0.1 %"


def test_what_is_certain_or_impossible_draws_no_number() -> None:
    random = random_state(3)
    before = random.copy()
    assert [binomial(random, 7, 1.0), binomial(random, 7, 0.0), binomial(random, 0, 0.5)] == [
        7,
        0,
        0,
    ]
    assert (random == before).all()


def test_between_plates_a_grain_takes_its_true_volume() -> None:
    """A bead of 0.27 mm and a cube of 0.8 mm in columns of ten beads, in a gap of 5 mm."""
    lattice = lattice_of(load("glass-sugar", ["ca_model.rule=rate", "ca_model.gap=0.5"]))
    assert lattice.column_width == pytest.approx(0.27)
    assert lattice.unit * lattice.column_width * 0.5 == pytest.approx(0.027**3)
    assert lattice.rule.grain_height.tolist() == [1, round((0.08 / 0.027) ** 3)]
    assert lattice.rule.depth == round(0.0535 / lattice.unit)


@pytest.mark.parametrize(
    ("settings", "complaint"),
    [
        (["ca_model.gap=0.07"], "ca_model.gap = 0.07: it should be no less than the largest"),
        (["ca_model.gap=0.5", "ca_model.unit=0.001"], "height of the smallest grain, 0.000146"),
        (["ca_model.rule=threshold", "ca_model.gap=0.5"], "gap = 0.5: only where rule = 'rate'"),
        (["ca_model.percolation=true"], "percolation = True: only where rule = 'threshold'"),
        (["ca_model.amplification=1.1"], "ca_model.amplification = 1.1"),
        (["ca_model.sharpness=0.0"], "ca_model.sharpness = 0.0"),
    ],
)
def test_a_wrong_table_is_refused_in_one_line(settings: list[str], complaint: str) -> None:
    with pytest.raises(SetupError) as refusal:
        lattice_of(load("glass-sugar", ["ca_model.rule=rate", *settings]))
    assert complaint in str(refusal.value)
    assert "\n" not in str(refusal.value)
