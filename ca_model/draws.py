"""Random numbers inside kernels: the words of SplitMix64, and what is drawn from them.

    pick(n)          one of 0 ... n - 1, all alike to n / 2^32
    binomial(n, p)   how many of n happen, each with the chance p

SplitMix64: Steele, Lea and Flood, OOPSLA 2014. All that is made of its words is sums, products,
quotients and comparisons, without a function of any library, so that a seed gives the same grains
on any machine.
"""

import numpy as np
from numpy.typing import NDArray

from ca_model.kernel.bits import Whole
from ca_model.kernel.compiled import inlined
from experiment.arrays import Floats, Ints

__all__ = [
    "NEVER",
    "RandomState",
    "binomial",
    "binomial_from",
    "chance_within",
    "pick",
    "powers_of_none",
    "random_state",
    "tried",
]

RandomState = NDArray[np.uint64]  # (1,) of SplitMix64, advanced in place by every draw

A_2, A_3, A_4, A_5, A_6 = 1 / 2, 1 / 6, 1 / 24, 1 / 120, 1 / 720  # of exp's series
CERTAIN = 40.0  # 1 - exp(-40) is 1 in 53 bits
MOST_AT_ONCE = 16.0  # expected; of more, several variates are the sum
PER_WORD = 2.0**-53
GOLDEN = np.uint64(0x9E3779B97F4A7C15)
NEVER = 2.0  # in place of how likely none is: no word is drawn
OTHERWISE = -1.0  # the same: certain, likelier than not, or the sum of several variates


def random_state(seed: int, pile: int = 0) -> RandomState:
    """The start of the random numbers of a pile of a seed."""
    return np.random.SeedSequence([seed, pile]).generate_state(1, np.uint64).astype(np.uint64)


@inlined
def word(random: RandomState) -> np.uint64:
    """The next 64 bits."""
    random[0] += GOLDEN
    return _mixed(random[0])


@inlined
def _mixed(bits: np.uint64) -> np.uint64:
    bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.uint64(bits ^ (bits >> np.uint64(31)))


@inlined
def _share(bits: np.uint64) -> float:
    """A number from 0 up, below 1."""
    return (bits >> np.uint64(11)) * PER_WORD


@inlined
def pick(random: RandomState, n: int) -> int:
    """One of 0 ... n - 1."""
    return int(np.int64(((word(random) >> np.uint64(32)) * np.uint64(n)) >> np.uint64(32)))


@inlined
def chance_within(expected: float) -> float:
    """1 - exp(-c): the chance that it happens in a time in which it would happen c times.

    To eight decimals, by exp(y) = 1 + y + ... + y^6 / 720 with y = c / 16.
    """
    if expected > CERTAIN:
        return 1.0
    y = expected * 0.0625
    grown = 1.0 + y * (1.0 + y * (A_2 + y * (A_3 + y * (A_4 + y * (A_5 + y * A_6)))))
    grown *= grown
    grown *= grown
    grown *= grown
    grown *= grown
    return (grown - 1.0) / grown


@inlined
def binomial(random: RandomState, n: int, chance: float) -> int:
    """How many of n happen, each with that chance; what is certain draws no word."""
    if n <= 0 or chance <= 0.0:
        return 0
    if chance >= 1.0:
        return n
    rare = min(chance, 1.0 - chance)
    most = n if n * rare <= MOST_AT_ONCE else int(MOST_AT_ONCE / rare)
    happened, left = 0, n
    while left > 0:
        part = min(left, most)
        happened += _binomial(random, part, rare)
        left -= part
    return happened if rare == chance else n - happened


@inlined
def _binomial(random: RandomState, n: int, chance: float) -> int:
    """By inversion, of so few or so rare that one word tells."""
    return _inverted(_share(word(random)), _power(1.0 - chance, n), n, chance)


@inlined
def _inverted(left: float, weight: float, n: int, chance: float) -> int:
    """p_0 = (1 - p)^n is `weight`, p_k = p_(k-1) (n - k + 1) / k p / (1 - p)."""
    odds = chance / (1.0 - chance)
    k = 0
    while left >= weight and k < n:
        left -= weight
        k += 1
        weight *= odds * (n - k + 1) / k
    return k


@inlined
def _power(base: float, exponent: int) -> float:
    power = 1.0
    while exponent > 0:
        if exponent & 1:
            power *= base
        base *= base
        exponent >>= 1
    return power


@inlined
def powers_of_none(n: int, chance: float) -> tuple[float, float]:
    """What to begin with, and what to multiply it with n times, to find how likely none of n is.

    It leads to NEVER or OTHERWISE where these hold.
    """
    common = (chance <= 0.5) & (n * chance <= MOST_AT_ONCE)
    begin = 1.0 if common else OTHERWISE
    begin = begin if (n > 0) & (chance > 0.0) else NEVER
    return begin, 1.0 - chance if begin == 1.0 else 1.0


@inlined
def tried(state: np.uint64, none: Floats, draws: int, i: Whole) -> tuple[np.uint64, bool]:
    """The state after the words of column i, and whether any of its draws is not of none.

    If so, they are yet to be drawn, from the state before.
    """
    some = False
    for draw in range(draws):
        if none[draw, i] != NEVER:
            state += GOLDEN
            some |= _share(_mixed(state)) >= none[draw, i]
    return state, some


@inlined
def binomial_from(
    random: RandomState, n: Ints, chance: Floats, none: Floats, draw: int, i: Whole
) -> int:
    """The same as :func:`binomial`, once it is known how likely none is."""
    weight = none[draw, i]
    if weight == NEVER:
        return 0
    if weight == OTHERWISE:
        return binomial(random, n[draw, i], chance[draw, i])
    left = _share(word(random))
    return 0 if left < weight else _inverted(left, weight, n[draw, i], chance[draw, i])
