"""The limit of small grains: where the lattice at the continuum's rates goes as u -> 0.

`makse-stratification`, with d and l as they are, is poured with grains n times as small as the
preset's, on columns w wide. As d is the preset's mean diameter, n is how many grains the surface
layer is thick. On columns the slope is that to the downhill neighbour, as in the continuum's scheme
of first order with dx = w, which is what the lattice is held against; how far that scheme is from
dx -> 0, the one of second order tells. The continuum knows no chance: it is poured on START_SLOPES
a little unlike, and their scatter is the error of the mean.

    lattice - continuum = A (8 / n)^p + c

is fitted, from n = LEAST on, to the sizes on columns of one width by least squares, weighted by the
errors of the means: the first term falls with u, c is left without grains. Where chi2 / dof is
above 1, the errors are larger by its root.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from scipy.optimize import curve_fit

from compare.bridge.ensembles import means_over_piles, pour_alike, pour_piles, share_of
from compare.campaign import Pour
from compare.convergence import FORMAL_ORDER, QUANTITIES
from compare.convergence import limit as as_dx_vanishes
from compare.quantities import named
from experiment import Experiment, load
from experiment.arrays import Floats
from experiment.pouring import Progress

__all__ = ["CAUSES", "LEAST", "ONE", "PLAN", "PowerLaw", "grid", "lattice", "limit", "power_law"]

PRESET = "makse-stratification"
PLAN: dict[float, tuple[int, ...]] = {  # width of a column, cm: how many times smaller grains are
    0.5: (1, 2, 4, 8, 16, 32, 64, 128, 256),
    0.25: (4, 8, 16, 32, 64),
    0.125: (32,),
    0.0625: (16,),
}
FEW = 0.25  # cm; piles of narrower columns take long, and are a third as many
START_SLOPES = (0.97, 1.0, 1.03)
GRIDS = (200, 400, 800)  # cells, of the second order
ONE = (8, 0.5)  # n and w, about which one thing is changed at a time
EXAMPLES = (1, 2, 8, 64)  # n, of which deposits are drawn
CAUSES: dict[str, dict[str, object]] = {
    "arrivals: each grain drawn": {"ca_model.arrivals": "drawn"},
    "feed: half": {"feed.inflow": [0.25, 0.25]},
    "l: four times": {"mixture.curvature_length": 0.4},
    "small grains: a quarter": {
        "mixture.grain_diameter": [1 / 480, 1 / 60],
        "ca_model.unit": 1 / 480,
    },
    "large grains: a quarter": {
        "mixture.grain_diameter": [1 / 120, 1 / 240],
        "ca_model.unit": 1 / 240,
    },
    "d: half": {"mixture.surface_depth": 0.05},
    "d: twice": {"mixture.surface_depth": 0.2},
}
DEPOSIT = "fraction of large grains, columns let down to one floor"
OF_GRAINS = ("ca_model.", "mixture.grain_diameter")
LEAST = 4  # n that the law is fitted from
FEWEST = 5  # sizes that its three numbers are fitted to

Plan = Mapping[float, Sequence[int]]
Causes = Mapping[str, Mapping[str, object]]
Variables = dict[str, tuple[str | tuple[str, ...], Any, dict[str, str]]]


class PowerLaw(NamedTuple):
    """A u^p + c: A, p and c, their standard errors, and how well they fit."""

    values: Floats
    errors: Floats
    chi2_dof: float


NO_LAW = PowerLaw(np.full(3, np.nan), np.full(3, np.nan), np.nan)


def limit(
    seeds: int,
    workers: int | None,
    progress: Progress,
    *,
    plan: Plan = PLAN,
    causes: Causes = CAUSES,
    grids: Sequence[int] = GRIDS,
    examples: Sequence[int] = EXAMPLES,
) -> xr.Dataset:
    """Mean wavelength [cm] and velocities [cm/s] of lattice and continuum, and how they approach.

    For each NAME of them, with its NAME_error: NAME(width, fineness), NAME_continuum(width) on a
    grid of that dx, NAME_extrapolated as dx -> 0; NAME_amplitude, NAME_exponent and NAME_remainder
    (width,), the A, p and c of the law above, with NAME_chi2_dof; and cause_NAME(cause) and
    cause_NAME_continuum(cause), where one thing is changed. NaN where nothing was poured, or too
    few piles have layers; NAME_count(width, fineness) says how many have. And deposit (example,
    row, column) of some sizes and of the continuum, columns let down to one floor.
    """
    coordinates = {
        "width": ("width", list(plan), named("width w of a column", "cm")),
        "fineness": ("fineness", _sizes(plan), named("n, how many times smaller grains are")),
        "cause_name": ("cause", list(causes), named("what was changed", "")),
        "example_name": (
            "example",
            [*(f"n = {n}" for n in examples), "continuum"],
            named("whose deposit it is", ""),
        ),
    }
    told = _continuum(plan, causes, grids, workers, share_of(progress, 0.0, 0.2))
    told |= _lattices(plan, causes, seeds, workers, share_of(progress, 0.2, 1.0))
    told["deposit"] = (("example", "row", "column"), _deposits(examples), named(DEPOSIT))
    told["least"] = ((), LEAST, named("n that the laws are fitted from"))
    told["amplitude_at"] = ((), ONE[0], named("n of the amplitudes"))
    found = xr.Dataset(told, coordinates, {"title": "The limit of small grains"})
    return found.assign(_laws(found))


def lattice(n: int, width: float) -> Experiment:
    """The set-up with grains `n` times as small, on columns of this width [cm]."""
    setup = load(PRESET)
    values = {
        "mixture.grain_diameter": [d / n for d in setup.mixture.grain_diameter],
        "ca_model.rule": "rate",
        "ca_model.column_width": width,
    }
    return setup.with_values(values)


def grid(dx: float, scheme: str = "godunov") -> Experiment:
    """The set-up for the continuum on cells of this width [cm]."""
    setup = load(PRESET)
    cells = round(setup.cell.length / dx)
    return setup.with_values({"continuum.cells": cells, "continuum.scheme": scheme})


def power_law(u: Floats, difference: Floats, error: Floats) -> PowerLaw:
    """A u^p + c through `difference` (point,) with standard `error`.

    NaN for fewer than FEWEST points, and where A is not known to better than itself.
    """
    there = np.isfinite(difference) & np.isfinite(error) & (error > 0)
    if there.sum() < FEWEST:
        return NO_LAW
    u, difference, error = u[there], difference[there], error[there]
    guess = (difference[np.argmax(u)] / u.max(), 1.0, 0.0)
    values, covariance = curve_fit(
        _power_law, u, difference, guess, error, absolute_sigma=True, maxfev=10_000
    )
    chi2_dof = float((((difference - _power_law(u, *values)) / error) ** 2).sum())
    chi2_dof /= max(len(u) - len(values), 1)
    errors = np.sqrt(max(chi2_dof, 1.0) * np.diag(covariance))
    if not errors[0] < abs(values[0]):
        return NO_LAW
    return PowerLaw(values, errors, chi2_dof)


def _power_law(u: Floats, amplitude: float, exponent: float, remainder: float) -> Floats:
    return amplitude * u**exponent + remainder


def _continuum(
    plan: Plan, causes: Causes, grids: Sequence[int], workers: int | None, progress: Progress
) -> Variables:
    """The continuum on the grid of each width, of each cause, and as dx -> 0."""
    changed = [
        {key: value for key, value in change.items() if not key.startswith(OF_GRAINS)}
        for change in causes.values()
    ]
    setups = [grid(w) for w in plan]
    setups += [grid(ONE[1]).with_values(change) for change in changed]
    setups += [grid(load(PRESET).cell.length / cells, "muscl") for cells in grids]
    ensembles = [
        [setup.with_values({"cell.start_slope": slope}) for slope in START_SLOPES]
        for setup in setups
    ]
    found = means_over_piles(
        pour_alike(ensembles, model="continuum", workers=workers, progress=progress)
    )
    ends = len(plan), len(plan) + len(causes)
    by_grid = found.isel(setup=slice(ends[1], None))
    return (
        _rows(found.isel(setup=slice(ends[0])), "{}_continuum", "width")
        | _rows(found.isel(setup=slice(*ends)), "cause_{}_continuum", "cause")
        | _extrapolated(by_grid, grids[1] / grids[0])
    )


def _extrapolated(found: xr.Dataset, ratio: float) -> Variables:
    """What the second order tends to, with the error of the grids and of the finest one's mean."""
    told: Variables = {}
    for name in QUANTITIES:
        tends = as_dx_vanishes(found[name].values, ratio, FORMAL_ORDER["muscl"])
        error = float(np.hypot(tends.error, found[f"{name}_error"][-1]))
        units, meaning = found[name].attrs["units"], f"continuum's {name} as dx -> 0"
        told[f"{name}_extrapolated"] = ((), tends.value, named(meaning, units))
        told[f"{name}_extrapolated_error"] = ((), error, named(f"error of {meaning}", units))
    return told


