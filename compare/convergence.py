"""Grid convergence of the continuum: wavelength and velocities as dx goes to 0, with error bars.

From a value f on three grids, f1 on the finest, each r times as fine as the next, Richardson's
extrapolation and Roache's grid convergence index follow (Annu. Rev. Fluid Mech. 29, 123 (1997)):

    p = ln((f3 - f2) / (f2 - f1)) / ln r      f = f1 + (f1 - f2) / (r^p - 1)
    error = F |f1 - f2| / (r^p - 1)           F = 1.25

Where p is not within CREDIBLE there is no observed order: p is then the formal one of the scheme,
FORMAL_ORDER, and F = 3. Where the differences change sign, the larger one makes the error, for the
last step of a sequence that swings may be small by chance.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import xarray as xr

from compare.measurement import measure, refuse_unlike
from compare.quantities import cell_length, cell_width
from experiment import ArchiveError, SetupError
from experiment.archive import experiment_of
from experiment.arrays import Floats

__all__ = ["QUANTITIES", "Limit", "converge", "limit", "refinement_ratio"]

QUANTITIES = ("wavelength", "kink_velocity", "front_velocity")
CREDIBLE = (0.5, 3.0)
FORMAL_ORDER = {"godunov": 1.0, "muscl": 2.0}  # by scheme
FEWEST_GRIDS = 3
SAFE, WIDE = 1.25, 3.0  # F with an observed order, and without
ASYMPTOTIC = 0.2  # of l, the most that a first-order scheme may add to it near the limit

COMMENT = (
    f"error bars as dx -> 0: grid convergence index of the three finest grids, factor {SAFE:g} "
    f"where the observed order is from {CREDIBLE[0]:g} to {CREDIBLE[1]:g}, else factor {WIDE:g} "
    f"at the scheme's order of the last step, or the larger one where they change sign; "
    f"in quadrature with the finest grid's standard error"
)


class Limit(NamedTuple):
    """What a value tends to as dx goes to 0, its error, and the order that was observed."""

    value: float
    error: float
    order: float  # NaN where it is not credible


def converge(archives: Sequence[xr.Dataset]) -> xr.Dataset:
    """Wavelength [cm] and velocities [cm/s] of one pour over `cells`, and their limits.

    `archives` are the continuum's, from coarse to fine. For each of QUANTITIES the Dataset holds
    NAME(cells) and NAME_error(cells), as measured, and NAME_extrapolated, NAME_extrapolated_error
    and NAME_order, which are NaN where there was nothing to measure. It carries the set-up of the
    finest grid. Raises :class:`ArchiveError` where the archives are not of the continuum or differ
    in more than their cells, :class:`SetupError` as :func:`refinement_ratio`.
    """
    cells = [round(cell_length(archive) / cell_width(archive)) for archive in archives]
    ratio = refinement_ratio(cells)
    _refuse_all_but_grids(archives)
    found = xr.concat([measure(archive) for archive in archives], "cells")
    spacing = [cell_width(archive) for archive in archives]
    finest = archives[-1].attrs
    scheme = experiment_of(archives[-1]).continuum.get("scheme", "godunov")
    formal_order = FORMAL_ORDER.get(scheme, 1.0)
    return (
        found[[name + error for name in QUANTITIES for error in ("", "_error")]]
        .assign(
            dx=("cells", spacing, {"units": "cm", "long_name": "width of a cell"}),
            refinement_ratio=((), ratio, {"units": "1", "long_name": "ratio of successive dx"}),
        )
        .assign(
            {
                row: value
                for name in QUANTITIES
                for row, value in _at_the_limit(found, name, ratio, formal_order).items()
            }
        )
        .assign_coords(
            cells=("cells", cells, {"units": "1", "long_name": "number of cells along x"})
        )
        .assign_attrs(
            {name: finest[name] for name in ("Conventions", "title", "source", "references")}
            | {
                "history": "; ".join(archive.attrs["history"] for archive in archives),
                "experiment": finest["experiment"],
                "comment": COMMENT + _caution(archives[-1]),
            }
        )
    )


def _caution(finest: xr.Dataset) -> str:
    """What is to be said where the finest grid is not near the limit; else nothing.

    The upwind slope of the first-order scheme adds dx / 2 to the curvature length l, and no law of
    powers of dx holds before that is little.
    """
    experiment = experiment_of(finest)
    added, length = cell_width(finest) / 2, experiment.mixture.curvature_length
    if experiment.continuum.get("scheme", "godunov") == "muscl" or added <= ASYMPTOTIC * length:
        return ""
    return (
        f"; these may be too short: on the finest grid the scheme adds dx / 2 = {added:g} cm to "
        f"curvature_length = {length:g} cm, try continuum.scheme = muscl"
    )


def limit(values: Sequence[float] | Floats, ratio: float, formal_order: float = 1.0) -> Limit:
    """The limit of `values`, from coarse to fine, on grids refined by `ratio`; the last 3 count.

    The error is that of the grids alone. NaN in, NaN out.
    """
    f3, f2, f1 = (float(value) for value in values[-FEWEST_GRIDS:])
    order = _observed_order(f3 - f2, f2 - f1, ratio)
    credible = CREDIBLE[0] <= order <= CREDIBLE[1]
    factor, p = (SAFE, order) if credible else (WIDE, formal_order)
    scale = ratio**p - 1
    swings = (f3 - f2) * (f2 - f1) < 0
    largest = max(abs(f1 - f2), abs(f2 - f3)) if swings else abs(f1 - f2)
    return Limit(f1 + (f1 - f2) / scale, factor * largest / scale, order if credible else math.nan)


def refinement_ratio(cells: Sequence[int]) -> float:
    """By how much each grid is finer than the one before.

    Raises :class:`SetupError` for fewer than three grids, or where they are not refined evenly.
    """
    even = all(b > a > 0 for a, b in pairwise(cells)) and all(
        b * b == a * c for a, b, c in zip(cells, cells[1:], cells[2:], strict=False)
    )
    if len(cells) < FEWEST_GRIDS or not even:
        raise SetupError(
            f"cells = {','.join(map(str, cells))}: it should be at least {FEWEST_GRIDS} numbers "
            f"that grow by one ratio, as in 100,200,400"
        )
    return cells[1] / cells[0]


def _at_the_limit(
    found: xr.Dataset, name: str, ratio: float, formal_order: float
) -> dict[str, xr.Variable]:
    """What is told of quantity `name` beside its values on each grid."""
    tends = limit(found[name].values, ratio, formal_order)
    error = math.hypot(tends.error, float(found[f"{name}_error"][-1]))
    units, meaning = found[name].attrs["units"], found[name].attrs["long_name"]
    rows = {
        f"{name}_order": (tends.order, "1", f"observed order of convergence of {name}"),
        f"{name}_extrapolated": (tends.value, units, f"{meaning}, as dx goes to 0"),
        f"{name}_extrapolated_error": (error, units, f"error of {name}_extrapolated"),
    }
    return {
        row: xr.Variable((), value, {"units": unit, "long_name": long_name})
        for row, (value, unit, long_name) in rows.items()
    }


def _observed_order(coarse_step: float, fine_step: float, ratio: float) -> float:
    """From the steps f3 - f2 and f2 - f1; NaN where they do not go the same way."""
    if coarse_step * fine_step > 0:
        return math.log(coarse_step / fine_step) / math.log(ratio)
    return math.nan


def _refuse_all_but_grids(archives: Sequence[xr.Dataset]) -> None:
    """Only pours of one set-up by the continuum tell its convergence."""
    for archive in archives:
        if archive.attrs["model"] != "continuum":
            raise ArchiveError(f"model = {archive.attrs['model']!r}; allowed: 'continuum'")
    refuse_unlike(archives)
    first, *others = ({**experiment_of(archive).continuum, "cells": 0} for archive in archives)
    if any(other != first for other in others):
        raise ArchiveError("archives of different pours: more than their continuum.cells differs")
