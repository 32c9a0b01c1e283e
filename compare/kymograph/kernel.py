"""Walks through the records of a kymograph (time, x) and along the lines (line, x) in it."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from experiment.arrays import Floats, Ints

__all__ = ["NONE", "average_beside", "numbers_of_chains", "switch"]

NONE = -1  # no crossing before
Bools = NDArray[np.bool_]


@njit(cache=True, nogil=True)
def switch(flow: Floats, on: float, off: float, to_start: float, to_stop: float) -> Bools:
    """Whether grains roll (time, x): switched when a sum of `flow` beyond its level is enough."""
    records, columns = flow.shape
    rolls = np.empty((records, columns), np.bool_)
    state, total = flow[0] > on, np.zeros(columns)
    for k in range(records):
        for i in range(columns):
            beyond = off - flow[k, i] if state[i] else flow[k, i] - on
            total[i] = max(total[i] + beyond, 0.0)
            if total[i] > (to_stop if state[i] else to_start):
                state[i], total[i] = not state[i], 0.0
            rolls[k, i] = state[i]
    return rolls


@njit(cache=True, nogil=True, error_model="numpy")
def average_beside(
    time: Floats, thickness: Floats, path: Floats, before: Floats, after: Floats, tau: Floats
) -> Floats:
    """Means (line, tau, species) over x of `thickness` (time, x, species), `tau` from each line.

    Lines are at `path` (line, x) [s], times `tau` (line, tau) from there, as far as half-way to
    what lies `before` and `after` (line, x) [s], which is NaN where a line is not; 0 of nothing.
    """
    lines, columns = path.shape
    sums, number = np.zeros((*tau.shape, thickness.shape[2])), np.zeros((*tau.shape, 1))
    for line in range(lines):
        for i in range(columns):
            k = 0
            for j in range(tau.shape[1]):
                at = path[line, i] + tau[line, j]
                near = -before[line, i] / 2 <= tau[line, j] <= after[line, i] / 2
                if not (near and time[0] <= at <= time[-1]):
                    continue
                while k < len(time) - 2 and time[k + 1] <= at:
                    k += 1
                share = (at - time[k]) / (time[k + 1] - time[k])
                for a in range(thickness.shape[2]):
                    now, then = thickness[k, i, a], thickness[k + 1, i, a]
                    sums[line, j, a] += (1 - share) * now + share * then
                number[line, j, 0] += 1.0
    return sums / np.maximum(number, 1.0)


@njit(cache=True, nogil=True)
def numbers_of_chains(before: Ints) -> Ints:
    """The number of the chain (link,) of each link, from the one `before` (link,) it, or NONE."""
    number, chains = np.empty_like(before), 0
    for k in range(before.size):
        if before[k] == NONE:
            number[k] = chains
            chains += 1
        else:
            number[k] = number[before[k]]
    return number
