"""The rate rule of :mod:`ca_model.rates.reference` on arrays, grain for grain the same.

A step is taken in sub-steps. All columns meet the heights with which a sub-step begins, so what
does not hang on random words is found for all of them at once (:mod:`ca_model.rates.chances`).
Then, column after column along the flow, a word is drawn for each rank that may be captured or set
rolling; most tell that no grain is, and only the others cost more than a comparison.
"""

import math

from numba import njit

from ca_model.draws import binomial_from, pick, tried
from ca_model.kernel.bits import Whole, Word
from ca_model.kernel.compiled import UNCOUNTED, inlined
from ca_model.rates.chances import ONE, find_chances, surface, touching
from ca_model.rates.state import LEFT, RIGHT, Draws, Exchange, FlowingPile
from experiment.arrays import Floats, Ints
from experiment.species import put

__all__ = ["BARE", "COURANT", "DONE", "FULL", "advance", "composition"]

COURANT = 0.25
DONE, FULL, BARE = range(3)


@njit(cache=True, nogil=True, **UNCOUNTED)
def advance(
    pile: FlowingPile, rule: Exchange, draws: Draws, arrivals: Ints, source: Ints
) -> tuple[int, int]:
    """Advance `pile` by one step per row of `arrivals` (step, side, rank).

    The grains of step k enter to the right and left of the edge before column source[k]. Returns
    the number of steps done, and why no more were: before one that the stacks may not last for,
    being nearly FULL, or BARE of grains in memory, it stops.
    """
    for step in range(arrivals.shape[0]):
        why = _why_stop(pile, rule, arrivals, step)
        if why != DONE:
            return step, why
        _roll(pile)
        _feed(pile, arrivals, step, source[step])
        substeps = _substeps(rule, _busiest(pile, rule))
        dt = rule.step / substeps
        for k in range(substeps):
            for side in range(pile.rolling.shape[0]):
                reach = _reach(pile, side)
                find_chances(pile, rule, draws, side, source[step], reach, dt)
                _exchange(pile, rule, draws, side, reach)
                if pile.wall:
                    _fill_against_the_wall(pile, rule, side, substeps - k)
    return arrivals.shape[0], DONE


@inlined
def _why_stop(pile: FlowingPile, rule: Exchange, arrivals: Ints, step: int) -> int:
    """DONE where the stacks last for the next step, whatever happens in it.

    What is in a column, rolling or at rest, stays there; a sub-step digs up a layer for each
    side at the most.
    """
    rolling, busiest = 0, _busiest(pile, rule)
    for side in range(pile.rolling.shape[0]):
        most = 0
        for i in range(pile.rolling.shape[2]):
            count = 0
            for a in range(len(rule.grain_height)):
                count += pile.rolling[side, a, i]
            most = max(most, count)
        rolling += most
        for a in range(len(rule.grain_height)):
            rolling += arrivals[step, side, a]
            fed = arrivals[step, side, a] * rule.grain_height[a] * rule.unit
            busiest += rule.fastest[a] * fed
    layer = rule.depth * pile.rolling.shape[0]
    deepest = _substeps(rule, busiest) * layer
    for i in range(pile.grains.size):
        if pile.grains[i] + layer + rolling > pile.stack.shape[1]:
            return FULL
        if pile.handed_on[i] > 0 and pile.grains[i] <= deepest:
            return BARE
    return DONE


@inlined
def _busiest(pile: FlowingPile, rule: Exchange) -> float:
    """The largest gamma R [cm/s] of grains in contact, each species at its largest rate."""
    busiest = 0.0
    for side in range(pile.rolling.shape[0]):
        for i in range(Word(pile.grains.size)):
            touch, busy = touching(pile, rule, side, i), 0.0
            for a in range(len(rule.grain_height)):
                busy += rule.fastest[a] * (touch[a] * rule.grain_height[a] * rule.unit)
            busiest = max(busiest, busy)
    return busiest


@inlined
def _substeps(rule: Exchange, busiest: float) -> int:
    """Sub-steps of a step in which a disturbance of the slope climbs a quarter of a column."""
    climb = busiest * (1.0 + 2.0 * rule.law.curvature_length / rule.width)
    return max(1, math.ceil(climb * rule.step / (COURANT * rule.width)))


