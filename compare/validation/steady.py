"""Steady piles against their closed forms: section III, de Gennes' solutions, the minimal model."""

from itertools import pairwise

import numpy as np
import xarray as xr

from compare.quantities import cell_length, cell_width, total_inflow, values_of
from compare.validation.check import POWER, ROUND_OFF, SCHEME, Check, Checks, Poured
from continuum import law_of
from continuum.theory import (
    SteadyState,
    drum_of,
    minimal_model_of,
    silo_of,
    steady_state_of,
)
from experiment import load
from experiment.archive import experiment_of
from experiment.arrays import Floats
from experiment.law import interaction

__all__ = [
    "CELLS",
    "drum_errors",
    "exponents",
    "minimal_model",
    "mixing_length",
    "one_species",
    "orders_of",
    "profile",
    "slope_error",
    "unbalanced",
]

SECTION_III = "Makse 1997, sec. III, full form"
DE_GENNES = "de Gennes; Makse 1997, sec. II (BCRE, D = 0)"
MINIMAL = "Boutreux and de Gennes; Makse 1997, sec. II"
CELLS = (75, 150, 300)
PLACES = (15.0, 17.5, 20.0, 25.0)  # cm
APART = {  # worked out from the paper's equations apart from this code, to four digits
    "theta(0)": 0.5111,
    "theta(x_m)": 0.4000,
    "phi_1(15 cm)": 0.3844,
    "phi_1(17.5 cm)": 0.1299,
    "phi_1(20 cm)": 0.0409,
    "phi_1(25 cm)": 0.0034,
}
FOURTH_DIGIT = 5e-5
NEAR = {"theta(dx)": 6e-4, "theta(x_m)": 2e-3}  # beside the source and at a corner of theta


def profile(poured: Poured) -> Checks:
    """The profile figure of section III (`makse-profile`; L = 30 cm, R0 = 0.25 cm, psi = 0.2).

    The closed form has the numbers that were worked out apart from this code, and solves the
    equations; the pour comes to it, by either scheme, at the scheme's order.
    """
    state = steady_state_of(load("makse-profile"))
    for (name, expected), found in zip(APART.items(), closed_numbers(state), strict=True):
        yield Check(
            f"closed form: {name}",
            SECTION_III,
            expected,
            found,
            FOURTH_DIGIT,
            "half its last digit",
        )
    yield Check(
        "closed form in the equations: largest |Gamma_a + phi_a dh/dt| / (v R0 / L)",
        "Makse 1997, eqs. (mcs-r) and phi_a dh/dt = -Gamma_a",
        0.0,
        unbalanced(state),
        1e-13,
        "round-off",
    )
    last = poured("continuum", "makse-profile").isel(time=-1)
    for name, found, expected in poured_numbers(last, state):
        yield Check(
            f"poured, godunov: {name}, 300 cells",
            SECTION_III,
            expected,
            found,
            NEAR.get(name, 3e-4),
            "O(dx)",
        )
    yield Check(
        "poured, godunov: largest error of R_1 and R_2 / R0, 300 cells",
        SECTION_III,
        0.0,
        rolling_error(last, state),
        3e-9,
        "what is left of the transient",
    )
    yield Check(
        "poured, godunov: mixing length r = v / (gamma psi), from ln(R_1 / R_2), 300 cells",
        SECTION_III,
        state.mixing_length,
        mixing_length(last),
        1e-4,
        "O(dx^2)",
        "cm",
    )
    for scheme, order, allowed, limit in (("godunov", 1.0, 0.12, 1e-3), ("muscl", 2.0, 0.25, 4e-5)):
        settings = [(f"continuum.cells={n}", f"continuum.scheme={scheme}") for n in CELLS]
        errors = [
            slope_error(poured("continuum", "makse-profile", *chosen).isel(time=-1))
            for chosen in settings
        ]
        what = f"poured, {scheme}: mean |error| of theta"
        yield Check(f"{what}, 300 cells", SECTION_III, 0.0, errors[-1], limit, f"O(dx^{order:g})")
        for (coarse, fine), found in zip(pairwise(CELLS), orders_of(errors), strict=True):
            yield Check(
                f"{what}, order from {coarse} to {fine} cells",
                SCHEME,
                order,
                found,
                allowed,
                POWER,
            )


