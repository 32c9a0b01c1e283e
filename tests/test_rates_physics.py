"""What the rate rule does, seed by seed and on average: the continuum's law, and no other.

A column and a sub-step are held against the law, written here once more from the paper; whole pours
against the continuum's first-order scheme on the same grid. Lengths are in cm, times in s.
"""

from typing import NamedTuple

import numpy as np
import pytest
from test_rates import SILO, rule_of

import ca_model
from ca_model.draws import random_state
from ca_model.lattice import Ground, RateRule
from ca_model.rates.pile import RatePile
from compare.validation.rates import (
    GRAINS,
    POURS,
    SHARE,
    Pour,
    differences,
    exponents,
    noise_of,
    on_one_grid,
)
from experiment import NotApplicableError, SetupError, load
from experiment.arrays import Floats, Ints
from experiment.law import interaction
from experiment.pouring.slabs import Deposit

COLUMNS, ALIKE = 30_000, 2000
SIGMAS = 4.5
MOST_ROLLING = 3  # grains of a species in a column


class State(NamedTuple):
    """Columns in any state, before a step and as the exchange in it finds them."""

    height: Ints  # (column,) u
    rolling: Ints  # (column, species) grains
    layer: Ints  # (column, species) grains
    buried: Ints  # (column,) grains below it


class Chances(NamedTuple):
    """What a grain of each species (column, species) is in for in a sub-step."""

    captured: Floats
    set_rolling: Floats


def a_rule(species: int, **of_law: object) -> RateRule:
    """Unlike in every rate and slope, columns ten units wide; a step is the longest sub-step."""
    numbers = np.random.default_rng(7)
    slopes = numbers.uniform(0.3, 1.0, (species, species))
    rates = numbers.uniform(0.2, 1.5, (species, species))
    mu = numbers.uniform(0.0, 0.5, (species, species)) * (1 - np.eye(species))
    rule = rule_of(
        slopes.tolist(),
        rates.tolist(),
        rigid_fraction=tuple(numbers.dirichlet(np.ones(species)).tolist()),
        depth=8,
    )
    matrix = tuple(map(tuple, mu.tolist()))
    law = rule.law._replace(cross_amplification=matrix, **of_law)
    thickest = MOST_ROLLING * rule.grain_height * rule.unit
    climb = rates.max(axis=1) @ thickest * (1 + 2 * law.curvature_length / rule.width)
    return rule._replace(law=law, step=0.249 * rule.width / float(climb))


def any_state(rule: RateRule) -> State:
    """Rugged, about as steep as the slopes of repose, on grains or on what lay there before."""
    numbers, species = np.random.default_rng(8), len(rule.grain_height)
    steep = 7 * np.arange(COLUMNS)[::-1]
    tallest = int(rule.grain_height.max())
    layer = np.zeros((COLUMNS, species), dtype=np.int64)
    for _ in range(rule.depth):
        a = numbers.integers(0, species, COLUMNS)
        fits = layer @ rule.grain_height + tallest <= rule.depth - numbers.integers(0, 3, COLUMNS)
        layer[np.arange(COLUMNS), a] += fits
    return State(
        height=steep + numbers.integers(-3, 4, COLUMNS),
        rolling=numbers.integers(0, MOST_ROLLING + 1, (COLUMNS, species)),
        layer=layer,
        buried=numbers.integers(0, 2, COLUMNS) * 20,
    )


def in_state(rule: RateRule, state: State, seed: int) -> RatePile:
    """A silo with open ends in which grains are about to roll to where `state` has them."""
    lips = int(state.height[0] + 7), int(state.height[-1] - 7)
    pile = RatePile(rule, Ground(state.height, 0, lips, SILO), Deposit(), random_state(seed))
    there = pile.state()
    there["layer"][:] = state.layer.T
    there["grains"][:] = state.buried
    there["places"][:] = 64 + state.buried.max()
    there["stack"] = np.zeros(int(state.buried.sum()), dtype=np.int8)
    there["rolling"][0, :, :-2] = state.rolling.T
    pile.restore(there)
    return pile


