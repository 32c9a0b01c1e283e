"""What the lattice rule does: laws on numbers measured over piles of independent random feeds.

Lengths are in cm, of the presets' lattice: grains 0.1 and 0.2 high, columns 1 wide; a feed of 1 is
the presets', R0 = 0.4: two small grains and a large one a step. Flow is thin (contacts = all)
unless said otherwise. Means come with their standard errors from seeds; four of them are allowed.
"""

import itertools
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
import xarray as xr

import ca_model
from compare import kinks, layers, measure
from compare.deposit import settled_coarseness
from compare.deposit.spectrum import correlate
from compare.quantities import coarseness
from experiment import load

Poured = Callable[..., xr.Dataset]

LENGTH = 100.0
PILES = 6
THIN, THICK = "ca_model.contacts='all'", "ca_model.contacts=1"
NO_PERCOLATION = "ca_model.percolation=false"
HEAP = ("cell.shape='heap'", f"cell.length={LENGTH}", THIN)
FEEDS = (0.5, 1.0, 2.0, 4.0, 8.0)


class Value(NamedTuple):
    """A mean over piles and its standard error."""

    mean: float
    error: float

    def agrees_with(self, expected: float, share: float = 0.0) -> bool:
        return abs(self.mean - expected) < 4 * self.error + share * abs(expected)

    def is_above(self, other: "Value") -> bool:
        return self.mean - other.mean > 4 * float(np.hypot(self.error, other.error))


class Piles(NamedTuple):
    """Archives, and their numbers over a dimension `pile`."""

    archives: list[xr.Dataset]
    numbers: xr.Dataset

    def value(self, name: str) -> Value:
        return mean_and_error(self.numbers[name].values)

    @property
    def regimes(self) -> set[str]:
        return set(self.numbers["regime"].values.tolist())


def mean_and_error(values) -> Value:
    if len(values) == 1:
        return Value(float(values[0]), 0.0)
    return Value(float(np.mean(values)), float(np.std(values, ddof=1) / np.sqrt(len(values))))


@cache
def pours(preset: str, *settings: str, arrivals: str) -> list[xr.Dataset]:
    """Archives of independent piles; a `fixed` feed has but one."""
    common = (*settings, f"ca_model.arrivals={arrivals}")
    count = 1 if arrivals == "fixed" else PILES
    return ca_model.pour_many([load(preset, [*common, f"pour.pile={k}"]) for k in range(count)])


@cache
def piles(
    feed: float, *settings: str, preset: str = "lattice-stratification", arrivals: str = "drawn"
) -> Piles:
    """Some 25 cycles of thin flow."""
    common = (
        f"cell.length={LENGTH}",
        f"feed.inflow=[{0.2 * feed}, {0.2 * feed}]",
        f"pour.duration={25 * LENGTH * (3.0 / feed + 1.7):.0f}.0",
        "pour.records=750",
        THIN,
    )
    archives = pours(preset, *common, *settings, arrivals=arrivals)
    return Piles(archives, xr.concat([measure(archive) for archive in archives], "pile"))


def mirrored(archive: xr.Dataset) -> xr.Dataset:
    """The archive of a heap with left and right exchanged."""
    flipped = archive.isel(x=slice(None, None, -1))
    return flipped.assign_coords(x=archive["x"])


def is_conserved(archive: xr.Dataset) -> bool:
    told = archive["rolling_volume"] + archive["deposited_volume"] + archive["outflow_volume"]
    return bool(np.allclose(told, archive["poured_volume"], rtol=1e-12, atol=1e-9))


def way_of_the_large(archive: xr.Dataset) -> float:
    """How much farther from the source large grains lie than small ones, on average."""
    fraction = archive["deposit_fraction"].fillna(0.0)
    place = (fraction * fraction["x"]).sum(("x", "z")) / fraction.sum(("x", "z"))
    return float(place[1] - place[0])


def repeat_of(archive: xr.Dataset) -> float:
    """At what distance [cm] along the vertical grains repeat, in layers or not."""
    coarse = settled_coarseness(archive)
    correlation = correlate(coarse.values)
    everywhere = np.ones(coarse.sizes["x"], dtype=bool)
    return correlation.pooled(everywhere).repeat().lag * float(coarse["z"][1] - coarse["z"][0])


