"""Real grains: how irregular glass and sugar lie because they are grains of a size.

A grain of the lattice is w wide and as deep as the cell is thick; what it stands for is its volume.
A bead or a cube of diameter d in a gap b, packed to SOLID, takes per unit gap

    pi d^3 / (6 b SOLID)        d^3 / (b SOLID)

and a lattice grain of this volume is lower than d; surface layer and curvature length keep their
true thickness. Where grains make the scatter, it follows the root of the mean volume of what is
fed, of which a species' share is that of its volume:

    V = sum_a (R_a / R0) V_a        scatter / mean = c (V / V_true)^p,    p = 1/2

The fit is through sugar of fewer beads up to the true one. What is larger stands for lumps that
move as one; they are let in to see how far it holds. The continuum, which has no grains, tells what
the instrument scatters by.
"""

from collections.abc import Sequence
from math import pi
from typing import Any, Literal, NamedTuple

import numpy as np
import xarray as xr
from rich.table import Table
from rich.text import Text

from compare.bridge.ensembles import means_over_piles, share_of
from compare.bridge.irregular import Irregular, pour_irregular
from compare.campaign import campaign
from compare.convergence import QUANTITIES
from compare.ensemble import draws, mean_and_error, piles, predict
from compare.quantities import named
from compare.regimes import LAYERED_REGIMES
from compare.scaling import Polynomial, fit
from compare.table import with_error
from experiment import Experiment, load
from experiment.arrays import Floats
from experiment.pouring import Progress

__all__ = ["SIZES", "Size", "grains", "grains_table", "mean_volume", "poured_as"]

PRESET = "glass-sugar"
GLASS, SUGAR, WIDTH = 0.027, 0.08, 0.27  # cm; d_1, d_2 and w
GAP, SOLID = 0.5, 0.6  # cm between the plates; share of a volume that grains fill
BEAD, CUBE = pi * GLASS**3 / (6 * GAP * SOLID), SUGAR**3 / (GAP * SOLID)  # cm2
DRAWS, DRAWN_CELLS = 40, 111
ENDS = ("", "_error")
SCATTERS = ("layer_scatter", "kink_scatter")
TOLD = (*SCATTERS, "layering", "kinks_residual", "velocities_residual")

Variables = dict[str, tuple[str | tuple[str, ...], Any, dict[str, str]]]


class Size(NamedTuple):
    """What a grain is, and how grains come."""

    name: str
    volume: tuple[float, float]  # cm2, per unit gap, of glass and of sugar; 0: the continuum's
    width: float = WIDTH  # cm, of a column or a cell
    arrivals: Literal["fixed", "poisson"] = "fixed"
    fitted: bool = False  # whether the fit is through it


TRUE = (BEAD, CUBE)
ROW = (GLASS * GLASS, GLASS * SUGAR)


def _lumps(of: tuple[float, float], times: float) -> tuple[float, float]:
    return times * of[0], times * of[1]


SIZES = (
    Size("continuum, dx to 0", (0.0, 0.0), WIDTH / 2),
    Size("continuum, dx = w", (0.0, 0.0)),
    *(Size(f"sugar of {n} beads", (BEAD, n * BEAD), fitted=True) for n in (3, 6, 12, 25)),
    Size("true", TRUE, fitted=True),
    Size("true x 1/4", _lumps(TRUE, 0.25)),
    *(Size(f"true x {times}", _lumps(TRUE, times)) for times in (2, 4, 8)),
    Size("row, d x d", ROW),
    Size("slab, 10 d x d", _lumps(ROW, 10.0)),
    Size("true, w / 2", TRUE, WIDTH / 2),
    Size("true, Poisson feed", TRUE, arrivals="poisson"),
    Size("row, Poisson feed", ROW, arrivals="poisson"),
)


def grains(
    seeds: int,
    workers: int | None,
    progress: Progress,
    *,
    sizes: Sequence[Size] = SIZES,
    duration: float = 360.0,
    drawn: int = DRAWS,
) -> xr.Dataset:
    """Means and scatter over `size`, how scatter grows with volume, and what else is uncertain.

    For each NAME of QUANTITIES: NAME(size) with NAME_error, NAME_scatter and NAME_count, of piles;
    NAME_pile(size, pile); NAME_drawn(quantile), of the continuum for `drawn` uncertain inputs. Of
    TOLD, with errors, by size; and of SCATTERS, over the mean, the fit: coefficient c, exponent p.
    deposit(size, row, column): coarseness of a pile, deposit_height [cm] high.
    """
    jobs = [_jobs(size, seeds, duration) for size in sizes]
    found = pour_irregular(jobs, workers, share_of(progress, 0.0, 0.9))
    layered = found["regime"].isin(LAYERED_REGIMES)
    volume = np.array([mean_volume(size) for size in sizes])
    told = _means(found) | _drawn(drawn, duration, workers, share_of(progress, 0.9, 1.0))
    told["layered"] = (
        "size",
        layered.sum("pile").values / [len(of_size) for of_size in jobs],
        named("share of the piles that have layers"),
    )
    told["volume"] = ("size", volume, named("mean volume of a grain, per unit gap", "cm2"))
    told["deposit"] = (("size", "row", "column"), found["picture"].values, named("coarseness"))
    told["deposit_height"] = (
        "size",
        found["picture_height"].max("pile").values,
        named("height of the picture", "cm"),
    )
    fitted = np.array([size.fitted for size in sizes]) & (told["layered"][1] == 1)
    for name in TOLD:
        pairs = [mean_and_error(row[np.isfinite(row)]) for row in found[name].where(layered).values]
        mean, error = np.transpose(pairs)
        meaning = str(found[name].attrs["long_name"])
        told[name] = ("size", mean, named(f"{meaning}, mean of the piles"))
        told[f"{name}_error"] = ("size", error, named(f"standard error of {name}"))
    for name in SCATTERS:
        told |= _power(name, volume[fitted], *(told[f"{name}{end}"][1][fitted] for end in ENDS))
    return xr.Dataset(
        told,
        {"size": ("size", [size.name for size in sizes], named("what a grain is", ""))},
        {"title": "Real grains: glass and sugar"},
    )


