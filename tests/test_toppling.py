"""The toppling rule: its kernel, the rice pile that it contains, and the layers that it lays."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ca_model
from ca_model.draws import pick, random_state
from ca_model.lattice import Ground, TopplingRule
from ca_model.toppling.kernel import (
    WALL,
    TopplingPile,
    advance_toppling,
    bare_pile,
)
from ca_model.toppling.pile import ToppledPile
from ca_model.toppling.reference import ReferenceToppling
from compare import measure
from experiment import StratifyError, load
from experiment.pouring.slabs import Deposit

FRANKS = TopplingRule(np.array([1, 2]), np.array([[4, 6], [3, 5]]), spread=1)
OSLO = TopplingRule(np.array([1]), np.array([[2]]), spread=1)


@st.composite
def set_ups(draw: st.DrawFn) -> tuple[TopplingRule, np.ndarray, dict[str, int], np.ndarray, int]:
    """Rule, base, its species and lip, arrivals, seed: any number of species, either end."""
    species = draw(st.integers(1, 4))
    heights = draw(st.lists(st.integers(1, 4), min_size=species, max_size=species))
    rows = st.lists(st.integers(-1, 9), min_size=species, max_size=species)
    rule = TopplingRule(
        grain_height=np.array(heights),
        threshold=np.array(draw(st.lists(rows, min_size=species, max_size=species))),
        spread=draw(st.sampled_from([0, 1, 3, 15])),
    )
    columns = draw(st.integers(1, 12))
    base = draw(st.integers(0, 6)) * np.arange(columns - 1, -1, -1)
    ends = {
        "base_species": draw(st.integers(0, species - 1)),
        "lip": draw(st.sampled_from([WALL, -2, 0, 3])),
    }
    seed = draw(st.integers(0, 2**32))
    arrivals = np.random.default_rng(seed).integers(0, draw(st.integers(1, 4)), (40, species))
    return rule, base, ends, arrivals, seed


def pour(
    rule: TopplingRule, pile: TopplingPile, arrivals: np.ndarray, random: np.ndarray
) -> TopplingPile:
    """Add all `arrivals`, giving the stacks places as they fill."""
    due = arrivals.astype(np.int64)
    while len(due := due[advance_toppling(pile, rule, due, random) :]):
        pile = pile._replace(stack=np.concatenate([pile.stack, np.zeros_like(pile.stack)], axis=1))
    return pile


def stacks_of(pile: TopplingPile) -> list[list[int]]:
    return [pile.stack[i, : pile.grains[i]].tolist() for i in range(len(pile.grains))]


def counts(grains: list[int], species: int) -> np.ndarray:
    return np.bincount(np.array(grains, dtype=int), minlength=species)


@settings(max_examples=400, deadline=None)
@given(set_ups())
def test_kernel_and_reference_topple_the_same_grains(set_up) -> None:
    rule, base, ends, arrivals, seed = set_up
    random, same_random = random_state(seed), random_state(seed)
    pile = pour(rule, bare_pile(rule, base, random, **ends), arrivals, random)
    reference = ReferenceToppling(rule, base, same_random, **ends)
    for grains in arrivals:
        reference.step(grains)
    assert stacks_of(pile) == reference.stacks
    assert pile.height.tolist() == reference.heights[:-1]
    assert pile.k.tolist() == reference.k
    assert pile.outflow.tolist() == counts(reference.outflow, len(rule.grain_height)).tolist()
    assert random == same_random


@settings(max_examples=100, deadline=None)
@given(set_ups(), st.integers(1, 40), st.integers(1, 9))
def test_grains_are_the_same_however_the_arrivals_are_split(set_up, part, places) -> None:
    rule, base, ends, arrivals, seed = set_up
    random, same_random = random_state(seed), random_state(seed)
    whole = pour(rule, bare_pile(rule, base, random, **ends), arrivals, random)
    split = bare_pile(rule, base, same_random, **ends, places=places)
    for start in range(0, len(arrivals), part):
        split = pour(rule, split, arrivals[start : start + part], same_random)
    assert stacks_of(split) == stacks_of(whole)
    assert (split.outflow == whole.outflow).all()
    assert random == same_random


@given(set_ups(), st.integers(1, 40))
@settings(max_examples=300, deadline=None)
def test_what_is_buried_never_topples(set_up, part: int) -> None:
    rule, base, ends, arrivals, seed = set_up
    random = random_state(seed)
    free = pour(rule, bare_pile(rule, base, random, **ends), arrivals, random)

    lips = None if ends["lip"] == WALL else (0, ends["lip"])
    deposit = Deposit()
    ground = Ground(base, ends["base_species"], lips)
    buried = ToppledPile(rule, ground, deposit.lay, random_state(seed))
    for first in range(0, len(arrivals), part):
        buried.advance(arrivals[first : first + part, None], np.zeros(0))
        buried.flush()
    deposit.lay(buried.rest())
    assert [deposit.stack(i).tolist() for i in range(len(base))] == stacks_of(free)
    assert (buried.outflow == free.outflow).all()


@pytest.mark.parametrize(
    "rule",
    [
        pytest.param(TopplingRule(np.array([1, 4]), np.full((2, 2), 5), 0), id="tall grains"),
        pytest.param(TopplingRule(np.array([1, 2]), np.full((2, 2), 1), 0), id="a flat pile"),
    ],
)
def test_stacks_grow_where_burying_makes_no_room(rule: TopplingRule) -> None:
    ground = Ground(np.zeros(80, dtype=np.int64), species=0)
    pile = ToppledPile(rule, ground, Deposit().lay, random_state(0))
    arrivals = np.zeros((400, 1, 2), dtype=np.int64)
    arrivals[:, 0, 1] = 1
    pile.advance(arrivals, np.zeros(0))
    assert pile.grains_at_rest.tolist() == [0, 400]


@settings(max_examples=100, deadline=None)
@given(set_ups())
def test_every_step_conserves_each_species_and_ends_at_rest(set_up) -> None:
    rule, base, ends, arrivals, seed = set_up
    species = len(rule.grain_height)
    random = random_state(seed)
    pile = bare_pile(rule, base, random, **ends)
    for step in range(len(arrivals)):
        pile = pour(rule, pile, arrivals[step : step + 1], random)
        stacks = stacks_of(pile)
        at_rest = sum((counts(stack, species) for stack in stacks), np.zeros(species, dtype=int))
        assert (at_rest + pile.outflow == arrivals[: step + 1].sum(axis=0)).all()
        slopes = -np.diff([*pile.height, ends["lip"]])
        for i, stack in enumerate(stacks):
            assert pile.height[i] == base[i] + rule.grain_height[stack].sum()
            below, top = [ends["base_species"], ends["base_species"], *stack][-2:]
            assert not stack or slopes[i] < rule.threshold[top, below] + pile.k[i]
        if ends["lip"] == WALL:
            assert not pile.outflow.any()


def test_a_full_stack_stops_the_kernel_before_the_grain_that_could_overflow() -> None:
    random = random_state(0)
    pile = bare_pile(FRANKS, np.zeros(4), random, places=12)
    due = np.full((100, 2), 2)
    done = advance_toppling(pile, FRANKS, due, random)
    assert 0 < done < 100
    before = pile.grains.copy(), random.copy()
    assert advance_toppling(pile, FRANKS, due[done:], random) == 0
    assert (pile.grains == before[0]).all()
    assert random == before[1]
    assert 2 * 2 * done + 4 - due[done].sum() == pile.grains.sum(), "what is due was not added"


def test_a_stack_that_one_avalanche_would_overfill_stops_the_kernel_too() -> None:
    """Five grains on a high step, held by a large k until the next grain comes, fall at once."""
    random = random_state(0)
    rule = OSLO._replace(threshold=np.array([[1]]), spread=0)
    pile = bare_pile(rule, np.array([10, 0, 0]), random, places=5)
    pile.grains[:] = [5, 1, 4]
    pile.height[:] = [15, 1, 4]
    pile.k[0] = 14
    due = np.ones((1, 1), dtype=np.int64)
    assert advance_toppling(pile, rule, due, random) == 0
    pile = pour(rule, pile, due, random)
    assert pile.grains.sum() == 11
    assert pile.grains.max() > 5


@pytest.mark.parametrize(("large", "below"), [(0, 0), (0, 1), (1, 0), (1, 1)])
def test_a_grain_of_franks_topples_above_its_two_slopes(large: int, below: int) -> None:
    """z_c = 2 H_below - H_top + 2 or 3, with equal chance."""
    height = FRANKS.grain_height
    lowest = 2 * height[below] - height[large] + 2
    for slope in range(lowest - 1, lowest + 4):
        toppled = 0
        for seed in range(200):
            random = random_state(seed)
            base = np.array([slope - height[large], 0])
            pile = bare_pile(FRANKS, base, random, base_species=below)
            pour(FRANKS, pile, np.eye(2)[[large]], random)
            toppled += pile.grains[1]
        share = {lowest: 0.0, lowest + 1: 0.5}.get(slope, float(slope > lowest))
        assert toppled / 200 == pytest.approx(share, abs=0.15 * (share == 0.5))


def test_random_numbers_are_those_published_for_splitmix64() -> None:
    """The upper halves of its first outputs for seed 1234567."""
    random = np.array([1234567], dtype=np.uint64)
    outputs = [6457827717110365317, 3203168211198807973, 9817491932198370423, 4593380528125082431]
    assert [pick(random, 2**32) for _ in outputs] == [output >> 32 for output in outputs]


def rice_pile(columns: int, samples: int) -> np.ndarray:
    """Heights (sample, column) of a rice pile with an open end, after every grain, once settled."""
    random = random_state(columns)
    pile = bare_pile(OSLO, np.zeros(columns), random, lip=0, places=4 * columns + 8)
    pile = pour(OSLO, pile, np.ones((3 * columns**2, 1)), random)
    heights = np.empty((samples, columns), dtype=np.int64)
    grain = np.ones((1, 1), dtype=np.int64)
    for sample in range(samples):
        advance_toppling(pile, OSLO, grain, random)
        grain[:] = 1
        heights[sample] = pile.height
    return heights


@pytest.mark.parametrize(
    ("columns", "height", "configurations"), [(1, 3 / 2, 2), (2, 49 / 16, 5), (3, 2393 / 512, 13)]
)
def test_a_small_rice_pile_has_the_exact_height_and_configurations(
    columns: int, height: float, configurations: int
) -> None:
    """Both follow from the stationary state of the Oslo model's Markov chain."""
    heights = rice_pile(columns, 40_000)
    assert heights[:, 0].mean() == pytest.approx(height, abs=0.02)
    assert len(np.unique(heights, axis=0)) == configurations


