"""One side of a pile and the sets of its places that capture a species.

Columns are counted downhill from the source, as places; past the last comes a place that stops
everything, the lip (a wall's last column does so itself). Species are numbered by rank, smallest 0.
The places that would capture a species are bits of a set, so the next one on the way of a grain is
found by counting zeros.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ca_model.kernel.bits import (
    ALL,
    EMPTY,
    ONE,
    Whole,
    Word,
    bit_of,
    lowest,
    place_in_word,
    word_of,
)
from ca_model.kernel.compiled import UNCOUNTED, inlined
from ca_model.kernel.log import Log, column_of, entry_of, rank_of
from experiment.arrays import Ints

__all__ = [
    "RankedRule",
    "Slope",
    "capture",
    "end",
    "entry_at",
    "is_captured",
    "logged",
    "mark",
    "mark_all",
    "mark_places",
    "next_place",
    "show_uphill",
]

Words = NDArray[np.uint64]


class RankedRule(NamedTuple):
    """A rule by the rank of its species; the number of ranks is known when it is compiled."""

    ranks: tuple[int, ...]  # (0, 1, ...)
    grain_height: Ints  # (rank,)
    threshold: Ints  # (surface rank * ranks + rolling rank,)
    contacts: int
    percolation: bool


class Slope(NamedTuple):
    """One side of a pile, downhill from a source at rest; changed in place."""

    first: Word  # the column of place 0
    downhill: Word  # from one place's column to the next one's: 1, or -1 as unsigned
    wall: bool  # whether the last column stands against a wall; else grains fall over a lip
    level: int  # of the lip, or of the floor by the wall
    slope: Ints  # (place,) h_i - h_{i+1}, the last one's to that level
    top: NDArray[np.int8]  # (place,) rank of the topmost grain
    rolling: Ints  # (place, rank) grains
    packet: Ints  # (rank,) grains of the packet that is being followed
    outflow: Ints  # (rank,) grains that fell over the lip
    eligible: Words  # (word * ranks + rank,) places that would capture a rank, and the end
    eligible_words: Words  # (word * ranks + rank,) words of that set that are not empty


@njit(cache=True, **UNCOUNTED)
def mark_all(pile: Slope, rule: RankedRule) -> None:
    """Find the places that capture, on a pile that was just set up."""
    for i in range(Word(pile.slope.size)):
        mark(pile, rule, i)
    for a in range(Word(len(rule.ranks))):
        mark_for(pile, rule, end(pile), a, ONE)


@inlined
def end(pile: Slope) -> Whole:
    """The place that stops every packet: the wall's, or the one beyond the lip."""
    return Word(pile.slope.size) - Word(pile.wall)


@inlined
def is_captured(pile: Slope, rule: RankedRule, i: Whole, a: Whole) -> bool:
    """Whether place i would capture a grain of rank a."""
    surface = Word(pile.top[i])
    return bool(pile.slope[i] < rule.threshold[surface * Word(len(rule.ranks)) + a])


@inlined
def capture(pile: Slope, rule: RankedRule, log: Log, i: Whole, a: Whole) -> None:
    """Let a grain of rank a come to rest on place i, which is to be marked then."""
    log.grains[log.length[0]] = entry_at(pile, i, a)
    log.length[0] += ONE
    pile.top[i] = a
    pile.slope[i] += rule.grain_height[a]


@inlined
def entry_at(pile: Slope, i: Whole, a: Whole) -> Whole:
    """A grain of rank a at place i, as the log tells of it."""
    return entry_of(pile.first + i * pile.downhill, a)


@inlined
def logged(pile: Slope, log: Log, k: Whole) -> tuple[Whole, Whole]:
    """The place and rank of entry k of the log."""
    entry = Word(log.grains[k])
    return (column_of(entry) - pile.first) * pile.downhill, rank_of(entry)


@inlined
def show_uphill(pile: Slope, rule: RankedRule, log: Log, first: Whole, last: Whole) -> None:
    """Let the uphill neighbours feel what the log tells from entry `first` to before `last`."""
    for entry in range(first, last):
        i, a = logged(pile, log, entry)
        if i > EMPTY:
            pile.slope[i - ONE] -= rule.grain_height[a]
            mark(pile, rule, i - ONE)


@inlined
def mark(pile: Slope, rule: RankedRule, i: Whole) -> None:
    """Note which ranks place i would capture."""
    if i < end(pile):
        for a in range(Word(len(rule.ranks))):
            mark_for(pile, rule, i, a, Word(is_captured(pile, rule, i, a)))


@inlined
def mark_for(pile: Slope, rule: RankedRule, i: Whole, a: Whole, captured: Whole) -> None:
    """Note whether place i would capture rank a."""
    there = bit_of(i)
    _put(pile, rule, word_of(i), a, there, captured << place_in_word(i))


@inlined
def mark_places(pile: Slope, rule: RankedRule, base: Whole, a: Whole, places: Whole) -> None:
    """Note which of the 64 places from `base` on would capture rank a."""
    w, shift = word_of(base), place_in_word(base)
    _put(pile, rule, w, a, ALL << shift, places << shift)
    if shift != EMPTY:
        _put(pile, rule, w + ONE, a, ~(ALL << shift), places >> (Word(64) - shift))


@inlined
def _put(pile: Slope, rule: RankedRule, w: Whole, a: Whole, there: Whole, places: Whole) -> None:
    """Word w of the set of a rank has these `places`, of all those `there`."""
    ranks = Word(len(rule.ranks))
    word = (pile.eligible[w * ranks + a] & ~there) | places
    words = pile.eligible_words[word_of(w) * ranks + a] & ~bit_of(w)
    pile.eligible[w * ranks + a] = word
    pile.eligible_words[word_of(w) * ranks + a] = words | (Word(word != EMPTY) << place_in_word(w))


@inlined
def next_place(pile: Slope, rule: RankedRule, a: Whole, i: Whole) -> Whole:
    """The first place from i on that captures rank a; at the latest the end."""
    ranks, w = Word(len(rule.ranks)), word_of(i)
    places = pile.eligible[w * ranks + a] >> place_in_word(i)
    if places != EMPTY:
        return i + lowest(places)
    w += ONE
    block = word_of(w)
    words = pile.eligible_words[block * ranks + a] >> place_in_word(w)
    while words == EMPTY:
        block += ONE
        w = block << Word(6)
        words = pile.eligible_words[block * ranks + a]
    w += lowest(words)
    return (w << Word(6)) + lowest(pile.eligible[w * ranks + a])
