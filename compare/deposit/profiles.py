"""The part of a deposit that is measured: what was laid after the transient, let down.

Columns are let down to one floor, so that on a slope they take no more room than they are thick.
"""

from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from compare.deposit.kernel import extent
from compare.quantities import coarseness, scaled_diameter, settled_height, slope_columns
from experiment.arrays import Floats

__all__ = ["Settled", "let_down", "settled", "settled_coarseness"]

Rows = NDArray[np.intp]


class Settled(NamedTuple):
    """The columns of a deposit, let down to one floor."""

    coarse: Floats  # (z, x) coarseness, NaN above a column
    floor: Rows  # (x,) from what height a column was let down, in cells
    height: Rows  # (x,) of the column, in cells


def settled_coarseness(archive: xr.Dataset) -> xr.DataArray:
    """Coarseness (z, x) in place of what was laid after the transient; NaN elsewhere."""
    coarse = coarseness(archive["deposit_fraction"], archive).transpose("z", "x")
    later = archive["z"].values[:, None] > settled_height(archive)
    return coarse.copy(data=np.where(later, coarse.values, np.nan))


def settled(archive: xr.Dataset) -> Settled:
    """The same let down, of the slope that is measured."""
    slope = slope_columns(archive)
    fraction, start = archive["deposit_fraction"].values[:, slope], settled_height(archive)[slope]
    lowest = np.searchsorted(archive["z"].values, start, side="right")
    floor, top = extent(fraction[..., 0], lowest)
    fallen, inside = _fallen(fraction, floor, top)
    coarse = np.where(inside, fallen @ scaled_diameter(archive), np.nan)
    return Settled(coarse, floor, top - floor)


def let_down(coarse: Floats) -> Settled:
    """A whole deposit of coarseness `coarse` (z, x), NaN outside of it."""
    floor, top = extent(coarse, np.zeros(coarse.shape[1], np.intp))
    fallen, inside = _fallen(coarse, floor, top)
    return Settled(np.where(inside, fallen, np.nan), floor, top - floor)


def _fallen(values: NDArray[Any], floor: Rows, top: Rows) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """Of `values` (z, x, ...) those from the row `floor` up, and which are below the row `top`."""
    rows = np.arange(max(1, int((top - floor).max())))[:, None] + floor
    there = np.minimum(rows, len(values) - 1), np.arange(values.shape[1])
    return values[there], rows < top