def mean_volume(size: Size) -> float:
    """V [cm2], per unit gap, of equal volumes of both species."""
    return sum(size.volume) / 2


def poured_as(size: Size, duration: float) -> Experiment:
    """The preset with grains of this size; its layer and curvature length are the true ones."""
    setup = load(PRESET)
    changed = {
        "mixture.surface_depth": setup.mixture.surface_depth,
        "mixture.curvature_length": setup.mixture.curvature_length,
    } | _recorded(duration)
    if mean_volume(size) == 0:
        scheme = "godunov" if size.width == WIDTH else "muscl"
        cells = round(setup.cell.length / size.width)
        return setup.with_values(changed | {"continuum.cells": cells, "continuum.scheme": scheme})
    lattice = {
        "mixture.grain_diameter": [volume / size.width for volume in size.volume],
        "ca_model.rule": "rate",
        "ca_model.column_width": size.width,
        "ca_model.arrivals": size.arrivals,
    }
    return setup.with_values(changed | lattice)


def _recorded(duration: float) -> dict[str, object]:
    return {"pour.duration": duration, "pour.records": round(10 * duration)}


def _jobs(size: Size, seeds: int, duration: float) -> list[Irregular]:
    """Piles of one size; of the continuum there is one."""
    setup = poured_as(size, duration)
    if mean_volume(size) == 0:
        return [Irregular("continuum", setup, picture=True)]
    return [
        Irregular("ca_model", pile, picture=k == 0) for k, pile in enumerate(piles(setup, seeds))
    ]


def _means(found: xr.Dataset) -> Variables:
    """Of QUANTITIES over piles; a single pile has its own error."""
    means = means_over_piles(found)
    layered = found["regime"].isin(LAYERED_REGIMES)
    told: Variables = {}
    for name in QUANTITIES:
        error, own = means[f"{name}_error"], found[f"{name}_error"].isel(pile=0).values
        means[f"{name}_error"] = error.where(means[f"{name}_count"] != 1, own)
        each = found[name].where(layered).values
        told[f"{name}_pile"] = (("size", "pile"), each, dict(found[name].attrs))
    told |= {str(n): ("size", there.values, dict(there.attrs)) for n, there in means.items()}
    return told


def _drawn(count: int, duration: float, workers: int | None, progress: Progress) -> Variables:
    """What the continuum predicts where inputs are uncertain, as quantiles."""
    grid = _recorded(duration) | {"continuum.scheme": "muscl", "continuum.cells": DRAWN_CELLS}
    drawn, inputs = draws(load(PRESET), count)
    setups = [setup.with_values(grid) for setup in drawn]
    found = predict(campaign(setups, ["continuum"], workers=workers, progress=progress), inputs)
    told: Variables = {
        f"{name}_drawn": ("quantile", there.values, dict(there.attrs))
        for name in QUANTITIES
        for there in [found[f"predicted_{name}"].isel(model=0)]
    }
    quantile = ("quantile", found["quantile"].values, dict(found["quantile"].attrs))
    return told | {"quantile": quantile}


def _power(name: str, volume: Floats, mean: Floats, error: Floats) -> Variables:
    """Of scatter = c (V / V_true)^p: c and p with errors, and chi2_dof."""
    line: Polynomial = fit(np.log(2 * volume / (BEAD + CUBE)), np.log(mean), error / mean)
    c, error_of_c = np.exp(line.values[0]), np.exp(line.values[0]) * line.errors[0]
    rows = {
        "coefficient": (c, f"c of {name}, at the true volume"),
        "coefficient_error": (error_of_c, f"standard error of c of {name}"),
        "exponent": (line.values[1], f"p of {name}"),
        "exponent_error": (line.errors[1], f"standard error of p of {name}"),
        "chi2_dof": (line.chi2_dof, f"chi2 of the fit of {name} over its degrees of freedom"),
    }
    return {f"{name}_{row}": ((), value, named(told)) for row, (value, told) in rows.items()}


def grains_table(found: xr.Dataset) -> Table:
    """A row for each size: what it laid, and how irregularly."""
    columns = ("V (cm2)", "layered", *QUANTITIES, *(name.replace("_", " ") for name in SCATTERS))
    sheet = Table("", *columns, title=Text(found.attrs["title"], style="bold"))
    for size in found["size"].values:
        there = found.sel(size=size)
        cells = [
            with_error(there[name].item(), there[f"{name}_error"].item())
            for name in (*QUANTITIES, *SCATTERS)
        ]
        shares = f"{there['volume'].item():.2g}", f"{there['layered'].item():.0%}"
        sheet.add_row(size, *shares, *cells)
    return sheet
