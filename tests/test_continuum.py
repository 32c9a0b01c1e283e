"""The continuum: the paper's exchange, volumes conserved, and a deposit that remembers."""

import numpy as np
import pytest
from flows import law_with, still, take, volume
from hypothesis import given, settings
from hypothesis import strategies as st

import continuum
from continuum import law_of
from continuum.kernel import advance, find_composition
from continuum.limiters import LIMITERS, limited
from continuum.run import Resolution
from continuum.section import heights_in_drum, section_of_drum
from continuum.slopes import slopes_of
from continuum.state import SCHEMES, Grid
from experiment import Experiment, Mixture, NotApplicableError, SetupError, load, preset_text
from experiment.experiment import parse_toml, set_values
from experiment.law import interaction, positive_part


@pytest.mark.parametrize("slope", [0.5, 0.9, 1.3, 1.9])
@pytest.mark.parametrize("phi_2", [0.0, 0.3, 1.0])
def test_the_exchange_of_two_species_is_the_papers(slope: float, phi_2: float) -> None:
    """Eq. (mcs-r), written out, where gamma_21 is rolling 2 on static 1."""
    law = law_with(2)
    (g11, g12), (g21, g22) = law.collision_rate
    r1, r2, phi_1 = 0.4, 0.7, 1 - phi_2
    theta_1 = 1.0 + 0.55 * phi_2
    theta_2 = 0.7 + 0.55 * phi_2

    def capital_pi(z: float) -> float:
        return max(z, 0.0)

    gamma_1 = (
        g11 * capital_pi(slope - theta_1) * phi_1 * r1
        - g11 * capital_pi(theta_1 - slope) * r1
        + g21 * capital_pi(slope - theta_2) * phi_1 * r2
    )
    gamma_2 = (
        g22 * capital_pi(slope - theta_2) * phi_2 * r2
        - g22 * capital_pi(theta_2 - slope) * r2
        + g12 * capital_pi(slope - theta_1) * phi_2 * r1
    )
    found = interaction(
        np.array([[r1], [r2]]), np.array([[phi_1], [phi_2]]), np.array([slope]), law
    )
    np.testing.assert_allclose(found[:, 0], [gamma_1, gamma_2], rtol=1e-14, atol=1e-15)


def test_constant_cross_amplification_is_added_to_static_grains_of_the_other_species() -> None:
    """BdG's minimal model: mu_ba R_b phi_a, and none from a grain's own species."""
    quiet, constant = law_with(2), law_with(2, cross_amplification=np.array([[0, 0.3], [0.2, 0]]))
    state = np.array([[0.4], [0.7]]), np.array([[0.25], [0.75]]), np.array([1.0])
    added = interaction(*state, constant) - interaction(*state, quiet)
    np.testing.assert_allclose(added[:, 0], [0.25 * 0.2 * 0.7, 0.75 * 0.3 * 0.4], rtol=1e-13)


def test_smoothing_rounds_off_the_kink_of_p_and_nothing_far_from_it() -> None:
    assert positive_part(-2.0, 0.0) == 0.0
    assert positive_part(0.7, 0.0) == 0.7
    assert positive_part(0.0, 0.1) == pytest.approx(0.05)
    assert positive_part(5.0, 0.1) == pytest.approx(5.0, rel=1e-3)


@pytest.mark.parametrize("cross", [0.1, 1.0])
def test_each_species_is_conserved_over_1e6_steps_with_strong_erosion(cross: float) -> None:
    """To 1e-12 of what was poured; heights fall often, so the deposit is dug up.

    The slope has an open end, so that it does not grow for ever.
    """
    law = law_with(2, collision_rate=np.array([[1.0, cross], [cross, 1.0]]))
    cells, block = 20, 1000
    flow = still(law, cells, bins=800)
    grid, velocity = Grid(0.5, 0.5, 0.05, lip=0.0), np.ones(2)
    eroded, poured = 0.0, np.zeros(2)
    for k in range(1000):
        swing = 0.45 * np.sin(np.arange(block) * 2 * np.pi / (40 + k % 7))
        inflow = np.column_stack([0.5 + swing, 0.5 - swing])
        before = flow.height.copy()
        flow = take(flow, law, grid, velocity, inflow)
        poured += inflow.sum(axis=0)
        eroded += float((before - flow.height).clip(0).sum())
        assert min(flow.rolling.min(), flow.surface.min(), flow.filling.min()) >= 0
        if k % 100 == 99:
            assert flow.tape.min() >= 0
            np.testing.assert_allclose(flow.held, flow.tape.sum(axis=2), rtol=1e-13, atol=1e-13)
            np.testing.assert_allclose(volume(flow), poured, rtol=1e-12)
    assert eroded > 1000 * law.surface_depth, "many times the surface layer was dug up"


