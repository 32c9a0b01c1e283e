"""How the layers are inclined, and profiles averaged along them.

A layer that lies at z in one column lies at z + rise in the next one. Between columns that are n
apart it has risen by the lag at which both, together with the columns beside them, are most alike,

    X(lag) = sum_z c'(x, z) c'(x + n dx, z + lag),

sought within a quarter of a wavelength, for a cycle may lay two pairs, of what is expected. That is
what the surface does, for layers are laid on surfaces, or what is found for neighbours first and
then for n twice as large each time, for a picture may be cut out of a deposit. Columns from two
thirds of a wavelength to a wavelength apart are tried, for over the width of a column of grains no
layer rises; the greatest likeness counts. The inclination is
-rise / dx: a slope, downhill positive, as all slopes here.
"""

from functools import cache
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from experiment.arrays import Floats

__all__ = ["along_layers", "rises", "settle"]


TRIED = 12  # distances


def settle(coarse: Floats) -> tuple[Floats, NDArray[np.intp]]:
    """The columns of `coarse` (z, x) let down to one floor, and from what height (x,) in cells.

    NaN above them; so a deposit on a slope takes no more room than it is thick.
    """
    inside = np.isfinite(coarse)
    floor = inside.argmax(axis=0)
    top = np.where(inside.any(axis=0), len(coarse) - inside[::-1].argmax(axis=0), floor)
    height = np.arange(max(1, int((top - floor).max())))[:, None] + floor
    settled = np.take_along_axis(coarse, np.minimum(height, len(coarse) - 1), axis=0)
    return np.where(height < top, settled, np.nan), floor


def _surface_slope(coarse: Floats, floor: NDArray[np.intp]) -> float:
    """By how many cells the top falls a column, by the median; NaN for less than two columns."""
    inside = np.isfinite(coarse)
    there = np.flatnonzero(inside.any(axis=0))
    if len(there) < 2:
        return np.nan
    there = there[:: max(1, len(there) // 200)]
    top = floor[there] + len(coarse) - inside[::-1, there].argmax(axis=0)
    return float(-scipy.stats.theilslopes(top, there).slope)


def rises(coarse: Floats, floor: NDArray[np.intp], lag: float, farthest: int, width: int) -> Floats:
    """By how many cells layers `lag` thick rise from each column to the next, (x - 1,).

    Of columns (z, x) that were let down from the height `floor` (x,). `width` pairs of columns are
    taken together, at most `farthest` columns apart.
    """
    columns = coarse.shape[1]
    surface = _surface_slope(coarse, floor)
    if not np.isfinite(surface):
        return np.zeros(columns - 1)
    farthest = max(1, min(farthest, columns // 4))
    spectrum = _spectrum(coarse)

    @cache
    def like(apart: int) -> Floats:
        product = np.conj(spectrum[:, :-apart]) * spectrum[:, apart:]
        correlated: Floats = scipy.fft.irfft(product, _size(coarse), axis=0)
        return correlated

    def follow(slope: float, apart: int, reach: float) -> tuple[Floats, Floats]:
        fallen = floor[:-apart] - floor[apart:]
        near = round(-slope * apart) + fallen
        shift, likeness = _shifts(like(apart), len(coarse), near, reach, width)
        return (shift - fallen) / apart, likeness

    stepwise, apart = surface, 1
    while apart < farthest:
        stepwise = -_weighted_median(*follow(stepwise, apart, lag / 2))
        apart = min(2 * apart, farthest)
    aparts = np.unique(np.linspace(max(1, 2 * farthest // 3), farthest, TRIED).astype(int)).tolist()
    expected = dict.fromkeys((surface, stepwise))
    found = [(*follow(slope, apart, lag / 4), apart) for apart in aparts for slope in expected]
    rise, _, apart = max(found, key=lambda one: float(one[1].mean()))
    middles = np.arange(columns - apart) + (apart - 1) / 2
    return np.interp(np.arange(columns - 1), middles, rise)


def _shifts(
    like: Floats, longest: int, expected: NDArray[np.intp], reach: float, width: int
) -> tuple[Floats, Floats]:
    """The lag (x,), within `reach` of the one `expected`, of the greatest likeness; and it.

    From `like` (lag, x), X of pairs of columns at most `longest`. Where there is nothing to liken,
    in zones of one kind of grain, the one expected.
    """
    steps = np.arange(-max(1, int(reach)), max(1, int(reach)) + 1)
    lags = expected + steps[:, None]
    near = np.take_along_axis(like, lags % len(like), axis=0)
    like = np.where(np.abs(lags) < longest, near, 0.0)
    like = scipy.ndimage.uniform_filter1d(like, width, axis=1, mode="nearest")
    most = like.max(axis=0)
    best = np.where(most > 0, like.argmax(axis=0), len(steps) // 2)
    inner = np.clip(best, 1, len(steps) - 2)
    left, middle, right = (like[inner + step, np.arange(like.shape[1])] for step in (-1, 0, 1))
    bend = left - 2 * middle + right
    peaked = (best == inner) & (bend < 0)
    finer = np.where(peaked, 0.5 * (left - right) / np.where(peaked, bend, 1.0), 0.0)
    return (expected + steps[best]).astype(np.float64) + finer, np.maximum(most, 0.0)


def _weighted_median(values: Floats, weights: Floats) -> float:
    """The plain one where no value has any weight."""
    if not weights.sum() > 0:
        return float(np.median(values))
    order = values.argsort()
    below = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(below, 0.5 * below[-1])])


def along_layers(coarse: Floats, floor: NDArray[np.intp], rise: Floats, width: int) -> Floats:
    """`coarse` (z, x) averaged over `width` columns, each shifted to follow the layers.

    As :func:`settle` gives it with its `floor` (x,); `rise` (x - 1,) is from :func:`rises`.
    """
    z, x = np.arange(len(coarse))[:, None], np.arange(coarse.shape[1])
    place = np.concatenate([[0.0], np.cumsum(rise)]) - floor
    inside = np.isfinite(coarse)
    filled = np.where(inside, coarse, 0.0)
    total, number = np.zeros(coarse.shape), np.zeros(coarse.shape)
    last = len(coarse) - 1, coarse.shape[1] - 1
    for beside in range(-(width // 2), width // 2 + 1):
        column = np.clip(x + beside, 0, last[1])
        row = z + np.round(place[column] - place).astype(np.intp)
        there = (row >= 0) & (row <= last[0]) & (column == x + beside)
        row = np.clip(row, 0, last[0])
        there &= inside[row, column]
        total += np.where(there, filled[row, column], 0.0)
        number += there
    known = inside & (number > 0)
    return np.where(known, total / np.where(known, number, 1.0), np.nan)


def _spectrum(coarse: Floats) -> NDArray[np.complexfloating[Any]]:
    """The transform of each column's c'."""
    inside = np.isfinite(coarse)
    mean = np.where(inside, coarse, 0.0).sum(axis=0) / np.maximum(inside.sum(axis=0), 1)
    varying = np.where(inside, coarse - mean, 0.0)
    return np.asarray(scipy.fft.rfft(varying, _size(coarse), axis=0))


def _size(coarse: Floats) -> int:
    """Of a transform in which columns do not meet their own ends."""
    return int(scipy.fft.next_fast_len(2 * len(coarse), real=True))
