"""How the layers are inclined, and profiles averaged along them.

A layer that lies at z in one column lies at z + shift in the next one. The shift of each column is
the lag at which it and its neighbour, together with the columns beside them, are most alike,

    X(lag) = sum_z c'(x, z) c'(x + dx, z + lag),

sought within half a wavelength of what the surface does, for layers are laid on surfaces. The
inclination is -shift / dx: a slope, downhill positive, as all slopes here.
"""

import numpy as np
import scipy
from numpy.typing import NDArray

from experiment.arrays import Floats

__all__ = ["along_layers", "settle", "shifts", "surface_slope"]


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


def surface_slope(coarse: Floats, floor: NDArray[np.intp]) -> float:
    """By how many cells the top falls a column, by the median; NaN for less than two columns."""
    inside = np.isfinite(coarse)
    there = np.flatnonzero(inside.any(axis=0))
    if len(there) < 2:
        return np.nan
    there = there[:: max(1, len(there) // 200)]
    top = floor[there] + len(coarse) - inside[::-1, there].argmax(axis=0)
    return float(-scipy.stats.theilslopes(top, there).slope)


def shifts(coarse: Floats, expected: NDArray[np.intp], reach: float, width: int) -> Floats:
    """By how many cells the layers rise from each column to the next, (x - 1,).

    They are within `reach` of what is `expected` (x - 1,); `width` pairs of columns are taken
    together.
    """
    steps = np.arange(-max(1, int(reach)), max(1, int(reach)) + 1)
    like = _likeness(coarse, expected + steps[:, None])
    like = scipy.ndimage.uniform_filter1d(like, width, axis=1, mode="nearest")
    best = like.argmax(axis=0)
    inner = np.clip(best, 1, len(steps) - 2)
    left, middle, right = (like[inner + step, np.arange(like.shape[1])] for step in (-1, 0, 1))
    bend = left - 2 * middle + right
    peaked = (best == inner) & (bend < 0)
    finer = np.where(peaked, 0.5 * (left - right) / np.where(peaked, bend, 1.0), 0.0)
    rise: Floats = expected + steps[best] + finer
    return rise


def along_layers(coarse: Floats, rise: Floats, width: int) -> Floats:
    """`coarse` (z, x) averaged over `width` columns, each shifted to follow the layers."""
    z, x = np.arange(len(coarse))[:, None], np.arange(coarse.shape[1])
    place = np.concatenate([[0.0], np.cumsum(rise)])
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


def _likeness(coarse: Floats, lags: NDArray[np.intp]) -> Floats:
    """X of each column with the next one at its `lags`, (lag, x - 1)."""
    inside = np.isfinite(coarse)
    mean = np.where(inside, coarse, 0.0).sum(axis=0) / np.maximum(inside.sum(axis=0), 1)
    varying = np.where(inside, coarse - mean, 0.0)
    size = scipy.fft.next_fast_len(2 * len(coarse), real=True)
    spectrum = scipy.fft.rfft(varying, size, axis=0)
    like: Floats = scipy.fft.irfft(np.conj(spectrum[:, :-1]) * spectrum[:, 1:], size, axis=0)
    overlapping = np.abs(lags) < len(coarse)
    return np.where(overlapping, np.take_along_axis(like, lags % size, axis=0), 0.0)