def _lattices(
    plan: Plan, causes: Causes, seeds: int, workers: int | None, progress: Progress
) -> Variables:
    """The piles of grains of all sizes, and of all causes."""
    cases = [(w, n) for w, sizes in plan.items() for n in sizes]
    many = [case for case in cases if case[0] >= FEW]
    few = [case for case in cases if case[0] < FEW]
    setups = [lattice(n, w) for w, n in many]
    setups += [lattice(*ONE).with_values(dict(change)) for change in causes.values()]
    piles = means_over_piles(
        pour_piles(setups, seeds, workers=workers, progress=share_of(progress, 0.0, 0.6))
    )
    told = _rows(piles.isel(setup=slice(len(many), None)), "cause_{}", "cause")
    piles = piles.isel(setup=slice(len(many)))
    if few:
        setups = [lattice(n, w) for w, n in few]
        rest = means_over_piles(
            pour_piles(
                setups, max(2, seeds // 3), workers=workers, progress=share_of(progress, 0.6, 1.0)
            )
        )
        piles = xr.concat([piles, rest], "setup")
    widths, sizes = list(plan), _sizes(plan)
    for name, there in piles.data_vars.items():
        table = np.full((len(widths), len(sizes)), np.nan)
        for (w, n), value in zip([*many, *few], there.values, strict=True):
            table[widths.index(w), sizes.index(n)] = value
        told[str(name)] = (("width", "fineness"), table, there.attrs)
    return told


def _deposits(examples: Sequence[int]) -> Floats:
    """Pictures (example, row, column) of deposits."""
    pours = [Pour("ca_model", lattice(n, ONE[1]), picture=True) for n in examples]
    pours.append(Pour("continuum", grid(ONE[1]), picture=True))
    return np.array([pour().picture for pour in pours])


def _laws(found: xr.Dataset) -> Variables:
    """The law of each quantity on columns of each width."""
    told: Variables = {}
    found = found.sel(fineness=found["fineness"] >= LEAST)
    u = ONE[0] / found["fineness"].values
    for name in QUANTITIES:
        difference = found[name] - found[f"{name}_continuum"]
        error = np.hypot(
            found[f"{name}_error"].values, found[f"{name}_continuum_error"].values[:, None]
        )
        laws = [power_law(u, *rows) for rows in zip(difference.values, error, strict=True)]
        units = found[name].attrs["units"]
        for k, (part, unit, meaning) in enumerate(
            (
                ("amplitude", units, f"what grains of n = {ONE[0]} add to {name}"),
                ("exponent", "1", f"power p of u with which that falls for {name}"),
                ("remainder", units, f"what is added to {name} without grains"),
            )
        ):
            values = [[law.values[k] for law in laws], [law.errors[k] for law in laws]]
            told[f"{name}_{part}"] = ("width", values[0], named(meaning, unit))
            told[f"{name}_{part}_error"] = ("width", values[1], named(f"error of {part}", unit))
        chi2 = [law.chi2_dof for law in laws]
        told[f"{name}_chi2_dof"] = ("width", chi2, named("chi2 over degrees of freedom"))
    return told


def _rows(found: xr.Dataset, called: str, dim: str) -> Variables:
    """The means and errors of `found` (setup,) over another dimension, by other names."""
    return {
        called.format(name) + ending: (dim, found[name + ending].values, found[name + ending].attrs)
        for name in QUANTITIES
        for ending in ("", "_error")
    }


def _sizes(plan: Plan) -> list[int]:
    return sorted({n for sizes in plan.values() for n in sizes})