def test_the_rice_piles_slope_approaches_1_732() -> None:
    """The Oslo model's critical slope, with nu = 4/3 (arXiv 1606.02553): L^(-1/nu) lacks."""
    half, whole = (rice_pile(size, 40_000)[:, 0].mean() / size for size in (64, 128))
    assert half < whole < 1.732
    assert whole + (whole - half) / (2**0.75 - 1) == pytest.approx(1.732, abs=0.005)


def deposit(threshold: list[list[int]], seed: int) -> list[np.ndarray]:
    """Coarseness (z,) of the columns between the ends, poured in equal volumes against a wall."""
    columns = 50
    rule = FRANKS._replace(threshold=np.array(threshold))
    random = random_state(seed)
    arrivals = np.random.default_rng(seed).multinomial(1, [2 / 3, 1 / 3], 40_000)
    base = 4 * np.arange(columns)[::-1]
    pile = pour(rule, bare_pile(rule, base, random), arrivals, random)
    laid = [np.repeat(stack, rule.grain_height[stack]) for stack in stacks_of(pile)[10:40]]
    return [coarse[len(coarse) // 3 :].astype(float) for coarse in laid]


def correlation(profiles: list[np.ndarray], longest: int) -> np.ndarray:
    """Autocorrelation of the coarseness along the vertical, averaged over columns."""
    varying = [profile - profile.mean() for profile in profiles]
    return np.array(
        [
            np.mean([c[: len(c) - lag] @ c[lag:] / (len(c) - lag) for c in varying])
            for lag in range(longest)
        ]
    )


def test_franks_numbers_lay_layers_of_one_wavelength() -> None:
    """12.6 +- 0.1 heights of a small grain on 50 columns, measured on many more grains."""
    for seed in range(3):
        repeats = correlation(deposit([[4, 6], [3, 5]], seed), 40)
        period = 4 + int(repeats[4:20].argmax())
        assert period == pytest.approx(12.6, abs=1.0)
        assert 2 * np.sqrt(repeats[period]) > 0.6
        assert repeats[period // 2] < -0.5 * repeats[period]


def test_large_grains_that_are_not_rougher_lie_apart_and_lay_no_layers() -> None:
    profiles = deposit([[5, 6], [3, 4]], 0)
    assert correlation(profiles, 40)[4:].max() < 0.02
    means = np.array([profile.mean() for profile in profiles])
    assert means[0] < 0.1
    assert means[-1] > 0.9


def test_the_papers_pile_is_a_preset_and_its_layers_are_measured(poured) -> None:
    """0.385 +- 0.004 cm, 12.8 heights of a small grain, over 8 piles; nothing is left rolling."""
    piles = [poured("ca_model", "franks", f"pour.pile={k}", "pour.records=40") for k in range(3)]
    for archive in piles:
        found = measure(archive)
        assert found["regime"].item() == "stratified"
        assert float(found["wavelength"]) == pytest.approx(0.385, abs=0.03)
        assert np.isnan(found["kink_velocity"])
        assert (archive["rolling_volume"] == 0).all()
        held = archive["deposited_volume"] + archive["outflow_volume"]
        np.testing.assert_allclose(held, archive["poured_volume"], rtol=1e-12)
    assert not piles[0]["height"].identical(piles[1]["height"])


@pytest.mark.parametrize(
    ("preset", "setting", "complaint"),
    [
        (
            "franks",
            "ca_model.contacts=1",
            "contacts = 1: only where rule = 'threshold' or 'rate' it applies",
        ),
        ("franks", "cell.shape='heap'", "cell.shape = 'heap': the toppling rule pours silos only"),
        (
            "lattice-stratification",
            "ca_model.threshold_spread=1",
            "threshold_spread = 1: only where rule = 'toppling' it applies",
        ),
    ],
)
def test_what_belongs_to_the_other_rule_is_refused(preset, setting: str, complaint: str) -> None:
    with pytest.raises(StratifyError) as refusal:
        ca_model.check(load(preset, [setting]))
    assert complaint in str(refusal.value)