@settings(max_examples=100, deadline=None)
@given(
    seed=st.integers(0, 2**32),
    species=st.integers(1, 3),
    length=st.sampled_from([0.0, 0.1, 0.5]),
    equal=st.booleans(),
    lip=st.sampled_from([np.nan, 0.0, 0.7]),
    limiter=st.integers(0, len(LIMITERS) - 1),
    scheme=st.integers(0, len(SCHEMES) - 1),
    dispersion=st.sampled_from([0.0, 0.3, 30.0]),
    cells=st.integers(3, 40),
)
def test_any_mixture_keeps_its_volume_positive_thicknesses_and_fractions(
    seed: int,
    species: int,
    length: float,
    equal: bool,
    lip: float,
    limiter: int,
    scheme: int,
    dispersion: float,
    cells: int,
) -> None:
    """On any grid, under any feed, at a wall or an open end."""
    random = np.random.default_rng(seed)
    law = law_with(
        species,
        repose_slope=random.uniform(0.1, 2.0, (species, species)),
        collision_rate=10 ** random.uniform(-2, 2, (species, species)),
        curvature_length=length,
        surface_depth=10 ** random.uniform(-2, 0.5),
        smoothing=random.choice([0.0, 0.1]),
        dispersion=dispersion,
    )
    velocity = np.full(species, 2.0) if equal else random.uniform(0.3, 2.0, species)
    inflow = random.uniform(0, 1, species) * random.uniform(0, 2, (400, 1))
    dx = 10 ** random.uniform(-1, 0)
    base = random.uniform(0, 3) * np.arange(cells)[::-1] * dx
    flow = still(law, cells, bins=50, base=base)
    grid = Grid(dx, dx / velocity.max(), 0.1, lip=lip, limiter=limiter, scheme=scheme)
    flow = take(flow, law, grid, velocity, inflow)
    poured = inflow.sum(axis=0) * velocity / velocity.max()
    np.testing.assert_allclose(volume(flow), poured, rtol=1e-12, atol=1e-12)
    assert min(flow.rolling.min(), flow.surface.min(), flow.filling.min()) >= 0
    assert flow.tape.min() >= 0
    at_rest = (flow.surface + flow.filling + flow.tape.sum(axis=2)).sum(axis=0)
    np.testing.assert_allclose(flow.height - base, at_rest, rtol=1e-9, atol=1e-9)
    phi = find_composition(flow.surface, flow.rigid_fraction, law.surface_depth)
    assert phi.min() >= 0
    np.testing.assert_allclose(phi.sum(axis=0), 1.0, rtol=1e-12)


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 2**32),
    cells=st.sampled_from([4, 20, 50]),
    slope=st.sampled_from([0.0, 0.6, 1.5]),
    depth=st.sampled_from([0.03, 0.3]),
    scheme=st.sampled_from(SCHEMES),
)
def test_any_drum_keeps_each_species(
    seed: int, cells: int, slope: float, depth: float, scheme: str
) -> None:
    """Also where rings by the axis run empty, and where its bins have to be doubled."""
    random = np.random.default_rng(seed)
    mixture = {
        "names": ["a", "b"],
        "grain_diameter": [0.03, 0.08],
        "repose_slope": random.uniform(0.1, 1.5, (2, 2)).tolist(),
        "collision_rate": (10 ** random.uniform(0, 2, (2, 2))).tolist(),
        "drift_velocity": random.uniform(3, 10, 2).tolist(),
        "surface_depth": depth,
    }
    turning = {"shape": "drum", "length": 20.0, "turning_rate": random.uniform(0.01, 0.3)}
    tables = {
        "title": "any drum",
        "mixture": mixture,
        "cell": turning | {"start_slope": slope},
        "pour": {"duration": 20.0, "records": 10},
        "continuum": {"cells": cells, "scheme": scheme},
    }
    archive = continuum.pour(Experiment.parse(tables))
    held = archive["rolling_volume"] + archive["deposited_volume"]
    np.testing.assert_allclose(held, archive["poured_volume"], rtol=1e-11)
    for name in ("rolling_thickness", "surface_fraction", "deposit_fraction"):
        assert not (archive[name] < 0).any()
    mean = archive["height"].mean("x") + archive["rolling_thickness"].sum("species").mean("x")
    np.testing.assert_allclose(mean, mean[0], rtol=1e-9)


