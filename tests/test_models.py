"""Each model of the paper is a choice of parameters: what it does, against what is known of it."""

from collections.abc import Callable

import numpy as np
import pytest
import xarray as xr

from compare import layers, measure
from compare.quantities import coarseness, settled_since
from compare.validation.steady import exponents
from compare.validation.waves import oscillation_of
from continuum.theory import (
    growth_rates,
    minimal_model_of,
    wavelength_of_kink,
    wavelength_of_velocities,
)
from experiment import ArchiveError, load

Poured = Callable[..., xr.Dataset]

FEW_ROUGH = ("feed.inflow=[0.0025, 0.2475]", "pour.records=2")


@pytest.mark.parametrize("rough", [0.55, 0.6, 0.7])
def test_bdg_minimal_thins_out_as_a_power_law_of_exponent_a_over_b(poured: Poured, rough) -> None:
    """Where B y >> 1, and the rough grains are few: R_1 ~ y^(A/B), A/B = 1.5, 2 and 3."""
    setting = f"mixture.repose_slope=[[{rough}, {rough}], [0.4, 0.4]]"
    archive = poured("continuum", "bdg-minimal", setting, *FEW_ROUGH)
    model = minimal_model_of(load("bdg-minimal", [setting]))
    found, of_profile = exponents(archive)
    assert found == pytest.approx(model.exponent, rel=0.03)
    assert found == pytest.approx(of_profile, rel=0.025)
    last = archive.isel(time=-1)
    edges = last["x"].values + 0.05
    y = (model.length - edges) / model.length
    lower = (y > 0.05) & (y < 0.4)
    factor = last["rolling_thickness"].values[lower, 0] / model.profile(edges[lower])
    assert factor.max() / factor.min() < 1.2


def test_bdg_minimal_segregates_completely_at_the_low_edge(poured: Poured) -> None:
    archive = poured("continuum", "bdg-minimal", "feed.inflow=[0.125, 0.125]")
    fraction = archive["surface_fraction"].isel(time=-1, species=0)
    assert float(fraction[0]) > 0.999
    assert float(fraction[-2]) < 0.03
    assert (np.diff(fraction[:-1]) < 1e-12).all(), "ever fewer downhill"


def test_canonical_segregation_widens_as_psi_falls_below_the_smoothing(poured: Poured) -> None:
    """Weak, graded segregation: the width is the length over which phi would go from 0 to 1."""
    widths = []
    for smoothing in (0.0, 0.02, 0.05, 0.1, 0.2):
        archive = poured("continuum", "canonical", f"mixture.smoothing={smoothing}")
        large = archive["surface_fraction"].isel(time=-1, species=1).values
        widths.append(30.0 / (large[-2] - large[0]))
        assert float(measure(archive)["layering"]) == 0.0
    assert (np.diff(widths) > 0).all(), widths
    assert widths[0] < 33.0, "without smoothing it is complete"
    assert widths[3] > 2 * 30.0, "with psi = smoothing / 2 each end holds a quarter of the other"


def test_mcs_with_everything_different_stratifies_as_with_everything_equal(poured: Poured) -> None:
    """The paper's statement: similar results for v_1 != v_2, any gamma_ab, and m1 != m2."""
    archive = poured("continuum", "mcs-general")
    found = measure(archive)
    assert found["regime"].item() == "stratified"
    assert float(found["wavelength"]) == pytest.approx(
        float(found["wavelength_of_period"]), rel=0.05
    )


def test_the_centre_oscillates_and_calms_exponentially_at_the_spectrums_rate(
    poured: Poured,
) -> None:
    """Cross rates as large as the direct ones, delta < 0: the paper's last remark."""
    settings = ("continuum.cells=400",)
    expected = growth_rates(load("mcs-oscillations", settings), 2)[0]
    archive = poured("continuum", "mcs-oscillations", *settings)
    found = oscillation_of(archive)
    assert found.x == pytest.approx(50.0, abs=5.0), "the centre of the pile"
    assert found.rate == pytest.approx(expected.real, rel=0.05)
    assert found.frequency == pytest.approx(abs(expected.imag), rel=0.02)
    assert found.misfit < 0.05


