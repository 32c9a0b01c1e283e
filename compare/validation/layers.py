"""Layers and zones of the continuum: convergence, the balance of volume, what delta decides."""

import math
from collections.abc import Iterable

import numpy as np
import xarray as xr

from compare.balances import volume_residual
from compare.convergence import QUANTITIES, converge
from compare.deposit import settled_coarseness
from compare.kymograph import kinks
from compare.measurement import measure
from compare.validation.check import ROUND_OFF, Check, Checks, Poured
from experiment.arrays import Floats

__all__ = [
    "BALANCE",
    "balance",
    "ends",
    "prototype",
    "refinement",
    "segregation",
    "stratification",
    "volumes",
]

BALANCE = "conservation of volume over a cycle"
PROTOTYPE = "prototype: an earlier program for the same equations, same grid"
PROTOTYPE_FOUND = {  # name of the pour: settings; wavelength [cm], v_k and v_f [cm/s]
    "dx = 0.5 cm": (("continuum.cells=200",), (3.03, 0.600, 0.715)),
    "dx = 0.25 cm": (("continuum.cells=400",), (3.05, 0.598, 0.712)),
    "dx = 0.125 cm": (("continuum.cells=800",), (3.07, 0.598, 0.710)),
    "l = 0.3 cm, dx = 0.25 cm": (
        ("continuum.cells=400", "mixture.curvature_length=0.3"),
        (2.96, 0.618, 0.723),
    ),
    "d = 0.5 cm, l = 0, dx = 0.25 cm": (
        ("continuum.cells=400", "mixture.surface_depth=0.5", "mixture.curvature_length=0.0"),
        (4.67, 0.451, 0.417),
    ),
}
READ_AS = {"wavelength": "lambda", "kink_velocity": "v_k", "front_velocity": "v_f"}
UNITS = {"wavelength": "cm", "kink_velocity": "cm/s", "front_velocity": "cm/s"}
LONG = ("pour.duration=6000.0", "pour.records=2400")
COARSE, FINE = (100, 200, 400), (200, 400, 800)
SECTION_V = "Makse 1997, sec. V"
LAYERED = "makse-stratification"
STRATIFIES = (LAYERED, "glass-sugar")
KEPT = (  # grains fall off both ends of the heap
    "makse-profile",
    "makse-stratification",
    "makse-segregation",
    "glass-sugar",
    "ternary",
    "heap",
)


def prototype(poured: Poured) -> Checks:
    """What a program written before this one found on the same grids, to first order."""
    for name, (settings, expected) in PROTOTYPE_FOUND.items():
        found = measure(poured("continuum", LAYERED, *LONG, *settings))
        for quantity, value in zip(QUANTITIES, expected, strict=True):
            yield Check(
                f"{LAYERED}, {name}: {READ_AS[quantity]}",
                PROTOTYPE,
                value,
                float(found[quantity]),
                3 * float(np.hypot(found[f"{quantity}_error"], value / 200)),
                "three errors: the standard one here, 0.5 % of the prototype's",
                UNITS[quantity],
            )


def refinement(poured: Poured) -> Checks:
    """Whether numbers as dx goes to 0 are within the error bars that `stratify converge` tells.

    What coarse grids foretell, against a finer one; and what the first-order scheme tends to,
    against the second-order one. It need not be there yet, and its bar may be too short, for its
    upwind slope adds dx / 2 to the curvature length l, which is 0.1 cm: cite `muscl`.
    """
    foretold, limit, of_godunov = (
        converge([poured("continuum", LAYERED, *LONG, *_grid(scheme, n)) for n in cells])
        for scheme, cells in (("muscl", COARSE), ("muscl", FINE), ("godunov", FINE))
    )
    finest = measure(poured("continuum", LAYERED, *LONG, *_grid("muscl", FINE[-1])))
    for name in QUANTITIES:
        bar = float(np.hypot(foretold[f"{name}_extrapolated_error"], finest[f"{name}_error"]))
        yield Check(
            f"{LAYERED}, muscl: {READ_AS[name]} as dx -> 0 from 100, 200, 400 cells",
            "the same pour on 800 cells",
            float(finest[name]),
            float(foretold[f"{name}_extrapolated"]),
            2 * bar,
            "twice the error bars of the extrapolation and of the finer grid",
            UNITS[name],
        )
    for name in QUANTITIES:
        bars = (float(one[f"{name}_extrapolated_error"]) for one in (limit, of_godunov))
        yield Check(
            f"{LAYERED}, godunov: {READ_AS[name]} as dx -> 0 from 200, 400, 800 cells",
            "muscl as dx -> 0 from the same cells",
            float(limit[f"{name}_extrapolated"]),
            float(of_godunov[f"{name}_extrapolated"]),
            math.hypot(*bars),
            "error bars of both extrapolations",
            UNITS[name],
            observed=True,
        )


