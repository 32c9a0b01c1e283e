"""Short waves on an endless slope: without a curvature length, nothing stops the finest."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from continuum import law_of
from continuum.theory import (
    UniformFlow,
    growth_rate,
    rise_velocity,
    short_wave_growth_rate,
    uniform_flows,
    wave_rates,
)
from continuum.theory.spectrum import step_of
from continuum.theory.steady_state import steady_state_of
from continuum.theory.well_posedness import response
from experiment import NotApplicableError, load
from experiment.law import Law, interaction

SHORT = 2 * np.pi / np.geomspace(1e-3, 1e-5, 5)  # 1/cm; below any grain
LONG = 2 * np.pi / np.geomspace(100.0, 3.0, 20)
ALIKE = np.ones(2)


def single(slope: float, curvature: float) -> tuple[UniformFlow, Law]:
    law = Law(((1.0,),), ((2.0,),), ((0.0,),), 0.0, 0.1, curvature)
    return UniformFlow(np.array([0.7]), np.ones(1), slope), law


def rows(matrix: np.ndarray) -> tuple[tuple[float, ...], ...]:
    return tuple(map(tuple, matrix.tolist()))


def where_species_meet(x: float, preset: str = "makse-stratification") -> tuple[UniformFlow, Law]:
    """The steady pile's surface at x, below x_m = 46.7: both species are captured."""
    experiment = load(preset, ["mixture.curvature_length=0.0"])
    at = np.array([x])
    state = steady_state_of(experiment)
    flow = UniformFlow(
        state.rolling_thickness(at)[0], state.surface_fraction(at)[0], float(state.slope(at)[0])
    )
    return flow, law_of(experiment.mixture)


@pytest.mark.parametrize("dispersion", [0.0, 0.3])
@pytest.mark.parametrize("curvature", [0.0, 0.2])
def test_one_species_in_balance_climbs_and_flattens_by_itself(
    curvature: float, dispersion: float
) -> None:
    """sigma = gamma R (i k - l k^2) of the slope, and - i k v - D k^2 of the rolling grains."""
    flow, law = single(1.0, curvature)
    k = np.array([0.1, 1.0, 10.0])
    found = wave_rates(flow, law, np.array([3.0]), k, dispersion)
    slope = 2.0 * 0.7 * (1j * k - curvature * k**2)
    rolling = -3j * k - dispersion * k**2
    for one, sigmas in zip(found, np.stack([slope, rolling], axis=1), strict=True):
        by_phase = np.argsort(one.imag), np.argsort(sigmas.imag)
        np.testing.assert_allclose(one[by_phase[0]], sigmas[by_phase[1]], atol=1e-12)


@pytest.mark.parametrize("slope", [0.6, 1.2])
def test_one_species_that_settles_or_erodes_solves_its_quadratic(slope: float) -> None:
    """sigma^2 + (g - e + i k v) sigma + i k v g = 0, g = gamma R q, e = gamma (s - theta_r)."""
    flow, law = single(slope, 0.2)
    for k in (0.1, 1.0, 10.0):
        g = 2.0 * 0.7 * (-1j * k + 0.2 * k**2)
        e = 2.0 * (slope - 1.0)
        expected = np.sort_complex(np.roots([1.0, g - e + 3j * k, 3j * k * g]))
        found = np.sort_complex(wave_rates(flow, law, np.array([3.0]), np.array([k]))[0])
        np.testing.assert_allclose(found, expected, atol=1e-10)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32), species=st.integers(1, 4), smoothing=st.sampled_from([0.0, 0.1]))
def test_the_response_is_the_derivative_of_the_exchange(
    seed: int, species: int, smoothing: float
) -> None:
    random = np.random.default_rng(seed)
    rates = 10 ** random.uniform(-1, 1, (species, species))
    cross = random.uniform(0, 1, (species, species)) * (1 - np.eye(species))
    slopes = random.uniform(0.5, 1.5, (species, species))
    law = Law(*map(rows, (slopes, rates, cross)), smoothing, 0.1, 0.0)
    phi = random.dirichlet(np.ones(species))
    flow = UniformFlow(random.uniform(0.1, 1.0, species), phi, random.uniform(0.5, 1.5))
    found = response(flow, law)

    def exchange(rolling: np.ndarray, fraction: np.ndarray, slope: float) -> np.ndarray:
        return interaction(rolling[:, None], fraction[:, None], np.array([slope]), law)[:, 0]

    small = 1e-7
    for b, one in enumerate(small * np.eye(species)):
        more = exchange(flow.rolling + one, phi, flow.slope)
        less = exchange(flow.rolling - one, phi, flow.slope)
        np.testing.assert_allclose(found.to_rolling[:, b], (more - less) / 2 / small, atol=1e-5)
        more = exchange(flow.rolling, phi + one, flow.slope)
        less = exchange(flow.rolling, phi - one, flow.slope)
        np.testing.assert_allclose(found.to_fraction[:, b], (more - less) / 2 / small, atol=1e-5)
    more = exchange(flow.rolling, phi, flow.slope + small)
    less = exchange(flow.rolling, phi, flow.slope - small)
    np.testing.assert_allclose(found.to_slope, (more - less) / 2 / small, atol=1e-5)