def closed_numbers(state: SteadyState) -> Floats:
    """What APART names, of the closed form."""
    slopes = state.slope(np.array([0.0, state.middle]))
    return np.append(slopes, state.surface_fraction(np.array(PLACES))[:, 0])


def poured_numbers(last: xr.Dataset, state: SteadyState) -> list[tuple[str, float, float]]:
    """Name, value in the pour and in the closed form; theta is known at the cells' edges."""
    x, dx = values_of(last, "x"), cell_width(last)
    edges, theta = x[:-1] + dx / 2, -np.diff(values_of(last, "height")) / dx
    at = {"theta(dx)": edges[0], "theta(x_m)": state.middle}
    found = [
        (name, float(np.interp(x_m, edges, theta)), float(state.slope(np.array([x_m]))[0]))
        for name, x_m in at.items()
    ]
    phi = np.interp(PLACES, x, values_of(last, "surface_fraction")[:, 0])
    closed = state.surface_fraction(np.array(PLACES))[:, 0]
    return found + [
        (f"phi_1({place:g} cm)", float(there), float(expected))
        for place, there, expected in zip(PLACES, phi, closed, strict=True)
    ]


def unbalanced(state: SteadyState) -> float:
    """The largest |Gamma_a + phi_a dh/dt| along the pile, over dh/dt."""
    x = np.linspace(0.0, 0.99 * state.length, 1000)
    law = law_of(load("makse-profile").mixture)
    phi = state.surface_fraction(x).T
    gamma = interaction(state.rolling_thickness(x).T, phi, state.slope(x), law)
    return float(np.abs(gamma / state.rise_velocity + phi).max())


def rolling_error(last: xr.Dataset, state: SteadyState) -> float:
    """The largest error of a rolling thickness at the cells' edges, over R0."""
    edges = values_of(last, "x") + cell_width(last) / 2
    error = values_of(last, "rolling_thickness") - state.rolling_thickness(edges)
    return float(np.abs(error).max()) / state.total_inflow


def mixing_length(last: xr.Dataset) -> float:
    """The r [cm] of R_1 / R_2 ~ exp(-x / r), from 15 to 25 cm."""
    edges = values_of(last, "x") + cell_width(last) / 2
    below = (edges > PLACES[0]) & (edges < PLACES[-1])
    small, large = values_of(last, "rolling_thickness")[below].T
    return -1.0 / float(np.polyfit(edges[below], np.log(small / large), 1)[0])


def slope_error(last: xr.Dataset) -> float:
    """Mean error of theta at the cells' edges, away from the last 7 % of the cell."""
    state = steady_state_of(experiment_of(last))
    dx = cell_width(last)
    edges = values_of(last, "x")[:-1] + dx / 2
    inside = edges < 0.93 * state.length
    error = -np.diff(values_of(last, "height")) / dx - state.slope(edges)
    return float(np.abs(error[inside]).mean())


def orders_of(errors: list[float]) -> Floats:
    """The order of convergence (step,) of `errors` where each grid is twice as fine."""
    return np.asarray(np.log2(np.array(errors[:-1]) / errors[1:]))


def one_species(poured: Poured) -> Checks:
    """De Gennes' silo, and his half-filled drum, whose slope is the same at any turning rate."""
    archive = poured("continuum", "de-gennes-silo", "pour.duration=300.0")
    of_flow, of_slope, rise = silo_errors(archive)
    yield Check("silo: largest error of R / R0", DE_GENNES, 0.0, of_flow, ROUND_OFF, "round-off")
    yield Check("silo: mean |error| of theta", DE_GENNES, 0.0, of_slope, 1e-3, "O(dx), 300 cells")
    expected = silo_of(experiment_of(archive)).rise_velocity
    yield Check("silo: dh/dt = v R0 / L", DE_GENNES, expected, rise, ROUND_OFF, "round-off", "cm/s")
    for rate in (0.1, 0.3):
        settings = ("pour.duration=200.0", f"cell.turning_rate={rate}")
        of_flow, of_slope = drum_errors(poured("continuum", "de-gennes-drum", *settings))
        name = f"drum, w = {rate} /s"
        yield Check(
            f"{name}: largest error of R / R(0)", DE_GENNES, 0.0, of_flow, 6e-4, "O(dx), 200 cells"
        )
        yield Check(
            f"{name}: mean |error| of theta", DE_GENNES, 0.0, of_slope, 2e-3, "O(dx), 200 cells"
        )