@pytest.mark.parametrize("share", [0.3, 0.5, 0.7, 0.85])
def test_three_species_lie_in_triplets_small_medium_large(poured: Poured, share: float) -> None:
    """From bottom to top: the phase of each species' first harmonic over a wavelength."""
    archive = poured("continuum", "ternary")
    wavelength = float(measure(archive)["wavelength"])
    column = archive["deposit_fraction"].isel(x=int(share * archive.sizes["x"]))
    since = archive["height"].sel(x=column["x"]).interp(time=settled_since(archive))
    column = column.where(column["z"] > since).dropna("z")
    wave = np.exp(2j * np.pi * column["z"] / wavelength)
    small, medium, large = np.angle((column * wave).sum("z")) / (2 * np.pi)
    assert 0.1 < (medium - small) % 1 < (large - small) % 1 - 0.1
    assert (large - small) % 1 < 0.7


def test_four_species_keep_their_volumes_and_their_order(poured: Poured) -> None:
    """Coarser grains come to rest farther down."""
    slopes = [[0.6 - 0.15 * (a - b) for b in range(4)] for a in range(4)]
    rates = (np.full((4, 4), 2.0) + 18.0 * np.eye(4)).tolist()
    settings = (
        f"mixture={{names=['a','b','c','d'], grain_diameter=[0.02,0.03,0.05,0.08], "
        f"drift_velocity=10.0, repose_slope={slopes}, collision_rate={rates}}}",
        "feed.inflow=[0.06,0.06,0.06,0.06]",
        "uncertain={}",
    )
    archive = poured("continuum", "glass-sugar", *settings)
    held = archive["rolling_volume"] + archive["deposited_volume"]
    np.testing.assert_allclose(held, archive["poured_volume"], rtol=1e-12, atol=1e-12)
    fraction = archive["deposit_fraction"].fillna(0.0)
    place = (fraction * fraction["x"]).sum(("x", "z")) / fraction.sum(("x", "z"))
    assert (np.diff(place) > 1.0).all()


def test_a_pulsed_feed_lays_layers_where_a_steady_one_does_not(poured: Poured) -> None:
    """As thick as the pile rises in a period."""
    pulsed = poured("continuum", "pulsed-feed")
    steady = poured("continuum", "pulsed-feed", "feed={inflow=[0.5, 0.5]}")
    found = layers(pulsed)
    assert float(found["layering"]) > 0.5
    assert float(layers(steady)["layering"]) < 0.01
    assert float(found["wavelength"]) == pytest.approx(600.0 * 1.0 / 100.0, rel=0.02)


def test_a_heap_is_two_slopes_alike_and_what_falls_off_its_ends_is_counted(poured: Poured) -> None:
    archive = poured("continuum", "heap", "cell.length=12.0", "pour.duration=40.0")
    assert archive["x"].values.tolist() == (-archive["x"].values[::-1]).tolist()
    for name in ("height", "rolling_thickness"):
        mirrored = archive[name].values[:, ::-1]
        assert (archive[name].values == mirrored).all()
    poured_in = 2 * 10.0 * 0.125 * archive["time"]
    for a in range(2):
        np.testing.assert_allclose(archive["poured_volume"].isel(species=a), poured_in, rtol=1e-12)
    told = archive["rolling_volume"] + archive["deposited_volume"] + archive["outflow_volume"]
    np.testing.assert_allclose(told, archive["poured_volume"], rtol=1e-12, atol=1e-12)
    assert (archive["outflow_volume"][-1] > 0.2 * archive["poured_volume"][-1]).all()
    assert (archive["height"][:, -1] < 0.2).all(), "no higher at the lip than a slope's end"


