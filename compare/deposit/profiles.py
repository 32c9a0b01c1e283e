"""The part of a deposit that is measured: what was laid after the transient, let down.

Columns are let down to one floor, so that on a slope they take no more room than they are thick.
"""

from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from compare.deposit.kernel import extent, fallen
from compare.quantities import (
    coarseness,
    scaled_diameter,
    settled_height,
    slope_columns,
    values_of,
)
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
    later = values_of(archive, "z")[:, None] > settled_height(archive)
    return coarse.copy(data=np.where(later, coarse.values, np.nan))


def settled(archive: xr.Dataset) -> Settled:
    """The same let down, of the slope that is measured."""
    slope = slope_columns(archive)
    fraction = values_of(archive, "deposit_fraction")[:, slope]
    start = settled_height(archive)[slope]
    lowest = np.searchsorted(values_of(archive, "z"), start, side="right")
    floor, top = extent(fraction[..., 0], lowest)
    return Settled(fallen(fraction, scaled_diameter(archive), floor, top), floor, top - floor)


def let_down(coarse: Floats) -> Settled:
    """A whole deposit of coarseness `coarse` (z, x), NaN outside of it."""
    floor, top = extent(coarse, np.zeros(coarse.shape[1], np.intp))
    return Settled(fallen(coarse[..., None], np.ones(1), floor, top), floor, top - floor)