def test_erosion_digs_up_what_was_buried_last_first() -> None:
    """Large grains buried below small ones come up only when the small ones are gone."""
    law = law_with(2, repose_slope=np.zeros((2, 2)), surface_depth=0.1, curvature_length=0.0)
    flow = still(law, 3)
    flow.height[:] = [3.0, 0.0, 0.0]
    flow.tape[1, 0, :10] = 0.1
    flow.tape[0, 0, 10:15] = 0.1
    flow.top[0] = flow.sealed[0] = 15
    flow.surface[0, 0] = 0.1
    dug = np.zeros(2)
    order = []
    for _ in range(60):
        advance(flow, law, Grid(1.0, 0.1, 0.1), np.ones(2), np.array([[0.3, 0.0]]))
        flow.height[:] = [3.0, 0.0, 0.0]
        held = (flow.surface + flow.filling + flow.tape.sum(axis=2))[:, 0]
        order.append(held.copy())
        dug = np.array([0.6, 1.0]) - held
    small, large = np.array(order).T
    still_covered = small > 0.15
    assert still_covered.any()
    np.testing.assert_allclose(large[still_covered], 1.0, rtol=1e-12)
    assert dug[1] > 0.3, "the large grains came up in the end"


def test_the_rigid_surface_counts_as_surface_but_gives_up_no_grains() -> None:
    law = law_with(2, repose_slope=np.zeros((2, 2)))
    flow = still(law, 5, base=5.0 * np.arange(5)[::-1])
    phi = find_composition(flow.surface, flow.rigid_fraction, law.surface_depth)
    assert phi.tolist() == [[1.0] * 5, [0.0] * 5]
    steep = flow.height.copy()
    flow = take(flow, law, Grid(1.0, 1.0, 0.1), np.ones(2), np.tile([0.5, 0.5], (50, 1)))
    assert (flow.height >= steep).all()
    np.testing.assert_allclose(volume(flow), 25.0, rtol=1e-13)


def test_what_a_surface_layer_lacks_of_its_depth_is_rigid_surface() -> None:
    surface = np.array([[0.0, 0.02, 0.06], [0.0, 0.03, 0.14]])
    phi = find_composition(surface, np.array([1.0, 0.0]), 0.1)
    np.testing.assert_allclose(phi, [[1.0, 0.7, 0.3], [0.0, 0.3, 0.7]], rtol=1e-14)


def test_equal_speeds_shift_the_rolling_grains_exactly() -> None:
    """Without exchange (a slope between capture and amplification) a pulse keeps its every bit."""
    law = law_with(1, repose_slope=np.array([[1.0]]), curvature_length=0.0)
    cells = 64
    flow = still(law, cells, base=1.0 * np.arange(cells)[::-1] * 0.5)
    pulse = np.random.default_rng(1).uniform(0.1, 1.0, 20)
    inflow = np.concatenate([pulse, np.zeros(cells - 30)])[:, None]
    advance(flow, law, Grid(0.5, 0.5, 0.1), np.array([1.0]), inflow)
    arrived = flow.rolling[0, len(inflow) - 20 : len(inflow)]
    assert arrived.tolist() == pulse[::-1].tolist()


def test_unequal_speeds_advect_a_smooth_pulse_at_second_order_and_keep_its_volume() -> None:
    errors = []
    for cells in (100, 200, 400):
        dx = 20.0 / cells
        law = law_with(
            2, repose_slope=np.ones((2, 2)), collision_rate=np.eye(2), curvature_length=0.0
        )
        edges = np.arange(cells + 1) * dx
        flow = still(law, cells, base=(20.0 - edges[:-1] - dx / 2))
        velocity = np.array([2.0, 1.2])
        steps = round(4.0 / (dx / 2.0))

        def mass(at: np.ndarray, centre: float) -> np.ndarray:
            return 0.5 * (1 + np.tanh((at - centre) / 1.0))

        flow.rolling[:] = np.diff(mass(edges, 7.0)) / dx
        advance(flow, law, Grid(dx, dx / 2.0, 0.1), velocity, np.zeros((steps, 2)))
        exact = np.diff(mass(edges, 7.0 + 1.2 * 4.0)) / dx
        errors.append(float(np.abs(flow.rolling[1] - exact).sum() * dx))
        np.testing.assert_allclose(volume(flow) * dx, mass(edges, 7.0)[-1] - mass(edges, 7.0)[0])
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (orders > 1.6).all(), (errors, orders)