def surface_of(rule: RateRule, state: State) -> tuple[Floats, Floats]:
    """Composition (column, species) and thickness (column,) of surface layers."""
    volume = state.layer * rule.grain_height
    held = volume.sum(axis=1)
    lacks = np.where(state.buried == 0, rule.depth - held, 0)
    whole = volume + lacks[:, None] * np.array(rule.rigid_fraction)
    return whole / (held + lacks)[:, None], (held + lacks) * rule.unit


def slope_of(rule: RateRule, state: State) -> Floats:
    """S = theta - l d2h/dx2 (column,), towards the downhill neighbour; ends are left to others."""
    h, w = state.height * rule.unit, rule.width
    theta = (h - np.roll(h, -1)) / w
    bend = (np.roll(h, 1) - 2 * h + np.roll(h, -1)) / w**2
    return theta - rule.law.curvature_length * bend


def rates_by_hand(rule: RateRule, state: State) -> tuple[Floats, Floats]:
    """Capture [1/s] and amplification [cm/s] (column, species) of Makse, Eq. (mcs-r), with mu."""
    law = rule.law
    phi, _ = surface_of(rule, state)
    theta = phi @ np.array(law.repose_slope).T
    gap = theta - slope_of(rule, state)[:, None]

    def positive(z: Floats) -> Floats:
        return (z + np.sqrt(z**2 + law.smoothing**2)) / 2

    gamma, mu = np.array(law.collision_rate), np.array(law.cross_amplification)
    thickness = state.rolling * rule.grain_height * rule.unit
    struck = np.einsum("ba,ib->ia", mu, thickness)
    struck += np.einsum("ba,ib,ib->ia", gamma, positive(-gap), thickness)
    return np.diag(gamma) * positive(gap), struck


def chances_of(rule: RateRule, state: State) -> Chances:
    capture, struck = rates_by_hand(rule, state)
    thickness = surface_of(rule, state)[1][:, None]
    return Chances(
        -np.expm1(-rule.sharpness * capture * rule.step),
        -np.expm1(-rule.amplification * struck * rule.step / thickness),
    )


LAWS = [
    (1, {}),
    (2, {"curvature_length": 0.3}),
    (2, {"smoothing": 0.2}),
    (3, {"smoothing": 0.1, "curvature_length": 0.2}),
]


@pytest.mark.parametrize(("species", "of_law"), LAWS)
def test_a_sub_step_captures_and_sets_rolling_with_the_chances_of_the_law(
    species: int, of_law: dict[str, object]
) -> None:
    """Mean and variance, binomial, of every species where it is captured and where it is not."""
    rule = a_rule(species, **of_law)
    state = any_state(rule)
    gained, expected, variance = [], [], []
    captured, set_rolling = chances_of(rule, state)
    for seed in range(3):
        pile = in_state(rule, state, seed)
        pile.advance(np.zeros((1, 1, species), dtype=np.int64), np.zeros(1, dtype=np.int64))
        gained.append((pile.rolling - state.rolling)[1:-1])
    expected = (set_rolling * state.layer - captured * state.rolling)[1:-1]
    variance = set_rolling * (1 - set_rolling) * state.layer
    variance = (variance + captured * (1 - captured) * state.rolling)[1:-1]
    error = np.array(gained) - expected
    capturing = (captured > set_rolling)[1:-1]
    for a in range(species):
        for where in (capturing[:, a], ~capturing[:, a]):
            there, spread = error[:, where, a], variance[where, a]
            assert spread.sum() > 100, "columns of either sign"
            assert abs(there.sum()) < SIGMAS * np.sqrt(3 * spread.sum())
            excess = (there**2 - spread).ravel()
            assert abs(excess.mean()) < SIGMAS * excess.std() / np.sqrt(excess.size)
            leaning = (there * (set_rolling - captured)[1:-1][where, a]).ravel()
            assert abs(leaning.mean()) < SIGMAS * leaning.std() / np.sqrt(leaning.size)
    assert (error[:, variance == 0] == 0).all()