@inlined
def _roll(pile: FlowingPile) -> None:
    sides, ranks, ends = pile.rolling.shape
    for a in range(ranks):
        for i in range(ends - 1, 0, -1):
            pile.rolling[RIGHT, a, i] = pile.rolling[RIGHT, a, i - 1]
        pile.outflow[a] += pile.rolling[RIGHT, a, ends - 1]
        pile.rolling[RIGHT, a, ends - 1] = 0
        if sides > 1:
            for i in range(ends - 1):
                pile.rolling[LEFT, a, i] = pile.rolling[LEFT, a, i + 1]
            pile.outflow[a] += pile.rolling[LEFT, a, 0]
            pile.rolling[LEFT, a, 0] = 0


@inlined
def _feed(pile: FlowingPile, arrivals: Ints, step: int, source: int) -> None:
    """Grains enter beside the source; at an end those that would leave at once turn round."""
    columns = pile.grains.size
    for side in range(arrivals.shape[1]):
        turned = source == columns if side == RIGHT else source == 0
        into = side if not turned else RIGHT + LEFT - side
        column = source if into == RIGHT else source - 1
        for a in range(arrivals.shape[2]):
            pile.rolling[into, a, 1 + column] += arrivals[step, side, a]


@inlined
def _reach(pile: FlowingPile, side: int) -> tuple[Whole, Whole]:
    """The columns of one side's flow, from one to before the other; that at a wall is not of it."""
    begin, end = Word(0), Word(pile.grains.size)
    if pile.wall and side == RIGHT:
        end -= ONE
    elif pile.wall:
        begin += ONE
    while begin < end and not _flows(pile, side, begin):
        begin += ONE
    while begin < end and not _flows(pile, side, end - ONE):
        end -= ONE
    return begin, end


@inlined
def _flows(pile: FlowingPile, side: int, i: Whole) -> bool:
    rolling = 0
    for a in range(pile.rolling.shape[1]):
        rolling |= pile.rolling[side, a, i + ONE]
    return rolling > 0


@inlined
def _exchange(
    pile: FlowingPile, rule: Exchange, draws: Draws, side: int, reach: tuple[Whole, Whole]
) -> None:
    """Capture from the flow of one side, and set rolling what it strikes, along the flow."""
    (begin, end), state = reach, pile.random[0]
    for k in range(end - begin):
        i = begin + k if side == RIGHT else end - ONE - k
        after, some = tried(state, draws.none, 2 * len(rule.grain_height), i)
        if some:
            pile.random[0] = state
            _move_grains(pile, rule, draws, side, i)
            after = pile.random[0]
        state = after
    pile.random[0] = state


@inlined
def _fill_against_the_wall(pile: FlowingPile, rule: Exchange, side: int, left: int) -> None:
    """Capture an even share of what reached the wall, and in the last of `left` sub-steps all.

    Smallest first, as the threshold rule does.
    """
    i = Word(pile.grains.size - 1) if side == RIGHT else Word(0)
    layer = _layer(pile, rule, i)
    for a in range(len(layer)):
        captured = pile.rolling[side, a, i + ONE] // left
        pile.rolling[side, a, i + ONE] -= captured
        layer = _laid(pile, rule, i, layer, _only(rule, a, captured))
    _put_layer(pile, i, layer)


@inlined
def _move_grains(pile: FlowingPile, rule: Exchange, draws: Draws, side: int, i: Whole) -> None:
    ranks, layer, captured = len(rule.grain_height), _layer(pile, rule, i), rule.grain_height
    for a in range(ranks):
        count = binomial_from(pile.random, draws.grains, draws.chance, draws.none, a, i)
        captured = put(captured, a, count)
    for a in range(ranks):
        loosened = binomial_from(pile.random, draws.grains, draws.chance, draws.none, ranks + a, i)
        layer = put(layer, a, layer[a] - loosened)
        pile.at_rest[a] -= loosened
        pile.height[i + ONE] -= loosened * rule.grain_height[a]
        pile.rolling[side, a, i + ONE] += loosened - captured[a]
    layer = _laid(pile, rule, i, layer, captured)
    _put_layer(pile, i, _dug_up(pile, rule, i, layer))


