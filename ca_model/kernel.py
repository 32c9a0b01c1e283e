"""The lattice rule of :mod:`ca_model.reference` on arrays, grain for grain the same.

Columns are taken in their order downhill: each then meets the height that its downhill neighbour
had before the step, so heights can be changed in place.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ca_model.lattice import Rule
from experiment.arrays import Ints

__all__ = ["Pile", "advance", "grains_at_rest"]


class Pile(NamedTuple):
    """The state of a lattice pile, changed in place by :func:`advance`."""

    height: Ints  # (column,) in u
    rolling: Ints  # (column, species) grains
    stack: NDArray[np.int8]  # (column, place) species of the grains at rest, lowest first
    grains: Ints  # (column,) how many places of the stack are taken
    base_species: int  # what the surface before pouring is made of


@njit(cache=True, nogil=True)
def advance(pile: Pile, rule: Rule, arrivals: Ints) -> int:
    """Advance `pile` by one step per row of `arrivals` (step, species).

    Returns the number of steps taken, fewer than asked for where stacks need more places first.
    """
    for step in range(arrivals.shape[0]):
        if _stacks_are_nearly_full(pile, arrivals[step]):
            return step
        _roll(pile.rolling, arrivals[step])
        for i in range(pile.height.size - 1):
            if rule.percolation:
                _touch_smallest(pile, rule, i)
            else:
                _touch_each(pile, rule, i)
        _capture_at_wall(pile, rule)
    return arrivals.shape[0]


@njit(cache=True)
def grains_at_rest(pile: Pile) -> Ints:
    """Number of grains of each species in the stacks (species,)."""
    counts = np.zeros(pile.rolling.shape[1], dtype=np.int64)
    for i in range(pile.grains.size):
        for k in range(pile.grains[i]):
            counts[pile.stack[i, k]] += 1
    return counts


@njit(cache=True)
def _roll(rolling: Ints, arriving: Ints) -> None:
    columns, species = rolling.shape
    for i in range(columns - 1, 0, -1):
        for a in range(species):
            rolling[i, a] = rolling[i - 1, a]
    for a in range(species):
        rolling[0, a] = arriving[a]


@njit(cache=True)
def _touch_smallest(pile: Pile, rule: Rule, i: int) -> None:
    touches = 0
    for a in rule.smallest_first:
        while pile.rolling[i, a] > 0:
            if touches == rule.contacts or not _is_captured(pile, rule, i, a):
                return
            _capture(pile, rule, i, a)
            touches += 1


@njit(cache=True)
def _touch_each(pile: Pile, rule: Rule, i: int) -> None:
    turns = pile.rolling[i] > 0
    touches = 0
    while touches < rule.contacts and turns.any():
        for a in rule.smallest_first:
            if turns[a]:
                turns[a] = _is_captured(pile, rule, i, a)
                if turns[a]:
                    _capture(pile, rule, i, a)
                    turns[a] = pile.rolling[i, a] > 0
        touches += 1


@njit(cache=True)
def _capture_at_wall(pile: Pile, rule: Rule) -> None:
    last = pile.height.size - 1
    for a in rule.smallest_first:
        while pile.rolling[last, a] > 0:
            _capture(pile, rule, last, a)


@njit(cache=True)
def _is_captured(pile: Pile, rule: Rule, i: int, a: int) -> bool:
    slope = pile.height[i] - pile.height[i + 1]
    return slope < rule.threshold[a, _surface_species(pile, i)]


@njit(cache=True)
def _surface_species(pile: Pile, i: int) -> int:
    """The species of the topmost grain of column i."""
    count = pile.grains[i]
    return pile.stack[i, count - 1] if count > 0 else pile.base_species


@njit(cache=True)
def _capture(pile: Pile, rule: Rule, i: int, a: int) -> None:
    pile.rolling[i, a] -= 1
    pile.stack[i, pile.grains[i]] = a
    pile.grains[i] += 1
    pile.height[i] += rule.grain_height[a]


@njit(cache=True)
def _stacks_are_nearly_full(pile: Pile, arriving: Ints) -> bool:
    """Whether some column could outgrow its stack within a step: all that reaches it, captured."""
    places = pile.stack.shape[1]
    for i in range(pile.height.size):
        reaching = arriving.sum() if i == 0 else pile.rolling[i - 1].sum()
        if pile.grains[i] + reaching > places:
            return True
    return False
