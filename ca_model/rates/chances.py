"""What of a sub-step does not hang on its random words, found for all columns at once.

    captured       each rolling grain of a in contact    p = 1 - exp(-k gamma_aa P(theta_a - s) dt)
    set rolling    each grain of a in the layer          p = 1 - exp(-(c / t) A_a dt)
                   A_a = sum_b [mu_ba + gamma_ba P(s - theta_b)] R_b

at the slope and the composition with which the sub-step begins; t is the thickness of the surface
layer, R_b that of the grains in contact. Columns go through these loops in vector lanes; numbers of
columns are unsigned, so that no index of one can count from the end of an array.
"""

from ca_model.draws import NEVER, chance_within, powers_of_none
from ca_model.kernel.bits import Whole, Word
from ca_model.kernel.compiled import inlined
from ca_model.rates.state import LANES, RIGHT, Draws, Exchange, FlowingPile
from experiment.arrays import Floats, Ints
from experiment.law import amplification_rates, capture_rates, repose_slopes
from experiment.species import Values, put

__all__ = ["find_chances", "surface", "touching"]

ONE, TWO = Word(1), Word(2)
BLOCK = Word(256)  # columns, which stay in the innermost cache


@inlined
def find_chances(
    pile: FlowingPile,
    rule: Exchange,
    draws: Draws,
    side: int,
    source: int,
    reach: tuple[Whole, Whole],
    dt: float,
) -> None:
    """Put down the draws of the columns `reach`, from one to before the other, of a side's flow."""
    begin = reach[0] // LANES * LANES
    end = (reach[1] + LANES - ONE) // LANES * LANES
    while begin < end:
        block = begin, min(begin + BLOCK, end)
        there = begin, min(block[1], Word(pile.grains.size))
        _find_expected(pile, rule, draws, side, source, there, dt)
        for draw in range(2 * len(rule.grain_height)):
            _find_none(draws.grains[draw], draws.chance[draw], draws.none[draw], draws.power, block)
        begin += BLOCK


@inlined
def _find_expected(
    pile: FlowingPile,
    rule: Exchange,
    draws: Draws,
    side: int,
    source: int,
    block: tuple[Whole, Whole],
    dt: float,
) -> None:
    """Put down how often each of how many grains would be captured or set rolling."""
    ranks = len(rule.grain_height)
    for i in range(*block):
        slope = _slope(pile, rule, side, source, i)
        phi, thickness = surface(pile, rule, i)
        theta = repose_slopes(phi, rule.law)
        capture = capture_rates(theta, slope, rule.law)
        touch, exposed = touching(pile, rule, side, i), phi
        for a in range(ranks):
            exposed = put(exposed, a, touch[a] * rule.grain_height[a] * rule.unit)
        struck = amplification_rates(theta, slope, exposed, rule.law)
        for a in range(ranks):
            draws.grains[a, i] = touch[a]
            draws.chance[a, i] = rule.sharpness * capture[a] * dt
            draws.grains[ranks + a, i] = pile.layer[a, i]
            draws.chance[ranks + a, i] = rule.amplification * struck[a] * (dt / thickness)


@inlined
def _find_none(
    grains: Ints, chance: Floats, none: Floats, power: Floats, block: tuple[Whole, Whole]
) -> None:
    """Put down how likely what is expected so often is, and that it happens to none."""
    some, most = 0, 0
    for i in range(*block):
        some += (grains[i] > 0) & (chance[i] > 0.0)
        none[i] = NEVER
    if some == 0:
        return
    for i in range(*block):
        chance[i] = chance_within(chance[i])
        none[i], power[i] = powers_of_none(grains[i], chance[i])
        most = max(most, grains[i] if none[i] == 1.0 else 0)
    bit = 1
    while bit <= most:
        for i in range(*block):
            none[i] *= power[i] if grains[i] & bit else 1.0
            power[i] *= power[i]
        bit <<= 1


@inlined
def _slope(pile: FlowingPile, rule: Exchange, side: int, source: int, i: Whole) -> float:
    """S = theta - l d2h/dx2, towards the downhill neighbour; nothing bends where grains enter."""
    last = Word(pile.grains.size - 1)
    downhill, uphill = (i + TWO, i) if side == RIGHT else (i, i + TWO)
    end, first = (Word(0), Word(source)) if side == RIGHT else (last, Word(source - 1))
    theta = pile.height[i + ONE] - pile.height[downhill]
    bend = pile.height[uphill] - pile.height[i + ONE] - theta
    bend = 0 if (i == end) | (i == first) else bend
    curvature = rule.law.curvature_length / rule.width
    slope: float = (theta - curvature * bend) * (rule.unit / rule.width)
    return slope


@inlined
def touching(pile: FlowingPile, rule: Exchange, side: int, i: Whole) -> tuple[int, ...]:
    """The grains (rank,) in contact: as many as there are contacts, smallest first."""
    touch, free = rule.grain_height, rule.contacts
    for a in range(len(rule.grain_height)):
        touch = put(touch, a, min(pile.rolling[side, a, i + ONE], free))
        free -= touch[a]
    return touch


@inlined
def surface(pile: FlowingPile, rule: Exchange, i: Whole) -> tuple[Values, float]:
    """The composition of the surface layer, and how thick it is [cm].

    Where nothing lies below it, the ground makes up what it lacks of its depth.
    """
    held = 0
    for a in range(len(rule.grain_height)):
        held += pile.layer[a, i] * rule.grain_height[a]
    bare = pile.grains[i] + pile.handed_on[i] == 0
    lacks = max(rule.depth - held, 0) if bare else 0
    phi = rule.rigid_fraction
    for a in range(len(rule.grain_height)):
        volume = pile.layer[a, i] * rule.grain_height[a] + lacks * rule.rigid_fraction[a]
        phi = put(phi, a, volume / (held + lacks))
    return phi, (held + lacks) * rule.unit
