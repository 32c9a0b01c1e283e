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

from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray

from compare.deposit.kernel import average_along
from compare.deposit.profiles import Settled
from compare.deposit.spectrum import Transform
from experiment.arrays import Floats

__all__ = ["along_layers", "rises"]

TRIED = 12  # distances


def _surface_slope(deposit: Settled) -> float:
    """By how many cells the top falls a column, by the median; NaN for less than two columns."""
    there = np.flatnonzero(deposit.height)
    if len(there) < 2:
        return np.nan
    there = there[:: max(1, len(there) // 200)]
    top = deposit.floor[there] + deposit.height[there]
    left, right = np.triu_indices(len(there), 1)
    return -float(np.median((top[right] - top[left]) / (there[right] - there[left])))


def rises(
    deposit: Settled, transformed: Transform, lag: float, farthest: int, width: int
) -> Floats:
    """By how many cells layers `lag` thick rise from each column to the next, (x - 1,).

    `width` pairs of columns of the `deposit`, which is also given `transformed`, are taken
    together, at most `farthest` columns apart.
    """
    rows, columns = deposit.coarse.shape
    surface = _surface_slope(deposit)
    if not np.isfinite(surface):
        return np.zeros(columns - 1)
    farthest = max(1, min(farthest, columns // 4))
    like = lru_cache(1)(transformed.between)

    def follow(risen: int, apart: int, reach: float) -> tuple[Floats, Floats]:
        """The rise a column, and the likeness there, where `risen` cells in all are expected."""
        fallen = deposit.floor[:-apart] - deposit.floor[apart:]
        shift, likeness = _shifts(like(apart), rows, risen + fallen, reach, width)
        return (shift - fallen) / apart, likeness

    stepwise, apart = surface, 1
    while apart < farthest:
        stepwise = -_weighted_median(*follow(round(-stepwise * apart), apart, lag / 2))
        apart = min(2 * apart, farthest)
    aparts = np.unique(np.linspace(max(1, 2 * farthest // 3), farthest, TRIED).astype(int)).tolist()
    found = [
        (*follow(risen, apart, lag / 4), apart)
        for apart in aparts
        for risen in dict.fromkeys(round(-slope * apart) for slope in (surface, stepwise))
    ]
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


def along_layers(deposit: Settled, rise: Floats, width: int) -> Floats:
    """The coarseness (z, x) averaged over `width` columns, each shifted to follow the layers.

    These rise as :func:`rises` tells, (x - 1,).
    """
    place: Floats = np.concatenate([[0.0], np.cumsum(rise)]) - deposit.floor
    return average_along(deposit.coarse, place, width)
