"""What the two models do with the paper's mixtures: the physics that can be cited.

The continuum's numbers are those of DESIGN's prototype (section 6), each within 3 %.
"""

import itertools
from collections.abc import Callable

import numpy as np
import pytest
import xarray as xr

from compare import kinks, measure
from compare.deposit import settled_coarseness
from compare.quantities import coarseness, rise_velocity
from compare.validation.published import top_of_a_pair

Poured = Callable[..., xr.Dataset]

DEEP = ("mixture.surface_depth=0.5", "mixture.curvature_length=0.0")
LONG = ("pour.duration=4000.0", "pour.records=2000")


STRATIFIED = [
    ("continuum", "makse-stratification"),
    ("continuum", "glass-sugar"),
    ("ca_model", "makse-stratification"),
    ("ca_model", "glass-sugar"),
    ("ca_model", "lattice-stratification"),
]


def settled_profiles(archive: xr.Dataset) -> list[np.ndarray]:
    """Coarseness (z,) of each column, as far as it was laid after the transient."""
    return [column[np.isfinite(column)] for column in settled_coarseness(archive).values.T]


@pytest.mark.parametrize(
    ("settings", "wavelength", "kink_velocity", "front_velocity"),
    [((), 3.07, 0.598, 0.712), (DEEP, 4.67, 0.45, 0.42)],
)
def test_the_continuum_stratifies_with_the_wavelength_and_velocities_of_the_design(
    poured: Poured, settings, wavelength: float, kink_velocity: float, front_velocity: float
) -> None:
    found = measure(poured("continuum", "makse-stratification", *LONG, *settings))
    assert float(found["wavelength"]) == pytest.approx(wavelength, rel=0.03)
    assert float(found["kink_velocity"]) == pytest.approx(kink_velocity, rel=0.03)
    assert float(found["front_velocity"]) == pytest.approx(front_velocity, rel=0.03)


HALF = ("cell.length=50.0", "pour.duration=1600.0", "pour.records=1600")


@pytest.mark.parametrize(
    ("settings", "cells"), [(HALF, (250, 1000)), (DEEP, (200, 800))], ids=["d=l", "deep"]
)
def test_the_wavelength_converges(poured: Poured, settings, cells: tuple[int, int]) -> None:
    """Where dx is halved twice, it moves by less than 1 %."""
    coarse, fine = (
        measure(poured("continuum", "makse-stratification", f"continuum.cells={n}", *settings))
        for n in cells
    )
    ratio = float(fine["wavelength"] / coarse["wavelength"])
    assert ratio == pytest.approx(1.0, abs=0.01)


def test_muscl_finds_on_a_hundred_cells_what_it_finds_on_four_hundred(poured: Poured) -> None:
    """Which the first-order scheme misses by 0.4 % on 800, for it adds dx / 2 to l."""
    coarse, fine = (
        measure(
            poured(
                "continuum",
                "makse-stratification",
                "mixture.curvature_length=0.3",
                "continuum.scheme=muscl",
                f"continuum.cells={n}",
            )
        )
        for n in (100, 400)
    )
    for name, allowed in (("wavelength", 3e-3), ("kink_velocity", 0.01), ("front_velocity", 0.01)):
        assert float(coarse[name] / fine[name]) == pytest.approx(1.0, abs=allowed)
    assert float(fine["wavelength"]) == pytest.approx(2.97, abs=0.004)


@pytest.mark.parametrize(("model", "preset"), STRATIFIED)
def test_deposit_and_kymograph_tell_one_wavelength(poured: Poured, model: str, preset: str) -> None:
    """lambda = R0 v T / L within 5 %, or one (large) grain on the lattice."""
    archive = poured(model, preset)
    found = measure(archive)
    assert found["regime"].item() == "stratified"
    grain = float(archive["grain_diameter"].max()) if model == "ca_model" else 0.0
    wavelength = float(found["wavelength"])
    expected = float(found["wavelength_of_period"])
    assert abs(wavelength - expected) < max(0.05 * expected, grain)


@pytest.mark.parametrize(("model", "preset"), STRATIFIED)
def test_a_cycle_is_a_front_down_and_a_kink_up(poured: Poured, model: str, preset: str) -> None:
    found = measure(poured(model, preset))
    balance = float(found["wavelength_of_velocities"])
    assert balance == pytest.approx(float(found["wavelength_of_period"]), rel=0.12)


