"""The limit of small grains: where the lattice at the continuum's rates goes as u -> 0.

`makse-stratification`, with d and l as they are, is poured with grains n times as small as the
preset's, on columns w wide. On columns the slope is that to the downhill neighbour, as in the
continuum's scheme of first order with dx = w: it is what the lattice should come to as n grows.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from rich.table import Table
from rich.text import Text

from compare.bridge.ensembles import means_over_piles, pour_piles, share_of
from compare.campaign import campaign
from compare.convergence import QUANTITIES
from compare.quantities import named
from compare.table import with_error
from experiment import Experiment, load
from experiment.arrays import Floats
from experiment.pouring import Progress

__all__ = ["limit", "limit_table"]

PRESET = "makse-stratification"
WIDTHS = (0.5, 0.25)  # cm
FINENESS = (1, 2, 4, 8, 16, 32, 64)


def limit(
    seeds: int,
    workers: int | None,
    progress: Progress,
    *,
    widths: Sequence[float] = WIDTHS,
    fineness: Sequence[int] = FINENESS,
) -> xr.Dataset:
    """Mean wavelength [cm] and velocities [cm/s] over `width` and `fineness`, and the continuum's.

    For each NAME of them: NAME(width, fineness) with NAME_error, NAME_scatter and NAME_count; and
    NAME_continuum(width) with its error, on a grid of this dx.
    """
    lattices = [lattice(n, w) for w in widths for n in fineness]
    found = means_over_piles(
        pour_piles(lattices, seeds, workers=workers, progress=share_of(progress, 0.0, 0.9))
    )
    shape = len(widths), len(fineness)
    told: dict[str, tuple[str | tuple[str, ...], Floats, dict[Any, Any]]] = {
        str(name): (("width", "fineness"), there.values.reshape(shape), there.attrs)
        for name, there in found.data_vars.items()
    }
    grids = [grid(w) for w in widths]
    continuum = campaign(
        grids, ["continuum"], workers=workers, progress=share_of(progress, 0.9, 1.0)
    ).isel(model=0)
    for name in QUANTITIES:
        for ending in ("", "_error"):
            there = continuum[f"{name}{ending}"]
            told[f"{name}_continuum{ending}"] = ("width", there.values, there.attrs)
    return xr.Dataset(
        told,
        {
            "width": ("width", np.array(widths), named("width w of a column", "cm")),
            "fineness": ("fineness", np.array(fineness), named("times smaller than the preset's")),
        },
        {"title": "The limit of small grains"},
    )


def lattice(n: int, width: float) -> Experiment:
    """The set-up with grains `n` times as small, on columns of this width [cm]."""
    setup = load(PRESET)
    small = [d / n for d in setup.mixture.grain_diameter]
    return setup.with_values(
        {
            "mixture.grain_diameter": small,
            "ca_model.rule": "rate",
            "ca_model.column_width": width,
        }
    )


def grid(dx: float) -> Experiment:
    """The set-up for the continuum on cells of this width [cm]."""
    setup = load(PRESET)
    return setup.with_values({"continuum.cells": round(setup.cell.length / dx)})


def limit_table(found: xr.Dataset) -> Table:
    """A row for each size of grains on columns of each width, then the continuum's."""
    sheet = Table("w (cm)", "n", *QUANTITIES, title=Text(found.attrs["title"], style="bold"))
    for width in found["width"].values:
        for n in found["fineness"].values:
            there = found.sel(width=width, fineness=n)
            cells = (with_error(*_and_error(there, name)) for name in QUANTITIES)
            sheet.add_row(f"{width:g}", str(n), *cells)
        there = found.sel(width=width)
        cells = (with_error(*_and_error(there, f"{name}_continuum")) for name in QUANTITIES)
        sheet.add_row(f"{width:g}", "continuum", *cells)
        sheet.add_section()
    return sheet


def _and_error(found: xr.Dataset, name: str) -> tuple[float, float]:
    return found[name].item(), found[f"{name}_error"].item()