@pytest.mark.parametrize("settings", [(), ("cell.length=45.0", "mixture.drift_velocity=7.0")])
def test_a_bare_slope_between_capture_and_amplification_carries_the_feed_unchanged(settings):
    """Also where dx / v and v do not multiply back to dx in floating point."""
    steep = ["mixture.repose_slope=[[0.5, 0.5], [0.5, 0.5]]", "pour.duration=5.0"]
    text = preset_text("makse-stratification").replace(
        "theta_11 = 1.0\npsi = 0.3\ndelta = 0.25\n", ""
    )
    tables = set_values(parse_toml(text), [*steep, *settings])
    archive = continuum.pour(Experiment.parse(tables))
    assert set(np.unique(archive["rolling_thickness"])) == {0.0, 0.5}


def test_a_thin_surface_layer_on_a_flat_floor_outgrows_its_bins_without_loss() -> None:
    """All that enters the first cell comes to rest there at once, many bins high."""
    settings = ["continuum.cells=50", "mixture.surface_depth=0.01", "cell.start_slope=0.0"]
    archive = continuum.pour(load("makse-stratification", [*settings, "pour.duration=20.0"]))
    held = archive["rolling_volume"] + archive["deposited_volume"]
    np.testing.assert_allclose(held, archive["poured_volume"], rtol=1e-12, atol=1e-12)


def test_the_number_of_records_does_not_change_the_pour() -> None:
    few, many = (
        continuum.pour(load("makse-stratification", ["pour.duration=200.0", f"pour.records={n}"]))
        for n in (4, 100)
    )
    assert few["height"].isel(time=-1).equals(many["height"].isel(time=-1))
    assert few["deposit_fraction"].equals(many["deposit_fraction"])


def test_three_species_pour_as_two_do() -> None:
    settings = [
        "mixture={names=['a','b','c'], grain_diameter=[0.05,0.1,0.15], drift_velocity=1.0, "
        "repose_slope=[[1.0,1.3,1.5],[0.8,1.1,1.4],[0.6,0.9,1.2]], "
        "collision_rate=[[1.0,0.1,0.1],[0.1,1.0,0.1],[0.1,0.1,1.0]]}",
        "feed.inflow=[0.3,0.3,0.3]",
        "pour.duration=300.0",
    ]
    archive = continuum.pour(load("makse-stratification", settings))
    held = archive["rolling_volume"] + archive["deposited_volume"]
    np.testing.assert_allclose(held, archive["poured_volume"], rtol=1e-12, atol=1e-12)


def test_a_mixture_without_rates_does_not_apply() -> None:
    with pytest.raises(NotApplicableError, match=r"mixture\.collision_rate: missing"):
        law_of(load("lattice-stratification").mixture)


@pytest.mark.parametrize("setting", ["continuum.cells=2", "continuum.bins_per_depth=0.5"])
def test_a_wrong_resolution_is_refused_by_name(setting: str) -> None:
    with pytest.raises(SetupError, match=setting.partition("=")[0]):
        continuum.pour(load("makse-stratification", [setting]))


@pytest.mark.parametrize(
    ("setting", "named"),
    [
        (
            "mixture.collision_rate=[[1e9, 0.0], [0.0, 1e9]]",
            r"mixture\.collision_rate = .*sub-steps",
        ),
        ("mixture.drift_velocity=1e9", r"pour\.duration = 3000: it makes 1.2e\+13 steps"),
    ],
)
def test_a_pour_that_would_take_for_ever_is_refused(setting: str, named: str) -> None:
    with pytest.raises(SetupError, match=named):
        continuum.check(load("makse-stratification", [setting]))


def test_a_law_is_made_of_any_mixture() -> None:
    mixture = Mixture.two_species(
        1.0,
        0.3,
        0.25,
        names=["a", "b"],
        grain_diameter=[0.1, 0.3],
        drift_velocity=1.0,
        collision_rate=[[1.0, 0.5], [0.25, 2.0]],
        cross_amplification=[[0.0, 0.1], [0.2, 0.0]],
    )
    law = law_of(mixture)
    assert law.collision_rate[1][0] == 0.25
    assert law.cross_amplification[0][1] == 0.1
    assert law.surface_depth == pytest.approx(0.2)


