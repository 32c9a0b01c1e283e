"""A small picture of a deposit, for where many are looked at together."""

import numpy as np
import xarray as xr

from compare.deposit.profiles import let_down
from compare.quantities import coarseness
from experiment.arrays import Floats

__all__ = ["PIXEL", "SHAPE", "averaged", "picture_of"]

SHAPE = 120, 120  # rows, columns
PIXEL = np.dtype("<f4")


def picture_of(archive: xr.Dataset) -> Floats:
    """Coarseness (row, column) of the deposit, its columns let down to one floor, NaN above it.

    Each is the mean of what lies there, in pictures of one SHAPE.
    """
    deposit = coarseness(archive["deposit_fraction"], archive).transpose("z", "x")
    coarse = let_down(deposit.values.astype(np.float64)).coarse
    return averaged(coarse, SHAPE).astype(PIXEL)


def averaged(coarse: Floats, shape: tuple[int, int]) -> Floats:
    """Means of what is there of `coarse` (z, x) over blocks, (row, column) of `shape`; else NaN."""
    inside = np.isfinite(coarse)
    total, number = (
        _blocks(values, shape) for values in (np.where(inside, coarse, 0.0), inside * 1.0)
    )
    return np.where(number > 0, total / np.maximum(number, 1.0), np.nan)


def _blocks(values: Floats, shape: tuple[int, int]) -> Floats:
    """Sums of `values` (z, x) over blocks, one for each place in the picture."""
    for axis, (cells, places) in enumerate(zip(values.shape, shape, strict=True)):
        begin = np.arange(places) * cells // places
        values = np.add.reduceat(values, begin, axis=axis)
    return values