@pytest.mark.parametrize(("species", "of_law"), LAWS)
def test_in_a_short_time_what_settles_is_the_continuums_interaction(
    species: int, of_law: dict[str, object]
) -> None:
    """The chances above are of Gamma_a dt, the function that the continuum solves, as dt -> 0."""
    rule = a_rule(species, **of_law)._replace(step=1e-7)
    state = any_state(rule)
    phi, thickness = surface_of(rule, state)
    height = np.array(rule.grain_height) * rule.unit
    captured, set_rolling = chances_of(rule, state)
    gained = (set_rolling * state.layer - captured * state.rolling) * height / rule.step
    of_ground = phi - state.layer * height / thickness[:, None]
    rate = interaction((state.rolling * height).T, phi.T, slope_of(rule, state), rule.law).T
    _, struck = rates_by_hand(rule, state)
    inner = np.s_[1:-1]
    of_grains = (rate - of_ground * struck)[inner]
    assert np.allclose(gained[inner], of_grains, rtol=1e-5, atol=1e-6)
    assert of_grains.min() < -0.1
    assert of_grains.max() > 0.1


def layered_pile(rule: RateRule, buried: Ints, layer: Ints, rolling: Ints, drop: int) -> RatePile:
    """Columns that are all alike, each `drop` units above the next."""
    state = State(
        height=drop * np.arange(ALIKE)[::-1],
        rolling=np.tile(rolling, (ALIKE, 1)),
        layer=np.tile(layer, (ALIKE, 1)),
        buried=np.full(ALIKE, len(buried)),
    )
    pile = in_state(rule, state, seed=1)
    there = pile.state()
    there["stack"][:] = np.tile(buried, ALIKE)
    pile.restore(there)
    return pile


def one_step(pile: RatePile) -> State:
    """The state after a step in which nothing is fed."""
    species = len(pile.outflow)
    pile.advance(np.zeros((1, 1, species), dtype=np.int64), np.zeros(1, dtype=np.int64))
    state = pile.state()
    inner = np.s_[2:-2]
    return State(
        pile.height[inner], pile.rolling[inner], state["layer"].T[inner], state["grains"][inner]
    )


def test_all_columns_find_their_slope_from_the_heights_of_one_instant() -> None:
    """Small grains are captured everywhere; seen by a neighbour, they would stop the large ones."""
    calm = rule_of([[1.0, 1.0], [0.79, 0.79]], [[1e-3, 0.0], [0.0, 1e-3]])
    law = calm.law._replace(curvature_length=0.5)
    rule = calm._replace(law=law, sharpness=1e12, amplification=0.0)
    pile = layered_pile(rule, np.zeros(9, np.int8), np.array([4, 0]), np.array([5, 5]), 8)
    assert (one_step(pile).rolling == [0, 5]).all()


def test_what_a_sub_step_captures_leaves_the_surface_as_mixed_as_it_came() -> None:
    """Half of a layer's grains anew, small and large in equal numbers: neither covers the other."""
    calm = rule_of([[1.0, 1.0], [1.0, 1.0]], [[1e-3, 0.0], [0.0, 1e-3]])
    rule = calm._replace(grain_height=np.array([1, 1]), depth=24, sharpness=1e12, amplification=0.0)
    pile = layered_pile(rule, np.zeros(9, np.int8), np.array([12, 12]), np.array([6, 6]), 0)
    share = one_step(pile).layer[:, 0] / 24
    assert share.mean() == pytest.approx(0.5, abs=SIGMAS * share.std() / np.sqrt(share.size))


@pytest.mark.parametrize("tall", [1, 2, 3])
@pytest.mark.parametrize("depth", [6, 24, 96])
def test_what_a_layer_held_fades_with_what_is_captured_as_hiranos_does(
    depth: int, tall: int
) -> None:
    """As exp(-c / d), but for the grain that the newest one takes the place of: of order u / d."""
    calm = rule_of([[1.0, 1.0], [1.0, 1.0]], [[1e-3, 0.0], [0.0, 1e-3]])
    rule = calm._replace(
        grain_height=np.array([1, tall]), depth=depth, sharpness=1e12, amplification=0.0
    )
    grains = depth // tall
    pile = layered_pile(rule, np.zeros(9, np.int8), np.array([depth, 0]), np.array([0, grains]), 0)
    after = one_step(pile)
    assert (after.rolling == 0).all()
    held = after.layer @ rule.grain_height
    assert ((held > depth - tall) & (held <= depth)).all()
    left = after.layer[:, 0].mean() / depth
    assert left == pytest.approx(np.exp(-grains * tall / depth), abs=tall / depth)
    if tall == 1:
        exact = (1 - 1 / depth) ** depth
        assert left == pytest.approx(exact, abs=SIGMAS * np.sqrt(exact / depth / ALIKE))


