"""The lattice rule of :mod:`ca_model.reference` on arrays, step by step, column by column.

Columns are taken in their order along the flow: each then meets the height that its downhill
neighbour had before, so heights can be changed in place. Every column costs in every step; where
the source is at rest :mod:`ca_model.kernel.packets` is faster. Species are numbered by rank, the
smallest is 0.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ca_model.kernel.bits import EMPTY, ONE, Word, bit_of
from ca_model.kernel.compiled import UNCOUNTED, inlined
from ca_model.kernel.log import Log, entry_of
from ca_model.kernel.slope import RankedRule
from experiment.arrays import Ints

__all__ = ["Heap", "take_steps"]

RIGHT, LEFT = 0, 1


class Heap(NamedTuple):
    """A pile between two ends, changed in place."""

    wall: bool  # whether walls stand at the ends; else grains fall over lips
    height: Ints  # (1 + column + 1,) in u, with the lips
    top: NDArray[np.int8]  # (column,) rank of the topmost grain
    rolling: Ints  # (side, 1 + column + 1, rank) grains, with those that leave
    outflow: Ints  # (rank,) grains that fell over the lips


@njit(cache=True, nogil=True, **UNCOUNTED)
def take_steps(pile: Heap, rule: RankedRule, log: Log, arrivals: Ints, source: Ints) -> None:
    """Advance `pile` by one step per row of `arrivals` (step, side, rank).

    The grains of step k enter to the right and left of the edge before column source[k]. The log
    must have room for all grains that roll or arrive.
    """
    for step in range(arrivals.shape[0]):
        _roll(pile, rule)
        _feed(pile, rule, arrivals, step, source[step])
        for i in range(pile.top.size):
            _touch(pile, rule, log, RIGHT, i)
        for i in range(pile.top.size - 1, -1, -1):
            _touch(pile, rule, log, LEFT, i)


@inlined
def _roll(pile: Heap, rule: RankedRule) -> None:
    columns = pile.top.size
    for a in range(len(rule.ranks)):
        for i in range(columns + 1, 0, -1):
            pile.rolling[RIGHT, i, a] = pile.rolling[RIGHT, i - 1, a]
        for i in range(columns + 1):
            pile.rolling[LEFT, i, a] = pile.rolling[LEFT, i + 1, a]
        pile.outflow[a] += pile.rolling[RIGHT, columns + 1, a] + pile.rolling[LEFT, 0, a]
        pile.rolling[RIGHT, columns + 1, a] = pile.rolling[LEFT, 0, a] = 0


@inlined
def _feed(pile: Heap, rule: RankedRule, arrivals: Ints, step: int, source: int) -> None:
    """Grains enter beside the source; at an end those that would leave at once turn round."""
    columns = pile.top.size
    for a in range(len(rule.ranks)):
        if source < columns:
            pile.rolling[RIGHT, 1 + source, a] += arrivals[step, RIGHT, a]
        else:
            pile.rolling[LEFT, columns, a] += arrivals[step, RIGHT, a]
        if source > 0:
            pile.rolling[LEFT, source, a] += arrivals[step, LEFT, a]
        else:
            pile.rolling[RIGHT, 1, a] += arrivals[step, LEFT, a]


@inlined
def _touch(pile: Heap, rule: RankedRule, log: Log, side: int, i: int) -> None:
    last = pile.top.size - 1 if side == RIGHT else 0
    if pile.wall and i == last:
        for a in range(len(rule.ranks)):
            while pile.rolling[side, 1 + i, a] > 0:
                _capture(pile, rule, log, side, i, a)
    elif rule.percolation:
        _touch_smallest(pile, rule, log, side, i)
    else:
        _touch_each(pile, rule, log, side, i)


@inlined
def _touch_smallest(pile: Heap, rule: RankedRule, log: Log, side: int, i: int) -> None:
    touches = 0
    for a in range(len(rule.ranks)):
        while pile.rolling[side, 1 + i, a] > 0:
            if touches == rule.contacts or not _is_captured(pile, rule, side, i, a):
                return
            _capture(pile, rule, log, side, i, a)
            touches += 1


@inlined
def _touch_each(pile: Heap, rule: RankedRule, log: Log, side: int, i: int) -> None:
    turns, touches = EMPTY, 0
    for a in range(len(rule.ranks)):
        turns |= Word(pile.rolling[side, 1 + i, a] > 0) << Word(a)
    while touches < rule.contacts and turns != EMPTY:
        for a in range(len(rule.ranks)):
            if turns & bit_of(Word(a)) != EMPTY:
                captured = _is_captured(pile, rule, side, i, a)
                if captured:
                    _capture(pile, rule, log, side, i, a)
                if not captured or pile.rolling[side, 1 + i, a] == 0:
                    turns &= ~bit_of(Word(a))
        touches += 1


@inlined
def _is_captured(pile: Heap, rule: RankedRule, side: int, i: int, a: int) -> bool:
    slope = pile.height[1 + i] - pile.height[2 + i if side == RIGHT else i]
    return bool(slope < rule.threshold[pile.top[i] * len(rule.ranks) + a])


@inlined
def _capture(pile: Heap, rule: RankedRule, log: Log, side: int, i: int, a: int) -> None:
    pile.rolling[side, 1 + i, a] -= 1
    log.grains[log.length[0]] = entry_of(Word(i), Word(a))
    log.length[0] += ONE
    pile.top[i] = a
    pile.height[1 + i] += rule.grain_height[a]
