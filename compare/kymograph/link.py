"""Lines: crossings of neighbouring columns that belong together.

A crossing and one of the next column are linked if each is the other's nearest in time, once the
usual lag from column to column is taken off, and no farther apart than the usual scatter of that
lag, or a short halt, allows. Ends of lines are then linked over columns in which the crossing is
missing.
"""

import numpy as np

from compare.kymograph.flow import Crossings
from compare.kymograph.kernel import NONE, numbers_of_chains
from experiment.arrays import Floats, Ints

__all__ = ["link"]

FARTHEST = 1 / 3  # of the time between successive lines
HALT = 1 / 12  # of it, for which a line may stay where it is
MISSING = 3  # columns over which a line is taken to go on


def link(found: Crossings, sampling: float) -> Ints:
    """Number of the line (crossing,) that each crossing belongs to, with records `sampling` [s].

    In each column a line has one crossing at most.
    """
    n = len(found.time)
    if n < 2:
        return np.arange(n)
    order = np.lexsort((found.time, found.column))
    column, time = found.column[order], found.time[order]
    spacing = np.diff(time)[np.diff(column) == 0]
    period = float(np.median(spacing)) if len(spacing) else np.inf
    farthest, halt = FARTHEST * period, HALT * period if len(spacing) else 0.0
    near, far = _mutual(column, time, 1, 0.0)
    lags = time[far] - time[near]
    lags = lags[np.abs(lags) < farthest]
    lag = float(np.median(lags)) if len(lags) else 0.0
    scatter = 1.4826 * float(np.median(np.abs(lags - lag))) if len(lags) else 0.0
    reach = min(farthest, max(halt, 1.5 * sampling + 3 * abs(lag) + 6 * scatter))
    starts, ends = np.ones(n, dtype=bool), np.ones(n, dtype=bool)
    before = np.full(n, NONE)
    for gap in range(1, MISSING + 2):
        left, right = np.flatnonzero(ends), np.flatnonzero(starts)
        a, b = _mutual_between(column, time, left, right, gap, lag)
        close = np.abs(time[b] - time[a] - gap * lag) < reach
        a, b = a[close], b[close]
        ends[a], starts[b] = False, False
        before[b] = a
    lines = np.empty(n, dtype=np.int64)
    lines[order] = numbers_of_chains(before)
    return lines


def _mutual(column: Ints, time: Floats, gap: int, lag: float) -> tuple[Ints, Ints]:
    every = np.arange(len(time))
    return _mutual_between(column, time, every, every, gap, lag)


def _mutual_between(
    column: Ints, time: Floats, left: Ints, right: Ints, gap: int, lag: float
) -> tuple[Ints, Ints]:
    """Pairs of `left` and of `right`, `gap` columns on, that are each other's nearest in time."""
    if not len(left) or not len(right):
        return left[:0], right[:0]
    span = 4.0 * (float(np.ptp(time)) + abs(gap * lag) + 1.0)
    early = float(time.min())
    here = column[left] * span + (time[left] - early)
    there = column[right] * span + (time[right] - early)
    forth = _nearest(here + gap * (span + lag), there)
    back = _nearest(there - gap * (span + lag), here)
    same = (back[forth] == np.arange(len(left))) & (column[right[forth]] == column[left] + gap)
    return left[same], right[forth[same]]


def _nearest(wanted: Floats, sorted_values: Floats) -> Ints:
    """Index of the nearest of `sorted_values` to each one `wanted`."""
    above = np.clip(np.searchsorted(sorted_values, wanted), 1, max(1, len(sorted_values) - 1))
    above = np.minimum(above, len(sorted_values) - 1)
    below = np.maximum(above - 1, 0)
    nearer = wanted - sorted_values[below] <= sorted_values[above] - wanted
    return np.where(nearer, below, above)