@inlined
def _layer(pile: FlowingPile, rule: Exchange, i: Whole) -> tuple[int, ...]:
    """The grains (rank,) of the surface layer."""
    layer = rule.grain_height
    for a in range(len(layer)):
        layer = put(layer, a, pile.layer[a, i])
    return layer


@inlined
def _put_layer(pile: FlowingPile, i: Whole, layer: tuple[int, ...]) -> None:
    for a in range(len(layer)):
        pile.layer[a, i] = layer[a]


@inlined
def _held(rule: Exchange, layer: tuple[int, ...]) -> int:
    """Thickness of the grains of a layer, u."""
    held = 0
    for a in range(len(layer)):
        held += layer[a] * rule.grain_height[a]
    return held


@inlined
def _laid(
    pile: FlowingPile,
    rule: Exchange,
    i: Whole,
    layer: tuple[int, ...],
    captured: tuple[int, ...],
) -> tuple[int, ...]:
    """The layer after grains were laid in any order, and it buried what it had no room for.

    Species after species, it would end each sub-step richer in the last one, by half of what is
    captured in it over d, however small the grains.
    """
    held, left = _held(rule, layer), _count(captured)
    while left > 0:
        a = _alone(captured, left)
        if a < 0:
            a = _picked(pile, captured, left)
        captured, left = _changed(captured, a, -1), left - 1
        while held > 0 and held + rule.grain_height[a] > rule.depth:
            b = _picked(pile, layer, _count(layer))
            layer, held = _changed(layer, b, -1), held - rule.grain_height[b]
            pile.stack[i, pile.grains[i]] = b
            pile.grains[i] += 1
        layer, held = _changed(layer, a, 1), held + rule.grain_height[a]
        pile.height[i + ONE] += rule.grain_height[a]
        pile.at_rest[a] += 1
    return layer


@inlined
def _only(rule: Exchange, rank: int, grains: int) -> tuple[int, ...]:
    """So many grains of one rank, and none of any other."""
    counts = rule.grain_height
    for a in range(len(counts)):
        counts = put(counts, a, grains if a == rank else 0)
    return counts


@inlined
def _count(grains: tuple[int, ...]) -> int:
    count = 0
    for a in range(len(grains)):
        count += grains[a]
    return count


@inlined
def _alone(grains: tuple[int, ...], count: int) -> int:
    """The rank that all of so many `grains` are of, or -1."""
    rank = -1
    for a in range(len(grains)):
        rank = a if grains[a] == count else rank
    return rank


@inlined
def _picked(pile: FlowingPile, grains: tuple[int, ...], count: int) -> int:
    """The rank of one of so many `grains` (rank,), whichever it is."""
    left, b = pick(pile.random, count), 0
    for a in range(len(grains) - 1):
        left -= grains[a]
        b += left >= 0
    return b


@inlined
def _changed(layer: tuple[int, ...], b: int, by: int) -> tuple[int, ...]:
    for a in range(len(layer)):
        layer = put(layer, a, layer[a] + (by if a == b else 0))
    return layer


@inlined
def _dug_up(pile: FlowingPile, rule: Exchange, i: Whole, layer: tuple[int, ...]) -> tuple[int, ...]:
    """The layer refilled from below while it has room for any grain, or holds none."""
    held = _held(rule, layer)
    while pile.grains[i] > 0 and (held == 0 or held + rule.tallest <= rule.depth):
        pile.grains[i] -= 1
        b = pile.stack[i, pile.grains[i]]
        layer = _changed(layer, b, 1)
        held += rule.grain_height[b]
    return layer


@njit(cache=True, nogil=True)
def composition(pile: FlowingPile, rule: Exchange, phi: Floats) -> None:
    """Put down the composition (column, rank) of the surface."""
    for i in range(pile.grains.size):
        fractions, _ = surface(pile, rule, i)
        for a in range(len(fractions)):
            phi[i, a] = fractions[a]
