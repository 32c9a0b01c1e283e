"""The rate rule of :mod:`ca_model.rates.reference` on arrays, grain for grain the same.

    captured       each rolling grain of a in contact    1 - exp(-k gamma_aa P(theta_a - s) dt)
    set rolling    each grain of a in the layer          1 - exp(-(c / t) A_a dt)
                   A_a = sum_b [mu_ba + gamma_ba P(s - theta_b)] R_b

in sub-steps dt, at the slope and the composition with which a sub-step begins; t is the thickness
of the surface layer, R_b that of the grains in contact. Columns are taken in their order along the
flow: each then meets the height that its downhill neighbour had before, and is told the one that
its uphill neighbour had, so heights can be changed in place. Species are numbered by rank, the
smallest is 0.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ca_model.draws import RandomState, binomial, chance_within, pick
from ca_model.kernel.compiled import UNCOUNTED, inlined
from experiment.arrays import Floats, Ints
from experiment.law import Law, amplification_rates, capture_rates, repose_slopes
from experiment.species import Values, put

__all__ = ["BARE", "COURANT", "DONE", "FULL", "Exchange", "FlowingPile", "advance", "composition"]

COURANT = 0.25
RIGHT, LEFT = 0, 1
DONE, FULL, BARE = range(3)


class Exchange(NamedTuple):
    """The rule by the rank of its species; their number is known when it is compiled."""

    law: Law
    grain_height: tuple[int, ...]  # (rank,) u
    fastest: Values  # (rank,) 1/s; the largest rate of each
    rigid_fraction: Values  # (rank,) composition of the ground
    contacts: int
    sharpness: float  # k
    amplification: float  # c
    depth: int  # of the surface layer, u
    tallest: int  # of the grains, u
    unit: float  # cm
    width: float  # cm
    step: float  # s


class FlowingPile(NamedTuple):
    """A pile between two ends, changed in place."""

    wall: bool  # whether walls stand at the ends; else grains fall over lips
    height: Ints  # (1 + column + 1,) in u, with the lips
    rolling: Ints  # (side, 1 + column + 1, rank) grains, with those that leave
    layer: Ints  # (column, rank) grains of the surface layer
    stack: NDArray[np.int8]  # (column, place) ranks of the grains below it, lowest first
    grains: Ints  # (column,) how many places of the stack are taken
    handed_on: Ints  # (column,) how many grains there were below those
    at_rest: Ints  # (rank,) grains of all layers and stacks, and below
    outflow: Ints  # (rank,) grains that fell over the lips
    random: RandomState


@njit(cache=True, nogil=True, **UNCOUNTED)
def advance(pile: FlowingPile, rule: Exchange, arrivals: Ints, source: Ints) -> tuple[int, int]:
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
                _exchange(pile, rule, side, source[step], dt, substeps - k)
    return arrivals.shape[0], DONE


@inlined
def _why_stop(pile: FlowingPile, rule: Exchange, arrivals: Ints, step: int) -> int:
    """DONE where the stacks last for the next step, whatever happens in it.

    What is in a column, rolling or at rest, stays there; a sub-step digs up a layer at the most.
    """
    rolling, busiest = 0, _busiest(pile, rule)
    for side in range(pile.rolling.shape[0]):
        most = 0
        for i in range(pile.rolling.shape[1]):
            count = 0
            for a in range(len(rule.grain_height)):
                count += pile.rolling[side, i, a]
            most = max(most, count)
        rolling += most
        for a in range(len(rule.grain_height)):
            rolling += arrivals[step, side, a]
            fed = arrivals[step, side, a] * rule.grain_height[a] * rule.unit
            busiest += rule.fastest[a] * fed
    layer = max(rule.depth, 1)
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
        for i in range(1, 1 + pile.grains.size):
            left, busy = rule.contacts, 0.0
            for a in range(len(rule.grain_height)):
                exposed = min(pile.rolling[side, i, a], left)
                left -= exposed
                busy += rule.fastest[a] * (exposed * rule.grain_height[a] * rule.unit)
            busiest = max(busiest, busy)
    return busiest


@inlined
def _substeps(rule: Exchange, busiest: float) -> int:
    """Sub-steps of a step in which a disturbance of the slope climbs a quarter of a column."""
    climb = busiest * (1.0 + 2.0 * rule.law.curvature_length / rule.width)
    return max(1, math.ceil(climb * rule.step / (COURANT * rule.width)))


@inlined
def _roll(pile: FlowingPile) -> None:
    sides, ends, ranks = pile.rolling.shape
    for a in range(ranks):
        for i in range(ends - 1, 0, -1):
            pile.rolling[RIGHT, i, a] = pile.rolling[RIGHT, i - 1, a]
        pile.outflow[a] += pile.rolling[RIGHT, ends - 1, a]
        pile.rolling[RIGHT, ends - 1, a] = 0
        if sides > 1:
            for i in range(ends - 1):
                pile.rolling[LEFT, i, a] = pile.rolling[LEFT, i + 1, a]
            pile.outflow[a] += pile.rolling[LEFT, 0, a]
            pile.rolling[LEFT, 0, a] = 0


@inlined
def _feed(pile: FlowingPile, arrivals: Ints, step: int, source: int) -> None:
    """Grains enter beside the source; at an end those that would leave at once turn round."""
    columns = pile.grains.size
    for side in range(arrivals.shape[1]):
        turned = source == columns if side == RIGHT else source == 0
        into = side if not turned else RIGHT + LEFT - side
        column = source if into == RIGHT else source - 1
        for a in range(arrivals.shape[2]):
            pile.rolling[into, 1 + column, a] += arrivals[step, side, a]


@inlined
def _exchange(
    pile: FlowingPile, rule: Exchange, side: int, source: int, dt: float, left: int
) -> None:
    """Capture from the flow of one side, and set rolling what it strikes; `left`: sub-steps."""
    columns = pile.grains.size
    first = source if side == RIGHT else source - 1
    uphill = 0
    for k in range(columns):
        i = k if side == RIGHT else columns - 1 - k
        here = pile.height[1 + i]
        flows = False
        for a in range(len(rule.grain_height)):
            flows |= pile.rolling[side, 1 + i, a] > 0
        if flows:
            if pile.wall and k == columns - 1:
                _fill_against_the_wall(pile, rule, side, i, left)
            else:
                theta = here - pile.height[2 + i if side == RIGHT else i]
                bend = 0 if k == 0 or i == first else (uphill - here) - theta
                _exchange_in_column(pile, rule, side, i, _slope(rule, theta, bend), dt)
        uphill = here


@inlined
def _slope(rule: Exchange, theta: int, bend: int) -> float:
    """S = theta - l d2h/dx2 of a step down and of what the one uphill is more, in u."""
    curvature = rule.law.curvature_length / rule.width
    return (theta - curvature * bend) * (rule.unit / rule.width)


@inlined
def _fill_against_the_wall(pile: FlowingPile, rule: Exchange, side: int, i: int, left: int) -> None:
    """Capture an even share of what reached the wall; all of it in the last sub-step."""
    for a in range(len(rule.grain_height)):
        captured = pile.rolling[side, 1 + i, a] // left
        pile.rolling[side, 1 + i, a] -= captured
        _lay(pile, rule, i, a, captured)


@inlined
def _exchange_in_column(
    pile: FlowingPile, rule: Exchange, side: int, i: int, slope: float, dt: float
) -> None:
    law, ranks = rule.law, len(rule.grain_height)
    phi, thickness = _surface(pile, rule, i)
    theta = repose_slopes(phi, law)
    capture = capture_rates(theta, slope, law)
    exposed, captured, free = phi, rule.grain_height, rule.contacts
    for a in range(ranks):
        touching = min(pile.rolling[side, 1 + i, a], free)
        free -= touching
        exposed = put(exposed, a, touching * rule.grain_height[a] * rule.unit)
        chance = chance_within(rule.sharpness * capture[a] * dt)
        captured = put(captured, a, binomial(pile.random, touching, chance))
    struck = amplification_rates(theta, slope, exposed, law)
    for a in range(ranks):
        chance = chance_within(rule.amplification * struck[a] * (dt / thickness))
        loosened = binomial(pile.random, pile.layer[i, a], chance)
        pile.layer[i, a] -= loosened
        pile.at_rest[a] -= loosened
        pile.height[1 + i] -= loosened * rule.grain_height[a]
        pile.rolling[side, 1 + i, a] += loosened - captured[a]
    for a in range(ranks):
        _lay(pile, rule, i, a, captured[a])
    _dig_up(pile, rule, i)


@inlined
def _surface(pile: FlowingPile, rule: Exchange, i: int) -> tuple[Values, float]:
    """The composition of the surface layer, and how thick it is [cm].

    Where nothing lies below it, the ground makes up what it lacks of its depth.
    """
    held = _held(pile, rule, i)
    bare = pile.grains[i] + pile.handed_on[i] == 0
    lacks = max(rule.depth - held, 0) if bare else 0
    phi = rule.rigid_fraction
    for a in range(len(rule.grain_height)):
        volume = pile.layer[i, a] * rule.grain_height[a] + lacks * rule.rigid_fraction[a]
        phi = put(phi, a, volume / (held + lacks))
    return phi, (held + lacks) * rule.unit


@inlined
def _held(pile: FlowingPile, rule: Exchange, i: int) -> int:
    """Thickness of the grains of the surface layer, u."""
    held = 0
    for a in range(len(rule.grain_height)):
        held += pile.layer[i, a] * rule.grain_height[a]
    return held


@inlined
def _lay(pile: FlowingPile, rule: Exchange, i: int, a: int, grains: int) -> None:
    """Lay captured grains one by one; what there is no room for in the layer is buried first."""
    held = _held(pile, rule, i)
    for _ in range(grains):
        while held > 0 and held + rule.grain_height[a] > rule.depth:
            held -= rule.grain_height[_bury(pile, i)]
        pile.layer[i, a] += 1
        held += rule.grain_height[a]
    pile.height[1 + i] += grains * rule.grain_height[a]
    pile.at_rest[a] += grains


@inlined
def _bury(pile: FlowingPile, i: int) -> int:
    """Bury one of the grains of the layer, whichever it is; its rank."""
    count = 0
    for a in range(pile.layer.shape[1]):
        count += pile.layer[i, a]
    left, b = pick(pile.random, count), 0
    while left >= pile.layer[i, b]:
        left -= pile.layer[i, b]
        b += 1
    pile.layer[i, b] -= 1
    pile.stack[i, pile.grains[i]] = b
    pile.grains[i] += 1
    return b


@inlined
def _dig_up(pile: FlowingPile, rule: Exchange, i: int) -> None:
    """Refill the layer from below while it has room for any grain, or holds none."""
    held = _held(pile, rule, i)
    while pile.grains[i] > 0 and (held == 0 or held + rule.tallest <= rule.depth):
        pile.grains[i] -= 1
        b = pile.stack[i, pile.grains[i]]
        pile.layer[i, b] += 1
        held += rule.grain_height[b]


@njit(cache=True, nogil=True)
def composition(pile: FlowingPile, rule: Exchange, phi: Floats) -> None:
    """Put down the composition (column, rank) of the surface."""
    for i in range(pile.grains.size):
        fractions, _ = _surface(pile, rule, i)
        for a in range(len(fractions)):
            phi[i, a] = fractions[a]