@pytest.mark.parametrize("rate", [0.5, 200.0])
def test_both_schemes_erode_a_thin_layer_on_the_rigid_surface_alike(rate: float) -> None:
    """What is loose is a tenth of the layer; the rigid rest of the surface gives up no grains."""
    law = law_with(1, collision_rate=[[rate]], curvature_length=0.0)
    left = []
    for scheme in range(len(SCHEMES)):
        flow = still(law, 20, base=2.0 * np.arange(20)[::-1] * 0.5)
        flow.surface[0] = 0.1 * law.surface_depth
        flow.height[:] += flow.surface[0]
        flow.rolling[0] = 0.01
        step = 1e-3 / rate
        grid = Grid(0.5, step, 0.1, scheme=scheme)
        advance(flow, law, grid, np.array([0.5 / step]), np.full((20, 1), 0.01))
        left.append(flow.surface[0, 10])
    assert left[1] == pytest.approx(left[0], rel=2e-3)
    assert left[0] < 0.1 * law.surface_depth


@pytest.mark.parametrize("scheme", SCHEMES)
def test_capture_much_faster_than_a_step_leaves_nothing_rolling_far_down(scheme: str) -> None:
    settings = ["mixture.drift_velocity=1.0", "feed.inflow=[0.001]", "cell.start_slope=0.0"]
    grids = ["continuum.cells=30", f"continuum.scheme={scheme}"]
    archive = continuum.pour(load("de-gennes-silo", [*settings, *grids]))
    laid = (archive["height"].isel(time=-1) - archive["base_height"]).values
    assert laid[archive["x"].values > 5].sum() < 1e-9 * laid.sum()


def test_dispersion_into_a_wall_overfills_no_tape() -> None:
    settings = [
        "mixture.dispersion=10.0",
        "mixture.drift_velocity=1.0",
        "mixture.collision_rate=[[1.72]]",
        "mixture.repose_slope=[[0.22]]",
        "mixture.surface_depth=0.0176",
        "cell={length=10.0, start_slope=1.0}",
        "feed.inflow=[0.51]",
        "continuum.cells=16",
        "pour.duration=45.0",
    ]
    archive = continuum.pour(load("bcre", settings))
    held = archive["rolling_volume"] + archive["deposited_volume"]
    np.testing.assert_allclose(held, archive["poured_volume"], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        (("mixture.surface_depth=1e-9",), r"mixture\.surface_depth = 1e-09: bins of"),
        (("mixture.drift_velocity=1e-6",), r"cell\.turning_rate = 0\.1: .* would roll"),
    ],
)
def test_a_drum_too_fine_or_too_slow_to_hold_is_refused(settings, named: str) -> None:
    with pytest.raises(SetupError, match=named):
        continuum.check(load("drum-mixture", settings))


def test_a_section_through_a_drum_shows_each_half_where_it_lies() -> None:
    """Large grains only in the half ring's part below the uphill side."""
    experiment = load("drum-mixture", ["cell.start_composition=[1.0, 0.0]", "cell.start_slope=0.0"])
    grid = Resolution.parse(experiment.continuum, "continuum").grid(experiment)
    slope = slopes_of(experiment, grid, 200, law_of(experiment.mixture))[0]
    for row, count in enumerate(slope.flow.sealed):
        uphill = slice(0, count // 2)
        slope.flow.tape[:, row, uphill] = slope.flow.tape[::-1, row, uphill]
    z, fraction = heights_in_drum(slope), section_of_drum(slope, 10.0)
    below = (z > 1.0) & (z < 8.0)
    assert np.nanmin(fraction[below][:, 110:130, 0]) > 0.99, "downhill: small"
    assert np.nanmin(fraction[below][:, 70:90, 1]) > 0.99, "uphill: large"
    shallow = (z > 9.5) & (z < 10.0)
    assert np.isfinite(fraction[shallow][:, 40:60]).all()


def test_limiters_take_differences_as_steep_as_they_may() -> None:
    expected = {
        "minmod": (1.0, 1.0, 0.0),
        "van_leer": (1.5, 1.0, 0.0),
        "monotonized_central": (2.0, 1.0, 0.0),
        "superbee": (2.0, 1.0, 0.0),
    }
    for name, found in expected.items():
        place = LIMITERS.index(name)
        pairs = ((1.0, 3.0), (1.0, 1.0), (1.0, -1.0))
        assert tuple(limited(place, *pair) for pair in pairs) == found
        assert limited(place, -1.0, -3.0) == -found[0]
    assert limited(LIMITERS.index("superbee"), 1.0, 1.5) == 1.5
    assert limited(LIMITERS.index("monotonized_central"), 1.0, 1.5) == 1.25
