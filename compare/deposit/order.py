"""How much of what varies in a deposit lies in layers, in place.

layering     strength of what repeats in a column and its neighbours
coherence    how much of the variance an average along the layers keeps, from 0 to 1: of n
             columns of grains that know nothing of each other 1 / n is kept, which counts as 0
regularity   how much of the variance of such an average repeats
"""

import numpy as np

from compare.deposit.spectrum import Correlation, Repeat, Repeats, correlate
from experiment.arrays import Floats

__all__ = ["FEWEST", "coherence", "column_mean", "regularity", "repeats", "together"]

TOGETHER = 20  # this part of the columns is looked at together, where one alone is noise
FEWEST, MOST = 5, 41  # columns of it
LEAST_VARIANCE = 1e-6  # of coarseness, below which nothing varies


def together(columns: int) -> int:
    """How many of the columns are looked at together, an odd number."""
    return min(max(FEWEST, columns // TOGETHER), MOST) | 1


def repeats(near: Correlation, repeat: Repeat) -> Repeats:
    """The repeat nearest to that of all columns in each one, `near` with its neighbours."""
    if not np.isfinite(repeat.lag):
        columns = near.sums.shape[1]
        return Repeats(np.full(columns, np.nan), np.zeros(columns))
    return near.repeats_near(repeat.lag)


def coherence(coarse: Floats, profiles: Floats) -> Floats:
    """Coherence (x,) of `coarse` (z, x), from its averages `profiles` along the layers."""
    chance = 1 / together(coarse.shape[1])
    kept = _share(_variance(profiles), _variance(coarse))
    clipped: Floats = np.clip((kept - chance) / (1 - chance), 0.0, 1.0)
    return clipped


def regularity(profiles: Floats, repeat: Repeat) -> Floats:
    """Regularity (x,) of `profiles` (z, x) along the layers."""
    near = correlate(profiles).neighbourly(together(profiles.shape[1]))
    variance = near.sums[0] / np.maximum(near.terms[0], 1.0)
    return _share((repeats(near, repeat).strength / 2) ** 2, variance)


def column_mean(values: Floats) -> Floats:
    """Of each column what is not NaN; NaN of an empty one."""
    inside = np.isfinite(values)
    number = inside.sum(axis=0)
    total = np.where(inside, values, 0.0).sum(axis=0)
    return np.where(number > 0, total / np.maximum(number, 1), np.nan)


def _variance(values: Floats) -> Floats:
    """That of each column; 0 of an empty one."""
    return np.nan_to_num(column_mean(np.square(values - np.nan_to_num(column_mean(values)))))


def _share(part: Floats, whole: Floats) -> Floats:
    """`part` over the variance `whole`, 0 where nothing varies."""
    varies = whole > LEAST_VARIANCE
    return np.where(varies, part / np.where(varies, whole, 1.0), 0.0)
