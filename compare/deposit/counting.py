"""The wavelength by counting: boundaries of layers along the vertical.

Going up, a pair of layers begins where the coarseness falls: small grains come to lie on large
ones. Half a pair later it rises. A fall or rise counts where the coarseness goes from beyond one
of two levels to beyond the other, HYSTERESIS of the column's range above and below its middle; its
place is half-way between where it passes the two.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from compare.deposit.kernel import boundaries
from experiment.arrays import Floats

__all__ = ["Counted", "Pairs", "count_layers", "count_pairs"]

HYSTERESIS = 0.2
FAINTEST = 0.2  # range of coarseness that may be layers
BLOCKS = 5  # parts of the slope whose differences tell an error


class Pairs(NamedTuple):
    """The pairs of layers of columns, from below; NaN past the last one of a column.

    Thicknesses (pair, x), in cells of the deposit.
    """

    pair: Floats
    small: Floats  # the lower sublayer
    large: Floats


class Counted(NamedTuple):
    """What counting tells of many columns, in cells of the deposit; NaN where there are no pairs.

    Standard errors: of cycles that differ everywhere alike, by the scatter of the k-th pairs from
    above, each averaged over the columns; in quadrature with that of slopes whose parts differ, by
    the scatter of BLOCKS of columns.
    """

    pair: float
    pair_error: float
    pair_spread: float  # of single pairs in single columns
    small: float
    small_error: float
    large: float
    large_error: float
    number: float  # of pairs in a column


NOTHING = Counted(*(np.nan,) * 7, 0.0)


def count_layers(pairs: Pairs) -> Counted:
    """Means, errors and scatter of `pairs`, over the columns that have some."""
    number = np.isfinite(pairs.pair).sum(axis=0)
    if not number.any():
        return NOTHING
    pair, small, large = (_mean_and_error(part[:, number > 0]) for part in pairs)
    every = _one_by_one(pairs.pair)
    spread = 1.4826 * float(np.median(np.abs(every - np.median(every))))
    return Counted(*pair, spread, *small, *large, float(np.median(number[number > 0])))


def count_pairs(profiles: Floats) -> Pairs:
    """The whole pairs in each column of `profiles` (z, x), NaN outside of the deposit."""
    low, high = _quantiles(profiles, (0.05, 0.95))
    middle, half = (high + low) / 2, HYSTERESIS * (high - low)
    layered = np.where(high - low >= FAINTEST, profiles, np.nan)
    places = boundaries(layered, middle - half, middle + half)
    falls = places[::2]
    pair = np.diff(falls, axis=0)
    rises = np.where(np.isfinite(pair), places[1::2][: len(pair)], np.nan)
    return Pairs(pair, rises - falls[:-1], falls[1:] - rises)


def _quantiles(profiles: Floats, shares: Sequence[float]) -> list[Floats]:
    """Of the values of each column (x,), at each of the `shares`; NaN of an empty column."""
    ordered = np.sort(profiles, axis=0)
    last = np.isfinite(profiles).sum(axis=0) - 1
    column = np.arange(profiles.shape[1])
    found = []
    for share in shares:
        below = (share * last).astype(np.intp)
        part = share * last - below
        left, right = ordered[below, column], ordered[np.minimum(below + 1, last), column]
        step = right - left
        found.append(np.where(part < 0.5, left + part * step, right - (1 - part) * step))
    return found


def _mean_and_error(values: Floats) -> tuple[float, float]:
    """Mean of `values` (pair, x), and its standard error; every column has some."""
    number = np.isfinite(values).sum(axis=0)
    from_above = number - 1 - np.arange(int(np.median(number)))[:, None]
    newest = np.where(from_above >= 0, np.take_along_axis(values, from_above, axis=0), np.nan)
    cycles = np.array([_one_by_one(row).mean() for row in newest])
    parts = np.array_split(values, BLOCKS, axis=1)
    blocks = np.array([_one_by_one(part).mean() for part in parts if part.size])
    error = np.hypot(_error_of_mean(cycles), _error_of_mean(blocks))
    return float(_one_by_one(values).mean()), float(error)


def _one_by_one(values: Floats) -> Floats:
    """Those of `values` (pair, x) that are known, column after column."""
    known: Floats = values.T[np.isfinite(values.T)]
    return known


def _error_of_mean(values: Floats) -> float:
    """Standard error of the mean; 0 of a single value, which tells none."""
    n = len(values)
    return float(values.std(ddof=1)) / np.sqrt(n) if n > 1 else 0.0