def outgrowth(archive: xr.Dataset) -> float:
    """How much higher [cm] the wall's column is than its neighbour, in the last tenth of a pour."""
    height = archive["height"].isel(time=slice(-archive.sizes["time"] // 10, None))
    return float((height.isel(x=-1) - height.isel(x=-2)).mean())


def scatter_of_cycles(archive: xr.Dataset) -> float:
    periods = kinks(archive)["passage"].diff("event").mean("x")
    return float(periods.std() / periods.mean())


@pytest.mark.parametrize("contacts", [THIN, THICK])
@pytest.mark.parametrize("arrivals", ["fixed", "drawn", "poisson"])
def test_the_stratifying_mixture_stratifies_whatever_the_feed_is_made_of(
    arrivals, contacts
) -> None:
    found = piles(1.0, contacts, arrivals=arrivals)
    assert found.regimes == {"stratified"}
    assert float(found.numbers["layering"].min()) > 0.45
    assert found.value("wavelength").agrees_with(found.value("wavelength_of_period").mean, 0.03)


def test_a_chance_likeness_of_far_layers_is_not_their_wavelength(poured: Poured) -> None:
    """Ten layers apart this pile's coarseness is more alike than one apart."""
    settings = (f"cell.length={LENGTH}", "pour.duration=14100.0", "ca_model.arrivals=poisson", THIN)
    found = measure(poured("ca_model", "lattice-stratification", *settings))
    assert float(found["wavelength"]) == pytest.approx(
        float(found["wavelength_of_period"]), rel=0.05
    )


@pytest.mark.parametrize("contacts", [THIN, THICK])
@pytest.mark.parametrize("arrivals", ["drawn", "poisson"])
def test_the_segregating_mixture_parts_without_kinks_or_layers(arrivals, contacts) -> None:
    found = piles(1.0, contacts, preset="lattice-segregation", arrivals=arrivals)
    assert found.regimes == {"segregated"}
    assert float(found.numbers["segregation"].min()) > 0.95
    assert float(found.numbers["layered_share"].max()) < 0.2, "but for stripes where species meet"
    assert all(kinks(archive).sizes["event"] == 0 for archive in found.archives)


@pytest.mark.parametrize("contacts", [THIN, THICK])
@pytest.mark.parametrize("percolation", ["true", "false"])
def test_without_a_difference_between_surfaces_there_are_no_layers(percolation, contacts) -> None:
    """Each species has one threshold on both: they part, with or without percolation."""
    alike = "mixture.repose_slope=[[0.4, 0.4], [0.1, 0.1]]"
    found = piles(1.0, alike, f"ca_model.percolation={percolation}", contacts)
    assert found.regimes == {"segregated"}
    assert float(found.numbers["layering"].max()) < 0.15
    assert float(found.numbers["segregation"].min()) > 0.94


def test_percolation_alone_carries_large_grains_farther_but_lays_no_layers_to_speak_of() -> None:
    """Four equal thresholds. Off, what is left is a small and a large grain by turns: 0.3 cm."""
    equal = "mixture.repose_slope=[[0.4, 0.4], [0.4, 0.4]]"
    on, off = piles(1.0, equal), piles(1.0, equal, NO_PERCOLATION)
    ways = [mean_and_error(list(map(way_of_the_large, found.archives))) for found in (on, off)]
    assert ways[0].is_above(ways[1])
    assert 2.0 < ways[0].mean / ways[1].mean < 3.0
    assert on.regimes == off.regimes == {"mixed"}
    assert float(on.numbers["layering"].max()) < 0.25
    assert mean_and_error(list(map(repeat_of, off.archives))).agrees_with(0.3, 0.06)


@pytest.mark.parametrize("feed", [1.0, 8.0])
def test_small_grains_lie_under_large_ones_in_what_a_cycle_lays(feed: float) -> None:
    """From one kink to the next the lower third is of small grains, the upper of large ones."""
    lower, upper = [], []
    for archive in piles(feed).archives[:2]:
        coarse = coarseness(archive["deposit_fraction"], archive)
        lines = kinks(archive)
        passage = lines["passage"].isel(x=lines["measured"].values)
        after = passage + 0.1 * float(passage.diff("event").median())
        for x in after["x"]:
            times = after.sel(x=x).where(after.sel(x=x) < archive["time"][-1]).dropna("event")
            edges = archive["height"].sel(x=x).interp(time=times.values).values
            for pair in np.split(coarse.sel(x=x).values, np.searchsorted(coarse["z"], edges))[1:-1]:
                third = len(pair) // 3
                if third:
                    lower.append(pair[:third].mean())
                    upper.append(pair[-third:].mean())
    assert len(lower) > 1000
    assert np.mean(lower) < 0.3
    assert np.mean(upper) > 0.75
    assert np.mean(np.array(upper) > np.array(lower)) > 0.95


def test_what_a_cycle_lays_is_linear_in_the_feed() -> None:
    """lambda = 1.25 cm + 1.70 R0, over sixteen times the feed, within 4 %."""
    thickness = np.array(0.4) * FEEDS
    found = [piles(feed).value("wavelength_of_period") for feed in FEEDS]
    laid = np.array([value.mean for value in found])
    slope, intercept = np.polyfit(thickness, laid, 1, w=1 / laid)
    assert slope == pytest.approx(1.70, rel=0.05)
    assert intercept == pytest.approx(1.25, rel=0.05)
    np.testing.assert_allclose(laid, intercept + slope * thickness, rtol=0.04)


@pytest.mark.parametrize(("feed", "pairs"), [(0.5, 1), (1, 1), (2, 1), (4, 1), (8, 2)])
def test_deposit_and_kymograph_agree_at_every_feed(feed: float, pairs: int) -> None:
    """lambda = R0 v T / L = R0 v (1 / v_f + 1 / v_k); in a strong feed a cycle lays two pairs."""
    found = piles(float(feed))
    cycle = found.numbers["wavelength_of_period"]
    pairs_laid = mean_and_error((cycle / found.numbers["wavelength"]).values)
    assert pairs_laid.agrees_with(pairs, 0.01)
    balance = mean_and_error((found.numbers["wavelength_of_velocities"] / cycle).values)
    assert balance.agrees_with(1.0, 0.02)


def test_kinks_climb_with_the_feed_and_never_faster_than_grains_roll() -> None:
    """v_k = R0 v / (1.06 cm) in weak feeds: a kink is then of one height; v in strong ones."""
    climb = [piles(feed).value("kink_velocity") for feed in (0.25, *FEEDS)]
    for feed, velocity in zip((0.25, 0.5), climb[:2], strict=True):
        assert velocity.agrees_with(0.4 * feed / 1.06, 0.02)
    assert all(faster.is_above(slower) for slower, faster in itertools.pairwise(climb))
    assert climb[-1].agrees_with(1.0, 0.005)


def test_the_fewer_grains_touch_the_slower_the_kinks_and_the_thicker_the_layers() -> None:
    thick, between, thin = (piles(4.0, f"ca_model.contacts={n}") for n in (1, 2, "'all'"))
    for slower, faster in ((thick, between), (between, thin)):
        assert faster.value("kink_velocity").is_above(slower.value("kink_velocity"))
        assert slower.value("wavelength").is_above(faster.value("wavelength"))
    assert thick.value("wavelength").mean > 2.0 * thin.value("wavelength").mean


def test_kinks_in_thick_flow_climb_at_what_the_surface_captures_not_at_what_is_fed() -> None:
    """Beyond saturation v_k = 0.27 v, and lambda is proportional to the feed."""
    once, twice = piles(4.0, THICK), piles(8.0, THICK)
    for found in (once, twice):
        assert found.value("kink_velocity").agrees_with(0.275, 0.03)
    assert twice.value("wavelength").mean / once.value("wavelength").mean == pytest.approx(
        2.0, rel=0.03
    )


@pytest.mark.parametrize(("contacts", "enough", "too_much"), [(1, 1.0, 2.0), (2, 2.0, 4.0)])
def test_a_contact_captures_between_three_and_six_grains_a_step(contacts, enough, too_much) -> None:
    """Of a feed that exceeds it the rest piles up against the wall."""
    setting = f"ca_model.contacts={contacts}"
    assert max(map(outgrowth, piles(enough, setting).archives)) < 0.2
    assert min(map(outgrowth, piles(too_much, setting).archives)) > 10.0
    assert max(map(outgrowth, piles(8.0).archives)) < 0.2, "thin flow captures any feed"


def test_percolation_makes_the_layers_of_a_strong_feed_thinner_and_purer() -> None:
    on, off = piles(4.0), piles(4.0, NO_PERCOLATION)
    assert on.regimes == off.regimes == {"stratified"}
    assert off.value("wavelength").is_above(on.value("wavelength"))
    assert on.value("layering").is_above(off.value("layering"))
    weak = [piles(1.0, *how).value("wavelength").mean for how in ((), (NO_PERCOLATION,))]
    assert weak[1] == pytest.approx(weak[0], rel=0.05), "three grains a step seldom lie in layers"


@pytest.mark.parametrize("feed", [1.0, 4.0])
def test_the_more_random_the_feed_the_thicker_the_layers(feed: float) -> None:
    fixed, drawn, poisson = (piles(feed, arrivals=kind) for kind in ("fixed", "drawn", "poisson"))
    assert drawn.value("wavelength").is_above(fixed.value("wavelength"))
    assert poisson.value("wavelength").is_above(drawn.value("wavelength"))


def test_a_random_feed_blurs_the_layers_and_upsets_the_clock_of_the_kinks() -> None:
    fixed, drawn, poisson = (piles(4.0, arrivals=kind) for kind in ("fixed", "drawn", "poisson"))
    clock = [
        mean_and_error(list(map(scatter_of_cycles, found.archives)))
        for found in (fixed, drawn, poisson)
    ]
    assert clock[0].mean < 0.005
    assert min(clock[1].mean, clock[2].mean) > 0.02
    spread = [found.value("wavelength_spread") for found in (fixed, drawn, poisson)]
    assert spread[1].is_above(spread[0])
    assert spread[2].is_above(spread[0])
    for found in (drawn, poisson):
        assert fixed.value("layering").is_above(found.value("layering"))


def test_a_fixed_feed_makes_mirror_images_of_a_heaps_sides(poured: Poured) -> None:
    heap = poured("ca_model", "lattice-stratification", *HEAP, "pour.duration=3000.0")
    for name in ("height", "rolling_thickness", "surface_fraction", "deposit_fraction"):
        np.testing.assert_array_equal(heap[name], mirrored(heap)[name])


def test_a_random_feed_makes_sides_that_differ_but_are_alike_on_average() -> None:
    heaps = piles(1.0, *HEAP)
    left = xr.concat([measure(mirrored(heap)) for heap in heaps.archives], "pile")
    for name in ("wavelength", "kink_velocity", "front_velocity", "layering"):
        differences = mean_and_error((left[name] - heaps.numbers[name]).values)
        assert 0 < differences.error < 0.05 * heaps.value(name).mean
        assert differences.agrees_with(0.0)
    for heap, silo in zip(heaps.archives, piles(1.0).archives, strict=True):
        right = heap["height"].sel(x=slice(0, None))
        assert (right.values == silo["height"].values).all(), "the silo of the same stream"


def test_on_a_table_a_heap_grows_until_all_that_is_poured_falls_off(poured: Poured) -> None:
    """Between the slopes at which small and large grains come to rest on their own kind."""
    settings = ("cell.end='open'", "cell.start_slope=0.0", "ca_model.arrivals='drawn'")
    heap = poured("ca_model", "lattice-stratification", *HEAP, *settings)
    assert is_conserved(heap)
    side = heap["height"].isel(time=-1).sel(x=slice(5, 95))
    assert 0.4 < -np.polyfit(side["x"], side, 1)[0] < 0.5
    late = heap.sel(time=slice(15_000, None))
    assert (np.diff(late["deposited_volume"].sum("species")) == 0).all()
    kept = late["rolling_volume"] + late["deposited_volume"]
    assert float((kept.max("time") - kept.min("time")).max()) < 0.02 * float(kept.mean())


def test_layers_lie_on_both_sides_of_a_spout_that_travels() -> None:
    """Wherever it is, each flank has the layers of a spout at rest."""
    path = "feed.source={time=[0.0, 10000.0], x=[-15.0, 15.0]}"
    heaps = pours("lattice-stratification", *HEAP, path, "pour.duration=10000.0", arrivals="drawn")
    assert all(map(is_conserved, heaps))
    at_rest = piles(1.0).value("wavelength")
    for flank in ([layers(heap) for heap in heaps], [layers(mirrored(heap)) for heap in heaps]):
        assert min(float(found["layering"]) for found in flank) > 0.6
        wavelength = mean_and_error([float(found["wavelength"]) for found in flank])
        assert wavelength.agrees_with(at_rest.mean, 0.03)


@pytest.mark.parametrize("source", [-40.0, 40.0])
def test_a_spout_that_leaps_leaves_a_core_of_small_grains_where_it_was(
    poured: Poured, source: float
) -> None:
    leap = "feed.source={time=[0.0, 4000.0, 4001.0, 8000.0], x=[-40.0, -40.0, 40.0, 40.0]}"
    heap = poured("ca_model", "lattice-stratification", *HEAP, leap, "pour.duration=8000.0")
    assert is_conserved(heap)
    coarse = coarseness(heap["deposit_fraction"], heap)
    assert float(coarse.sel(x=slice(source - 1, source + 1)).mean()) < 0.15
    for flank in (source - 20, source + 20):
        assert float(coarse.sel(x=slice(flank - 10, flank + 10)).mean()) > 0.4


@pytest.mark.parametrize("arrivals", ["fixed", "drawn", "poisson"])
def test_a_pulsed_feed_lays_layers_where_a_steady_one_does_not(arrivals: str) -> None:
    """As thick as the pile rises in a period: 600 s of R0 v / L."""
    few = "pour.records=100"
    steady = pours("pulsed-feed", few, "feed={inflow=[0.5, 0.5]}", arrivals=arrivals)
    pulsed = pours("pulsed-feed", few, arrivals=arrivals)
    assert max(float(layers(archive)["layering"]) for archive in steady) < 0.2
    assert min(float(layers(archive)["layering"]) for archive in pulsed) > 0.8
    wavelength = mean_and_error([float(layers(archive)["wavelength"]) for archive in pulsed])
    assert wavelength.agrees_with(6.0, 0.02)
