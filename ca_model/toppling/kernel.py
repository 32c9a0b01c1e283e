"""The toppling rule of :mod:`ca_model.toppling.reference` on arrays, grain for grain the same.

    a topmost on b is at rest while    s = h_i - h_{i+1} < s_ab + k_i,    k_i in 0 ... spread

Columns that are not at rest are kept in a list, so a topple costs the same on any pile: 30 ns, as
long as no helper both branches and writes to the pile (120 ns, for counting references).
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ca_model.draws import RandomState, pick
from ca_model.lattice import TopplingRule
from experiment.arrays import Ints

__all__ = [
    "WALL",
    "TopplingPile",
    "advance_toppling",
    "bare_pile",
]

WALL = 2**62  # the lip of a cell that nothing can leave


class TopplingPile(NamedTuple):
    """The state of a pile between two grains, changed in place by :func:`advance_toppling`."""

    base: Ints  # (column,) heights before pouring, in u
    height: Ints  # (column,) in u
    stack: NDArray[np.int8]  # (column, place) species of the grains at rest, lowest first
    grains: Ints  # (column,) how many places of the stack are taken
    k: Ints  # (column,) what its last draw added to the threshold
    outflow: Ints  # (species,) grains that toppled over the lip
    base_species: int  # what the surface before pouring is made of
    lip: int  # height in u beyond the last column, or WALL


class Restless(NamedTuple):
    """The columns that are not at rest; how many there are is known to who goes through them."""

    column: Ints  # (column,) the first places hold them, in no order that means anything
    place: Ints  # (column,) where a column stands in this list, -1 where it does not


def bare_pile(
    rule: TopplingRule,
    base: Ints,
    random: RandomState,
    *,
    base_species: int = 0,
    lip: int = WALL,
    places: int = 64,
) -> TopplingPile:
    """The surface `base` (column,) before pouring: no grain on it, every k drawn from `random`."""
    columns = len(base)
    return TopplingPile(
        base=base.astype(np.int64),
        height=base.astype(np.int64),
        stack=np.zeros((columns, places), dtype=np.int8),
        grains=np.zeros(columns, dtype=np.int64),
        k=np.array([pick(random, rule.spread + 1) for _ in range(columns)], dtype=np.int64),
        outflow=np.zeros(len(rule.grain_height), dtype=np.int64),
        base_species=base_species,
        lip=lip,
    )


@njit(cache=True, nogil=True)
def advance_toppling(
    pile: TopplingPile, rule: TopplingRule, arrivals: Ints, random: RandomState
) -> int:
    """Add the grains of `arrivals` (step, species) to column 0, one by one, in random order.

    The pile comes to rest after each, and the grain's row of `arrivals` counts down. Returns the
    number of steps done, fewer than asked for where stacks need more places first; a step begun
    goes on when the rows that are not done are given again.
    """
    columns = pile.height.size
    restless = Restless(np.empty(columns, np.int64), np.full(columns, -1, np.int64))
    room = 0
    for step in range(len(arrivals)):
        due = arrivals[step]
        for _ in range(due.sum()):
            if room == 0:
                room = _room(pile, rule)
                if room == 0:
                    return step
            room -= 1
            _push(pile, rule, 0, _take_one(due, random))
            _come_to_rest(pile, rule, restless, random)
    return len(arrivals)


@njit(cache=True)
def _take_one(due: Ints, random: RandomState) -> int:
    """The species of one of the grains `due` (species,), which is due no more."""
    left = pick(random, due.sum())
    a = 0
    while left >= due[a]:
        left -= due[a]
        a += 1
    due[a] -= 1
    return a


@njit(cache=True)
def _come_to_rest(
    pile: TopplingPile, rule: TopplingRule, restless: Restless, random: RandomState
) -> None:
    """Topple restless columns, one drawn at a time, until none is left; column 0 has changed."""
    columns, k, outflow = pile.height.size, pile.k, pile.outflow
    count = 0
    first, end = 0, 1
    while True:
        for i in range(first, end):
            count = _list(restless, count, i, _is_at_rest(pile, rule, i))
        if count == 0:
            return
        i = restless.column[pick(random, count)]
        a = _pop(pile, rule, i)
        k[i] = pick(random, rule.spread + 1)
        if i + 1 < columns:
            _push(pile, rule, i + 1, a)
            k[i + 1] = pick(random, rule.spread + 1)
        else:
            outflow[a] += 1
        first, end = max(i - 1, 0), min(i + 2, columns)


@njit(cache=True)
def _list(restless: Restless, count: int, i: int, at_rest: bool) -> int:
    """Put column i on the list of `count` or take it off, as it now is; the new count."""
    place = restless.place[i]
    if at_rest and place >= 0:
        moved = restless.column[count - 1]
        restless.column[place] = moved
        restless.place[moved] = place
        restless.place[i] = -1
        return count - 1
    if place < 0 and not at_rest:
        restless.column[count] = i
        restless.place[i] = count
        return count + 1
    return count


@njit(cache=True)
def _is_at_rest(pile: TopplingPile, rule: TopplingRule, i: int) -> bool:
    top = pile.grains[i] - 1
    if top < 0:
        return True
    below = pile.stack[i, top - 1] if top > 0 else pile.base_species
    downhill = pile.height[i + 1] if i + 1 < pile.height.size else pile.lip
    return bool(pile.height[i] - downhill < rule.threshold[pile.stack[i, top], below] + pile.k[i])


@njit(cache=True)
def _push(pile: TopplingPile, rule: TopplingRule, i: int, a: int) -> None:
    pile.stack[i, pile.grains[i]] = a
    pile.grains[i] += 1
    pile.height[i] += rule.grain_height[a]


@njit(cache=True)
def _pop(pile: TopplingPile, rule: TopplingRule, i: int) -> int:
    pile.grains[i] -= 1
    a = int(pile.stack[i, pile.grains[i]])
    pile.height[i] -= rule.grain_height[a]
    return a


@njit(cache=True)
def _room(pile: TopplingPile, rule: TopplingRule) -> int:
    """How many grains can be added before some stack could overflow.

    No topple lifts column j above max_{i <= j} h_i + (j - i)(max H - min s), and a grain that is
    added lifts this by max H at most.
    """
    tallest, lowest = int(rule.grain_height.max()), int(rule.grain_height.min())
    rise = tallest - int(rule.threshold.min())
    full = int(pile.stack.shape[1]) * lowest
    highest = int(pile.height[0])
    room = (full + int(pile.base[0]) - highest) // tallest
    for j in range(1, pile.height.size):
        highest = max(highest + rise, int(pile.height[j]))
        room = min(room, (full + int(pile.base[j]) - highest) // tallest)
    return max(room, 0)