def test_erosion_mixes_what_was_buried_into_the_layer_in_reverse_order() -> None:
    """A layer of small grains on large ones on small: Hirano's, the other way round."""
    depth, steps, large = 40, 50, 50
    rule = rule_of([[0.1, 0.1], [0.1, 0.1]], [[0.3, 0.3], [0.3, 0.3]])
    rule = rule._replace(grain_height=np.array([1, 1]), depth=depth, step=2.0)
    buried = np.repeat(np.array([0, 1], dtype=np.int8), [80, large])
    pile = layered_pile(rule, buried, np.array([depth, 0]), np.array([4, 0]), 9)
    eroded, small = [], []
    for _ in range(steps):
        there = pile.state()
        there["rolling"][:] = 0
        there["rolling"][0, 0, :-2] = 4
        there["height"][1:-1] = 9 * np.arange(ALIKE)[::-1]
        pile.restore(there)
        after = one_step(pile)
        assert (after.layer.sum(axis=1) == depth).all()
        eroded.append(len(buried) - after.buried.mean())
        small.append(after.layer[:, 0].mean() / depth)
    thickness, share = np.array(eroded), np.array(small)
    first = thickness < 0.8 * large
    assert thickness[-1] > large + depth / 2
    assert share[first] == pytest.approx(np.exp(-thickness[first] / depth), abs=1 / depth)
    assert share[-1] > share.min() + 0.1, "small grains again, from below the large ones"


@pytest.mark.parametrize("name", POURS)
def test_small_grains_pour_as_the_continuum_does_on_their_grid(name: str, poured) -> None:
    for field, difference in differences(poured, POURS[name]).items():
        assert difference.rms < difference.allowed, field
        assert difference.by_noise < 2 * SHARE, "noise hides no difference"


def test_noise_is_that_of_counted_grains_and_bias_falls_as_their_height() -> None:
    """Of R over two centimetres sqrt(u w), as of R / u grains; of the mean of h as u."""
    found = [on_one_grid(POURS["canonical"], n, piles=32) for n in GRAINS]
    noise, bias = exponents(found)
    assert noise == pytest.approx(-0.5, abs=0.1)
    assert bias == pytest.approx(-1.0, abs=0.35)


def test_noise_over_a_stretch_of_flow_falls_as_the_root_of_a_grains_area() -> None:
    over_two_cm = []
    for cells, n in ((30, 16), (60, 16), (60, 64)):
        found = on_one_grid(POURS["de Gennes"]._replace(cells=cells), n, piles=32)
        stretch = [pile.coarsen(x=cells // 15).mean() for pile in found.piles]
        inner = [pile.isel(x=slice(1, -2)) for pile in stretch]
        over_two_cm.append(noise_of(found._replace(piles=inner), "rolling_thickness"))
    assert over_two_cm[0] / over_two_cm[1] == pytest.approx(2**0.5, rel=0.1)
    assert over_two_cm[1] / over_two_cm[2] == pytest.approx(2.0, rel=0.1)


RATE = "ca_model.rule=rate"
PROFILE = ("pour.duration=20.0", "pour.records=2", RATE)


def test_a_lip_stands_half_a_column_further_out_than_the_continuums() -> None:
    """Both take the slope to the lip; half a cell away, it is that of the cell's own half."""
    pour = Pour("de-gennes-silo", 30, 256, ("cell.end=open", "pour.duration=150.0"))
    apart = []
    for cells in (15, 30):
        found = on_one_grid(pour._replace(cells=cells), pour.grains, piles=2)
        ends = [archive["height"].values[-1, -1] for archive in (found.continuum, *found.piles)]
        apart.append(float(np.mean(ends[1:]) - ends[0]) / (30.0 / cells / 2))
    assert apart == pytest.approx([0.6, 0.6], abs=0.02), "theta_r: nothing is captured any more"


@pytest.mark.parametrize(
    ("preset", "settings", "told"),
    [
        ("bcre", (), r"mixture\.dispersion = 2: lattice grains roll without dispersion"),
        ("mcs-general", (), r"mixture\.drift_velocity = \[0\.8, 1\.0\]: .* at one speed"),
        ("drum-mixture", (), r"cell\.shape = 'drum': the lattice pours silos and heaps"),
        ("stockpile", (), r"mixture\.collision_rate: missing; .* the lattice's rate rule need it"),
    ],
)
def test_what_the_rule_does_not_know_is_refused(
    preset: str, settings: tuple[str, ...], told: str
) -> None:
    with pytest.raises(NotApplicableError, match=told):
        ca_model.check(load(preset, [RATE, *settings]))


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        (("mixture.collision_rate=[[1e9, 0.0], [0.0, 1e9]]",), r"collision_rate = .*sub-steps"),
        (("mixture.curvature_length=1e9",), r"sub-steps; at most 100000 .*curvature_length = 1e\+"),
        (("ca_model.sharpness=1e13",), r"ca_model\.sharpness = 1.*: .* or equal to 1000000000000"),
        (("ca_model.sharpness=0.0",), r"ca_model\.sharpness = 0\.0: "),
        (("ca_model.amplification=1.5",), r"ca_model\.amplification = 1\.5: "),
        (("ca_model.percolation=true",), r"percolation = True: only where rule = 'threshold'"),
        (("mixture.grain_diameter=[1e-7, 1e-7]",), r"grains a step; at most 1000000"),
    ],
)
def test_a_pour_that_would_take_for_ever_or_makes_no_sense_is_refused(
    settings: tuple[str, ...], told: str
) -> None:
    with pytest.raises(SetupError, match=told):
        ca_model.check(load("makse-profile", [RATE, "ca_model.column_width=0.5", *settings]))