@pytest.mark.parametrize("dispersion", [0.0, 0.1])
@pytest.mark.parametrize("depth", [0.1, 0.5])
def test_without_curvature_the_finest_waves_grow_as_fast_as_any(
    depth: float, dispersion: float
) -> None:
    """At gamma m R (phi_1 - R_1 / R) / d; dispersion is no cure."""
    flow, law = where_species_meet(50.0)
    law = law._replace(surface_depth=depth)
    rates = growth_rate(flow, law, ALIKE, SHORT, dispersion)
    assert rates == pytest.approx(rates[0], rel=1e-3)
    assert rates.min() > growth_rate(flow, law, ALIKE, LONG, dispersion).max()
    share = flow.rolling[0] / flow.rolling.sum()
    expected = 0.55 * flow.rolling.sum() * (flow.fraction[0] - share) / depth
    assert rates == pytest.approx(expected, rel=0.05)


def test_the_limit_of_short_waves_is_the_closed_form_with_unlike_rates_too() -> None:
    flow, law = where_species_meet(50.0)
    velocity = np.array([1.0, 0.6])
    law = law._replace(collision_rate=((1.0, 0.1), (0.3, 2.0)))
    found = growth_rate(flow, law, velocity, SHORT)
    assert found[-1] == pytest.approx(short_wave_growth_rate(flow, law, velocity), rel=1e-5)


@pytest.mark.parametrize("curvature", [0.1, 0.3])
def test_a_curvature_length_stops_waves_shorter_than_its_mean_with_the_surface_depth(
    curvature: float,
) -> None:
    """Below 2 pi sqrt(d l / (m (phi_1 - R_1 / R))) none grows; the fastest is longer."""
    flow, law = where_species_meet(50.0)
    law = law._replace(curvature_length=curvature)
    excess = 0.55 * (flow.fraction[0] - flow.rolling[0] / flow.rolling.sum())
    cut_off = 2 * np.pi * np.sqrt(0.1 * curvature / excess)
    assert (
        growth_rate(flow, law, ALIKE, 2 * np.pi / (cut_off * np.geomspace(0.01, 0.9))) < 0
    ).all()
    assert growth_rate(flow, law, ALIKE, np.array([2 * np.pi / (1.1 * cut_off)])) > 0


def test_short_waves_need_no_rough_large_grains_but_m_above_zero() -> None:
    """Also with delta = -0.1 (m = 0.2) they grow, which the paper's exp(gamma delta t) does not."""
    flow, law = where_species_meet(50.0, "makse-segregation")
    assert short_wave_growth_rate(flow, law, ALIKE) > 0.1
    smooth = law._replace(repose_slope=((1.0, 0.9), (0.7, 0.6)))  # m = -0.1
    assert short_wave_growth_rate(flow._replace(slope=0.6), smooth, ALIKE) < 0


def test_between_the_species_slopes_several_flows_keep_their_composition() -> None:
    law = law_of(load("makse-stratification").mixture)
    for slope, expected in ((0.65, 1), (0.72, 3), (0.9, 1)):
        flows = uniform_flows(law, np.array([0.2, 0.5]), slope)
        assert len(flows) == expected
        for flow in flows:
            gamma = interaction(
                flow.rolling[:, None], flow.fraction[:, None], np.array([slope]), law
            )
            np.testing.assert_allclose(
                flow.fraction * rise_velocity(flow, law), -gamma[:, 0], atol=1e-12
            )
    with pytest.raises(NotApplicableError, match="3 species"):
        uniform_flows(law, np.ones(3), 0.9)


@pytest.mark.parametrize("wavelength", [1.5, 3.0])
@pytest.mark.parametrize("curvature", [0.02, 0.1])
def test_waves_on_a_slope_grow_in_the_kernel_as_they_should(
    curvature: float, wavelength: float
) -> None:
    """How ten steps change the amplitudes of each field; the upwind slope adds dx/2 to l."""
    flow, law = where_species_meet(48.0)
    cells, dx, steps = 700, 0.01, 10
    kernel = step_of(load("makse-stratification"))
    kernel = replace(
        kernel,
        law=law._replace(curvature_length=curvature),
        grid=kernel.grid._replace(dx=dx, dt=dx),
        inflow=flow.rolling,
        cells=cells,
    )
    uniform = np.tile([*flow.rolling, flow.fraction[0], flow.slope], (cells, 1))
    wave = np.exp(2j * np.pi * np.arange(cells) * dx / wavelength)
    middle = slice(200, 500)

    def after(change: np.ndarray) -> np.ndarray:
        state = uniform + change
        for _ in range(steps):
            state = kernel(state)
        return state[middle]

    propagator = np.empty((4, 4), dtype=complex)
    for field, one in enumerate(1e-6 * np.eye(4)):
        changed = [
            after(part[:, None] * one) - after(-part[:, None] * one)
            for part in (wave.real, wave.imag)
        ]
        answer = (changed[0] + 1j * changed[1]) / 2e-6
        propagator[:, field] = (answer * wave.conj()[middle, None]).mean(axis=0)
    found = np.log(np.linalg.eigvals(propagator)).real.max() / (steps * dx)
    felt = law._replace(curvature_length=curvature + dx / 2)
    expected = growth_rate(flow, felt, ALIKE, np.array([2 * np.pi / wavelength]))[0]
    assert found == pytest.approx(expected, rel=0.05)