def test_small_grains_lie_under_large_ones_in_each_pair_of_layers(poured: Poured) -> None:
    """Between two sharp falls of coarseness, where a new pair begins, it rises from 0 to 1."""
    archive = poured("continuum", "makse-stratification")
    dz = float(archive["z"][1] - archive["z"][0])
    period = float(measure(archive)["wavelength"]) / dz
    for i in (150, 200, 250):
        profile = settled_profiles(archive)[i]
        drop = profile[:-6] - profile[6:]
        falls = [
            k for k in np.flatnonzero(drop > 0.7) if drop[k] == drop[max(0, k - 20) : k + 20].max()
        ]
        pairs = [profile[a + 6 : b] for a, b in itertools.pairwise(falls) if b - a > period / 2]
        assert len(pairs) >= 4
        for pair in pairs:
            third = len(pair) // 3
            lower, upper = pair[:third].mean(), pair[-third:].mean()
            assert lower < 0.35
            assert upper > 0.75


@pytest.mark.parametrize(("model", "preset"), STRATIFIED)
def test_a_kink_leaves_large_grains_on_top(poured: Poured, model: str, preset: str) -> None:
    """So the next pair's small grains come to lie on this pair's large ones."""
    archive = poured(model, preset)
    assert top_of_a_pair(archive) > 0.85


def test_the_first_sublayer_is_of_large_grains_only(poured: Poured) -> None:
    """On a start slope of theta_21, where large grains begin to stay: the paper's first kink."""
    archive = poured("continuum", "makse-stratification", "cell.start_slope=0.7")
    coarse = coarseness(archive["deposit_fraction"], archive)
    above = coarse["z"] - archive["base_height"]
    lower_half = (archive["x"] > 50) & (archive["x"] < 90)
    first = coarse.where((above > 0) & (above < 0.8)).isel(x=lower_half.values)
    assert float(first.mean()) > 0.999
    assert float(first.min()) > 0.98


@pytest.mark.parametrize(
    ("model", "word"), [("ca_model", "segregated"), ("continuum", "layered-and-segregated")]
)
def test_makse_segregation_has_no_kinks_and_parts_the_species(
    poured: Poured, model: str, word: str
) -> None:
    """In the continuum with waves where they meet, for d = 0.1 is thin; see below."""
    archive = poured(model, "makse-segregation")
    assert measure(archive)["regime"].item() == word
    assert kinks(archive).sizes["event"] == 0
    profiles = settled_profiles(archive)
    upper = [p.max() for p in profiles[len(profiles) // 20 : len(profiles) // 3]]
    lower = [p.min() for p in profiles[-len(profiles) // 8 : -len(profiles) // 20]]
    assert max(upper) < 0.01
    assert min(lower) > 0.98


def test_a_deeper_surface_layer_calms_the_waves_where_the_species_meet(poured: Poured) -> None:
    """With d = 0.1 weak stripes remain between the species; with d = 0.5 there are no layers."""
    calm = measure(poured("continuum", "makse-segregation", "mixture.surface_depth=0.5"))
    waves = measure(poured("continuum", "makse-segregation"))
    assert calm["regime"].item() == "segregated"
    assert waves["regime"].item() == "layered-and-segregated"
    assert abs(waves["zone_layered_begin"] - waves["zone_small_end"]) < 5
    assert abs(waves["zone_layered_end"] - waves["zone_large_begin"]) < 5
    assert float(calm["layering"]) < 0.01
    assert 0.1 < float(waves["layering"]) < 0.45


def test_the_lattice_segregates_where_the_design_says(poured: Poured) -> None:
    found = measure(poured("ca_model", "lattice-segregation"))
    assert found["regime"].item() == "segregated"
    assert float(found["segregation"]) > 0.95


def test_the_pile_rises_at_the_rate_of_the_feed(poured: Poured) -> None:
    archive = poured("continuum", "makse-stratification")
    mean = archive["height"].mean("x")
    rate = float((mean[-1] - mean[0]) / archive["time"][-1])
    assert rate == pytest.approx(rise_velocity(archive), rel=0.05)