def silo_errors(archive: xr.Dataset) -> tuple[float, float, float]:
    """Largest error of R / R0, mean error of theta up to 28 cm, and dh/dt [cm/s]."""
    state, last = silo_of(experiment_of(archive)), archive.isel(time=-1)
    dx = cell_width(archive)
    edges = values_of(last, "x")[:-1] + dx / 2
    rolling = values_of(last, "rolling_thickness")[:-1, 0]
    of_flow = np.abs(rolling - state.rolling_thickness(edges)).max() / total_inflow(archive)
    error = -np.diff(values_of(last, "height")) / dx - state.slope(edges)
    inner = edges < 28.0
    rise = archive["height"].isel(time=[-2, -1]).diff("time") / archive["time"].diff("time")
    return float(of_flow), float(np.abs(error[inner]).mean()), float(rise.mean())


def drum_errors(archive: xr.Dataset) -> tuple[float, float]:
    """Largest error of R, relative to the largest R, and mean error of s, away from the rims."""
    experiment = experiment_of(archive)
    state, last = drum_of(experiment), archive.isel(time=-1)
    dx = experiment.cell.length / last.sizes["x"]
    edges = last["x"].values[1:-1] + dx / 2
    theta = -np.diff(last["height"].values) / dx
    s = theta[1:] + (experiment.mixture.curvature_length or 0.0) * np.diff(theta) / dx
    inner = np.abs(edges) < 8.0
    rolling = last["rolling_thickness"].values[1:-1, 0]
    thickest = state.rolling_thickness(np.zeros(1))[0]
    of_flow = np.abs(rolling - state.rolling_thickness(edges)).max() / thickest
    return float(of_flow), float(np.abs(s - state.slope(edges))[inner].mean())


def minimal_model(poured: Poured) -> Checks:
    """How few rough grains thin out towards the wall of `bdg-minimal`: R_1 ~ y (1 + B y)^(A/B - 1).

    With y = (L - x) / L; a power law y^(A/B) where B y >> 1, here from 24 to 54. Both powers are
    fitted over the same y.
    """
    for rough in (0.55, 0.6, 0.7):
        archive = poured(
            "continuum",
            "bdg-minimal",
            f"mixture.repose_slope=[[{rough}, {rough}], [0.4, 0.4]]",
            "feed.inflow=[0.00025, 0.24975]",
            "pour.records=2",
            "continuum.scheme=muscl",
        )
        found, expected = exponents(archive)
        power = minimal_model_of(experiment_of(archive)).exponent
        yield Check(
            f"exponent of R_1 over y = 0.4 to 0.9, A/B = {power:.1f}",
            MINIMAL,
            expected,
            found,
            3e-3,
            "0.1 % of rough grains, not none",
        )


def exponents(archive: xr.Dataset) -> tuple[float, float]:
    """The power of y with which R_1 grows from y = 0.4 to 0.9: in the pour, in the closed form."""
    model = minimal_model_of(experiment_of(archive))
    edges = values_of(archive, "x") + cell_width(archive) / 2
    y = (cell_length(archive) - edges) / cell_length(archive)
    upper = (y > 0.4) & (y < 0.9)
    rolling = values_of(archive, "rolling_thickness")[-1, upper, 0]
    found, closed = (
        float(np.polyfit(np.log(y[upper]), np.log(r), 1)[0])
        for r in (rolling, model.profile(edges[upper]))
    )
    return found, closed