def test_a_heap_grows_layers_on_both_sides_and_one_of_them_is_measured(poured: Poured) -> None:
    """With walls, each side is the silo of the same length."""
    heap = poured("continuum", "glass-sugar", "cell.shape=heap")
    silo = poured("continuum", "glass-sugar")
    of_heap, of_silo = measure(heap), measure(silo)
    for name in ("wavelength", "kink_velocity", "front_velocity", "wavelength_of_period"):
        assert float(of_heap[name]) == pytest.approx(float(of_silo[name]), rel=1e-9)
    right = heap.sel(x=slice(0, None))
    assert (right["height"].values == silo["height"].values).all()


def test_a_start_surface_that_is_given_is_what_the_pile_grows_on(poured: Poured) -> None:
    """A trough half-way down fills first, and keeps what rolls past the slope above it."""
    settings = ("cell.start_slope=0.0", "cell.start_surface=[[0, 12], [15, 0], [30, 9]]")
    archive = poured("continuum", "glass-sugar", *settings, "pour.duration=10.0")
    laid = (archive["height"].isel(time=-1) - archive["base_height"]).values
    x = archive["x"].values
    assert laid[(x > 14) & (x < 16)].min() > 0.3
    assert laid[x > 25].max() < 1e-4


def test_a_drum_gives_back_what_it_buried_species_by_species(poured: Poured) -> None:
    archive = poured("continuum", "drum-mixture")
    held = archive["rolling_volume"] + archive["deposited_volume"]
    np.testing.assert_allclose(held, archive["poured_volume"], rtol=1e-12)
    assert float(archive["rolling_volume"].max()) > 0.1, "it does flow"


def test_a_drum_parts_a_mixture_into_a_core_of_small_grains_and_streaks(poured: Poured) -> None:
    """It was well mixed; after four turns small grains lie inside, large ones by the rim."""
    archive = poured("continuum", "drum-mixture")
    coarse = coarseness(archive["deposit_fraction"], archive)
    radius = np.hypot(archive["x"], archive["z"] - 10.0)
    inner = float(coarse.where(radius < 3.0).mean())
    outer = float(coarse.where((radius > 7.0) & (radius < 9.5)).mean())
    assert inner < 0.3
    assert outer > 0.6
    ring = coarse.where((radius > 5.5) & (radius < 6.5))
    assert float(ring.std()) > 0.25, "streaks: one ring holds both pure kinds"


def test_a_drum_has_no_kinks_to_measure(poured: Poured) -> None:
    with pytest.raises(ArchiveError, match="nothing is poured into a drum"):
        measure(poured("continuum", "de-gennes-drum"))


def test_the_kinks_balance_agrees_with_the_measured_cycle(poured: Poured) -> None:
    """The front keeps up with the grains only roughly: the simpler form is farther off."""
    found = measure(poured("continuum", "makse-stratification"))
    front, kink = float(found["front_velocity"]), float(found["kink_velocity"])
    balance = wavelength_of_velocities(1.0, 1.0, front, kink)
    assert balance == pytest.approx(float(found["wavelength_of_velocities"]), rel=1e-12)
    assert balance == pytest.approx(float(found["wavelength"]), rel=0.05)
    simple = wavelength_of_kink(1.0, 1.0, kink)
    assert simple < balance
    assert simple == pytest.approx(float(found["wavelength"]), rel=0.15)


def test_over_an_open_end_all_that_is_poured_flows_at_the_slope_of_repose(poured: Poured) -> None:
    """Down to the lip, half a cell beyond the last cell's middle."""
    archive = poured("continuum", "de-gennes-silo", "cell.end=open", "pour.duration=300.0")
    last = archive.isel(time=-1)
    dx = float(archive["x"][1] - archive["x"][0])
    np.testing.assert_allclose(-np.diff(last["height"]) / dx, 0.6, rtol=1e-6)
    assert float(last["height"][-1]) == pytest.approx(0.6 * dx / 2, rel=1e-6)
    np.testing.assert_allclose(last["rolling_thickness"], 0.25, rtol=1e-6)
