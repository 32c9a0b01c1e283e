"""Where and when the flow sets in and stops: crossings of the rolling thickness in each column.

R / R0 of a column is noise about one value in the flow and about 0 at rest. Sums that start anew
whenever they fall to zero (E. S. Page, Biometrika 41, 100 (1954)),

    S_on  = max(0, S_on  + R / R0 - ON)        a front has come where S_on  > h_on
    S_off = max(0, S_off + OFF - R / R0)       a kink has come where S_off > h_off

tell one from the other with as few records as the noise sigma allows: noise about a mean that
lies m beyond the level passes h by chance with odds exp(-2 m h / sigma^2), so h = ln(1/p)
sigma^2 / (2 m). What is over before grains roll on by some per cent of the slope sets off none,
though, for single grains and gaps are no flow and no rest. The crossing itself is where the sum
of R / R0 - ON is least (front) or greatest (kink) between two such alarms, and between its
records where R / R0 = ON. So nothing is averaged over time, and where records are farther apart
flow or rest of a single one is seen.
"""

import math
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from compare.kymograph.kernel import switch
from experiment.arrays import Floats, Ints

__all__ = ["Crossings", "alarms", "crossings", "noise_of", "quieten"]

ON, OFF = 0.3, 0.15  # of R0
FALSE_ALARM = 1e-5  # p
LEAST_ALARM = 0.1  # R0 times a record: h where there is no noise
BRIEF = 0.008  # R0 L / v: h where records are dense, so that a missing grain is no rest
WIDEST = 0.15  # of the slope, over which R may be averaged
NARROW = 0.25  # of a stretch along x


class Crossings(NamedTuple):
    """Times at which the flow of a column sets in or stops, by column and time."""

    column: Ints
    time: Floats  # s
    before: Floats  # s since the crossing before, of the other kind
    after: Floats  # s until the next one


def quieten(flow: Floats, rolled: float) -> tuple[Floats, int, float]:
    """`flow` (time, x) averaged along x, over how many columns, and the noise that is left.

    Over no more columns than it takes for noise not to hide flow or rest of a single record, or
    over as many as grains roll between records, `rolled`, which smooths the steps that sharp lines
    make there; but at most over WIDEST, or NARROW of a usual stretch of flow or rest.
    """
    widest = max(1.0, WIDEST * flow.shape[1])
    rolling = _averaged(flow, widest) > ON
    columns, smooth, noise = 1.0, flow, noise_of(flow, rolling)
    while _alarm(noise, ON) > ON and columns < widest:
        columns = min(2.0 * columns + 1.0, widest)
        smooth = _averaged(flow, columns)
        noise = noise_of(smooth, rolling)
    switches = np.count_nonzero(np.diff(alarms(smooth, noise, rolled), axis=1))
    stretch = flow.size / max(1, int(switches))
    wanted = min(rolled, widest, NARROW * stretch)
    if wanted > columns:
        columns, smooth = wanted, _averaged(flow, wanted)
        noise = noise_of(smooth, rolling)
    return smooth, _odd(columns), noise


def noise_of(flow: Floats, rolling: NDArray[np.bool_]) -> float:
    """Standard deviation of `flow` (time, x), from successive records that are both `rolling`."""
    steps = np.abs(np.diff(flow, axis=0)[rolling[1:] & rolling[:-1]])
    return float(1.4826 * np.median(steps) / np.sqrt(2.0)) if len(steps) else 0.0


def alarms(flow: Floats, noise: float, rolled: float = np.inf) -> NDArray[np.bool_]:
    """Whether grains roll (time, x) in `flow` [R0]: switched when a sum passes its alarm.

    Grains roll over `rolled` columns from record to record.
    """
    least = BRIEF * flow.shape[1] / rolled
    to_start, to_stop = (max(least, _alarm(noise, margin)) for margin in (ON, 1.0 - OFF))
    return switch(flow, ON, OFF, to_start, to_stop)


def crossings(
    time: Floats, flow: Floats, rolling: NDArray[np.bool_]
) -> tuple[Crossings, Crossings]:
    """Where `flow` (time, x) [R0], told by alarms `rolling`, stops (kinks) and sets in (fronts)."""
    rolls = rolling.T
    records = len(time)
    excess = np.cumsum(flow.T - ON, axis=1)
    towards = np.where(rolls, excess, -excess).ravel()
    switched = np.zeros_like(rolls)
    switched[:, 1:] = rolls[:, 1:] != rolls[:, :-1]
    alarm = np.flatnonzero(switched)
    column = alarm // records
    if not len(alarm):
        none = Crossings(column, *(np.zeros(0),) * 3)
        return none, none
    first = np.append(True, column[1:] != column[:-1])
    since = np.where(first, column * records, np.roll(alarm, 1))
    extreme = np.maximum.reduceat(towards, np.stack([since, alarm], axis=1).ravel())[::2]
    coming = np.minimum(np.cumsum(switched), len(alarm) - 1)
    sample = np.arange(towards.size)
    counts = (sample >= since[coming]) & (sample < alarm[coming])
    reached = np.flatnonzero(counts & (towards == extreme[coming]))
    last = np.zeros(len(alarm), dtype=np.int64)
    last[coming[reached]] = reached
    when = _between(time, flow.T.ravel(), last)
    gap = np.where(column[1:] == column[:-1], np.diff(when), np.inf)
    before, after = np.append(np.inf, gap), np.append(gap, np.inf)
    stops = ~rolls.ravel()[alarm]

    def of(kind: NDArray[np.bool_]) -> Crossings:
        return Crossings(column[kind], when[kind], before[kind], after[kind])

    return of(stops), of(~stops)


def _averaged(flow: Floats, columns: float) -> Floats:
    smooth: Floats = scipy.ndimage.uniform_filter1d(flow, _odd(columns), axis=1, mode="nearest")
    return smooth


def _odd(columns: float) -> int:
    """The odd number next to so many columns, the upper one of two as near."""
    return 2 * int((columns + 0.5) / 2) + 1


def _alarm(noise: float, margin: float) -> float:
    """Alarm h [R0 times a record], which noise about a `margin` from the level passes with p."""
    return max(LEAST_ALARM, math.log(1.0 / FALSE_ALARM) * noise**2 / (2.0 * margin))


def _between(time: Floats, flow: Floats, last: Ints) -> Floats:
    """When `flow` (column and time) crosses ON between record `last` and the next."""
    left, right = flow[last], flow[last + 1]
    change = np.where(right == left, 1.0, right - left)
    share = np.clip((ON - left) / change, 0.0, 1.0)
    k = last % len(time)
    crossed: Floats = time[k] + share * (time[k + 1] - time[k])
    return crossed