@pytest.mark.parametrize(
    "settings",
    [
        ("ca_model.sharpness=1e12",),
        ("ca_model.sharpness=1e12", "ca_model.amplification=0.0"),
        ("ca_model.contacts=1", "ca_model.amplification=0.0"),
        ("mixture.collision_rate=[[3e3, 3e3], [3e3, 3e3]]",),
        ("mixture.curvature_length=30.0",),
        ("mixture.surface_depth=1000.0",),
        ("mixture.grain_diameter=[0.1, 1000.0]",),
        ("ca_model.unit=1e-6", "ca_model.column_width=0.5"),
        ("mixture.theta_11=0.0", "mixture.psi=0.0", "mixture.delta=0.0"),
        ("pour.records=1",),
    ],
)
def test_whatever_is_allowed_is_poured_and_accounted_for(settings: tuple[str, ...]) -> None:
    archive = ca_model.pour(load("makse-profile", ["pour.duration=3.0", RATE, *settings]))
    there = archive["rolling_volume"] + archive["deposited_volume"]
    assert np.allclose(archive["poured_volume"], there, rtol=1e-12)
    assert np.isfinite(archive["surface_fraction"]).all()
    assert np.allclose(archive["surface_fraction"].sum("species"), 1.0)
    assert (archive["rolling_thickness"] >= 0).all()


def test_a_wall_is_said_to_outgrow_the_pile_only_where_too_few_grains_touch() -> None:
    def comment(*settings: str) -> str:
        return str(ca_model.pour(load("makse-profile", [*PROFILE, *settings])).attrs.get("comment"))

    assert "outgrew" not in comment()
    assert "with ca_model.contacts = 1" in comment("ca_model.contacts=1", "feed.inflow=[2.0, 2.0]")


def test_a_seed_and_a_pile_are_the_same_grains_on_any_number_of_threads() -> None:
    places = [("pour.seed=0",), ("pour.seed=1",), ("pour.pile=1",), ("pour.seed=0",)]
    settings = [[*PROFILE, "ca_model.column_width=1.0", *place] for place in places]
    experiments = [load("makse-profile", one) for one in settings]
    alone, together = (ca_model.pour_many(experiments, threads=n) for n in (1, 4))
    for one, other in zip(alone, together, strict=True):
        assert all(one[name].equals(other[name]) for name in one.data_vars)
    heights = [archive["height"].values for archive in alone]
    assert (heights[0] == heights[3]).all()
    assert (heights[0] != heights[1]).any()
    assert (heights[0] != heights[2]).any()
