"""The wavelength by counting: boundaries of layers along the vertical.

Going up, a pair of layers begins where the coarseness falls: small grains come to lie on large
ones. Half a pair later it rises. A fall or rise counts where the coarseness goes from beyond one
of two levels to beyond the other, HYSTERESIS of the column's range above and below its middle; its
place is half-way between where it passes the two.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from experiment.arrays import Floats

__all__ = ["Counted", "Pairs", "count_layers", "count_pairs"]

HYSTERESIS = 0.2
FAINTEST = 0.2  # range of coarseness that may be layers
BLOCKS = 5  # parts of the slope whose differences tell an error


class Pairs(NamedTuple):
    """The pairs of layers of one column, from below: thicknesses in cells of the deposit."""

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


def count_layers(columns: list[Pairs]) -> Counted:
    """Means, errors and scatter of the pairs of `columns`."""
    pairs = [one.pair for one in columns if len(one.pair)]
    if not pairs:
        return NOTHING
    pair, small, large = (
        _mean_and_error([one[part] for one in columns if len(one.pair)]) for part in range(3)
    )
    every = np.concatenate(pairs)
    spread = 1.4826 * float(np.median(np.abs(every - np.median(every))))
    number = float(np.median([len(one.pair) for one in columns]))
    return Counted(*pair, spread, *small, *large, number)


def count_pairs(profile: Floats) -> Pairs:
    """The whole pairs of a column's `profile` (z,), which has no gaps."""
    nothing = Pairs(np.zeros(0), np.zeros(0), np.zeros(0))
    low, high = np.quantile(profile, (0.05, 0.95)) if len(profile) else (0.0, 0.0)
    if high - low < FAINTEST:
        return nothing
    middle, half = (high + low) / 2, HYSTERESIS * (high - low)
    falls = _passages(-profile, -middle - half, -middle + half)
    rises = _passages(profile, middle - half, middle + half)
    if len(falls) < 2:
        return nothing
    rises = rises[np.searchsorted(rises, falls[0]) :][: len(falls) - 1]
    return Pairs(np.diff(falls), rises - falls[:-1], falls[1:] - rises)


def _passages(values: Floats, lower: float, upper: float) -> Floats:
    """Where `values` (z,) rise from below `lower` to above `upper`: half-way between."""
    known = np.where(values > upper, 1, np.where(values < lower, 0, -1))
    last = np.maximum.accumulate(np.where(known >= 0, np.arange(len(known)), -1))
    state = np.where(last >= 0, known[last], -1)
    after = np.flatnonzero((state[1:] == 1) & (state[:-1] == 0)) + 1
    before = last[after - 1]
    left = before + (lower - values[before]) / (values[before + 1] - values[before])
    right = after - (values[after] - upper) / (values[after] - values[after - 1])
    between: Floats = 0.5 * (left + right)
    return between


def _mean_and_error(columns: list[Floats]) -> tuple[float, float]:
    """Mean of the thicknesses in `columns`, and its standard error."""
    number = int(np.median([len(one) for one in columns]))
    newest = np.full((number, len(columns)), np.nan)
    for i, one in enumerate(columns):
        there = one[::-1][:number]
        newest[: len(there), i] = there
    cycles = np.array([row[np.isfinite(row)].mean() for row in newest if np.isfinite(row).any()])
    blocks = np.array([part.mean() for part in _blocks(columns)])
    error = np.hypot(_error_of_mean(cycles), _error_of_mean(blocks))
    return float(np.concatenate(columns).mean()), float(error)


def _blocks(columns: list[Floats]) -> list[Floats]:
    """What BLOCKS successive parts of the slope hold, in this order; fewer of few columns."""
    parts: list[NDArray[np.intp]] = np.array_split(np.arange(len(columns)), BLOCKS)
    return [np.concatenate([columns[i] for i in part]) for part in parts if len(part)]


def _error_of_mean(values: Floats) -> float:
    """Standard error of the mean; 0 of a single value, which tells none."""
    n = len(values)
    return float(values.std(ddof=1)) / np.sqrt(n) if n > 1 else 0.0