def _grid(scheme: str, cells: int) -> tuple[str, ...]:
    chosen = () if scheme == "godunov" else (f"continuum.scheme={scheme}",)
    return (*chosen, f"continuum.cells={cells}")


def stratification(poured: Poured) -> Checks:
    """Mixtures with delta > 0 lay layers, as thick as volume demands: R0 v T / L.

    The wavelength is that of the deposit's spectrum, the period T that of kinks in the kymograph.
    """
    for preset in STRATIFIES:
        found = measure(poured("continuum", preset))
        yield Check(f"{preset}: regime", f"{SECTION_V}: delta > 0", "stratified", _regime(found))
        yield from balance(preset, found)


def balance(name: str, found: xr.Dataset, grain: float = 0.0) -> Checks:
    """The wavelength in the deposit against R0 v T / L, T from the kymograph.

    To the standard error of the difference or, on a lattice, to one (large) `grain` [cm].
    """
    errors = np.hypot(found["wavelength_error"], found["wavelength_of_period_error"])
    yield Check(
        f"{name}: lambda = R0 v T / L",
        BALANCE,
        float(found["wavelength_of_period"]),
        float(found["wavelength"]),
        float(np.maximum(errors, grain)),
        "a grain" if grain > errors else "standard errors",
        "cm",
    )


def segregation(poured: Poured) -> Checks:
    """Mixtures with delta < 0 part: small grains above, large ones below, and no kinks."""
    archive = poured("continuum", "makse-segregation")
    source = f"{SECTION_V}: delta < 0"
    upper, lower = ends(archive)
    yield Check("makse-segregation: kinks", source, 0.0, float(kinks(archive).sizes["event"]))
    yield Check(
        "makse-segregation: large grains in the upper third", source, 0.0, upper, 1e-3, "of all"
    )
    yield Check(
        "makse-segregation: large grains in the lower eighth", source, 1.0, lower, 1e-3, "of all"
    )
    calm = measure(poured("continuum", "makse-segregation", "mixture.surface_depth=0.5"))
    yield Check("makse-segregation, d = 0.5 cm: regime", source, "segregated", _regime(calm))
    yield Check(
        "makse-segregation, d = 0.5 cm: strength of layers",
        source,
        0.0,
        float(calm["layering"]),
        1e-3,
        "of what full layers have",
    )


def ends(archive: xr.Dataset) -> tuple[float, float]:
    """Mean share of large grains in the settled deposit's upper third and its lower eighth.

    Not within a twentieth of either end.
    """
    coarse: Floats = settled_coarseness(archive).values
    count = coarse.shape[1]
    upper = coarse[:, count // 20 : count // 3]
    lower = coarse[:, -count // 8 : -count // 20]
    return float(np.nanmean(upper)), float(np.nanmean(lower))


def volumes(poured: Poured) -> Checks:
    """What was poured is rolling, at rest, or fallen off, of each species."""
    yield Check(
        f"largest part of a species unaccounted for, in {len(KEPT)} pours",
        "conservation of each species",
        0.0,
        worst_volume(poured("continuum", preset) for preset in KEPT),
        ROUND_OFF,
        "round-off",
    )
    drum = poured("continuum", "drum-mixture")
    held = (drum["rolling_volume"] + drum["deposited_volume"]) / drum["poured_volume"]
    yield Check(
        "the same in a drum that digs up all it buries",
        "conservation of each species",
        0.0,
        float(np.abs(held - 1.0).max()),
        ROUND_OFF,
        "round-off",
    )


def worst_volume(archives: Iterable[xr.Dataset]) -> float:
    """The largest residual of the balance of volume among pours."""
    return max(volume_residual(archive) for archive in archives)


def _regime(found: xr.Dataset) -> str:
    return str(found["regime"].item())
