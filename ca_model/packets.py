"""The lattice rule of :mod:`ca_model.reference`, a packet of grains after the other.

What enters in one step rolls together, one column a step: a packet. Here each packet is followed on
its way before the next, which is the same pour. In column i packet k meets what all packets before
it left there; but of its downhill neighbour i + 1 it must see the height from before the step, when
packet k - 1 had not touched i + 1 yet. So what a packet adds to a column is withheld from the slope
of the uphill neighbour until the next packet has passed.

The columns that would capture a species are bits of a set, so the next one on a packet's way is
found by counting zeros: a packet costs its captures, not the length of its way.

Columns are counted downhill from the source, as places; past the last comes a place that stops
everything, the lip (a wall's last column does so itself). Species are numbered by rank, smallest 0.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ca_model.bits import EMPTY, ONE, Whole, Word, bit_of, lowest, place_in_word, word_of
from ca_model.compiled import UNCOUNTED, inlined
from experiment.arrays import Ints

__all__ = ["Log", "RankedRule", "Slope", "follow_packets", "mark_all"]

Words = NDArray[np.uint64]

NOWHERE = Word(2**63)


class RankedRule(NamedTuple):
    """A rule by the rank of its species; the number of ranks is known when it is compiled."""

    ranks: tuple[int, ...]  # (0, 1, ...)
    grain_height: Ints  # (rank,)
    threshold: Ints  # (surface rank * ranks + rolling rank,)
    contacts: int
    percolation: bool


class Log(NamedTuple):
    """Where captured grains are put down."""

    grains: NDArray[np.int32]  # column * ranks + rank, in the order of each column's captures
    length: Words  # (1,) how many those are


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


@njit(cache=True, nogil=True, **UNCOUNTED)
def follow_packets(pile: Slope, rule: RankedRule, log: Log, arrivals: Ints) -> None:
    """Advance `pile` by one step per row of `arrivals` (step, rank), which are used up.

    The log must have room for all grains that roll or arrive.
    """
    places, steps = Word(pile.slope.size), Word(arrivals.shape[0])
    withheld = log.length[0]
    for k in range(places + steps if steps > EMPTY else EMPTY):
        if k < places:
            begin, reach = places - k, places - ONE - k + steps
            is_empty = _take_up(pile, rule, pile.rolling, begin - ONE)
        else:
            begin, reach = EMPTY, places + steps - ONE - k
            is_empty = _take_up(pile, rule, arrivals, k - places)
        own = log.length[0]
        if not is_empty:
            if rule.percolation:
                _follow(pile, rule, log, begin, reach)
            else:
                _follow_in_turns(pile, rule, log, begin, reach)
        _show_uphill(pile, rule, log, withheld, own)
        withheld = own
    _show_uphill(pile, rule, log, withheld, log.length[0])


@njit(cache=True, **UNCOUNTED)
def mark_all(pile: Slope, rule: RankedRule) -> None:
    """Find the places that capture, on a pile that was just set up."""
    for i in range(Word(pile.slope.size)):
        _mark(pile, rule, i)
    for a in range(Word(len(rule.ranks))):
        _mark_for(pile, rule, _end(pile), a, ONE)


@inlined
def _take_up(pile: Slope, rule: RankedRule, grains: Ints, row: Whole) -> bool:
    """Make the grains of a row the packet that is followed; says whether there are none."""
    is_empty = True
    for a in range(Word(len(rule.ranks))):
        pile.packet[a] = grains[row, a]
        is_empty = is_empty and grains[row, a] == 0
        grains[row, a] = 0
    return is_empty


@inlined
def _follow(pile: Slope, rule: RankedRule, log: Log, begin: Whole, reach: Whole) -> None:
    """Let the packet touch the surface from place `begin` to `reach`, where it goes on rolling."""
    i, touches = begin, 0
    for a in range(Word(len(rule.ranks))):
        left = pile.packet[a]
        while left > 0:
            place = _next(pile, rule, a, i)
            if place > reach:
                _roll_on(pile, rule, reach, a, left)
                return
            if place > i:
                i, touches = place, 0
            if place == _end(pile):
                _come_to_the_end(pile, rule, log, a, left)
                break
            _capture(pile, rule, log, i, a)
            _mark(pile, rule, i)
            left -= 1
            touches += 1
            if touches == rule.contacts:
                i, touches = i + ONE, 0


@inlined
def _roll_on(pile: Slope, rule: RankedRule, i: Whole, smallest: Whole, left: int) -> None:
    """What is left of the packet is at place i: so many of the smallest, all of the larger ones."""
    pile.rolling[i, smallest] = left
    for a in range(smallest + ONE, Word(len(rule.ranks))):
        pile.rolling[i, a] = pile.packet[a]


@njit(**UNCOUNTED)
def _follow_in_turns(pile: Slope, rule: RankedRule, log: Log, begin: Whole, reach: Whole) -> None:
    """The same without percolation: each species that still touches has its turn in a contact."""
    ranks = Word(len(rule.ranks))
    i = _next_of_any(pile, rule, begin)
    while i <= reach and i < _end(pile):
        turns, touches = _present(pile, rule), 0
        while touches < rule.contacts and turns != EMPTY:
            for a in range(ranks):
                if turns & bit_of(a) != EMPTY:
                    captured = _is_captured(pile, rule, i, a)
                    if captured:
                        pile.packet[a] -= 1
                        _capture(pile, rule, log, i, a)
                    if not captured or pile.packet[a] == 0:
                        turns &= ~bit_of(a)
            touches += 1
        _mark(pile, rule, i)
        i = _next_of_any(pile, rule, i + ONE)
    if i == NOWHERE:
        return
    for a in range(ranks):
        if i <= reach:
            _come_to_the_end(pile, rule, log, a, pile.packet[a])
        else:
            pile.rolling[reach, a] = pile.packet[a]


@inlined
def _come_to_the_end(pile: Slope, rule: RankedRule, log: Log, a: Whole, count: int) -> None:
    """Be captured by the wall's column, or fall over the lip."""
    if pile.wall:
        for _ in range(count):
            _capture(pile, rule, log, _end(pile), a)
    else:
        pile.outflow[a] += count


@inlined
def _end(pile: Slope) -> Whole:
    """The place that stops every packet: the wall's, or the one beyond the lip."""
    return Word(pile.slope.size) - Word(pile.wall)


@inlined
def _present(pile: Slope, rule: RankedRule) -> Whole:
    """The set of ranks in the packet."""
    present = EMPTY
    for a in range(Word(len(rule.ranks))):
        present |= Word(pile.packet[a] > 0) << a
    return present


@inlined
def _is_captured(pile: Slope, rule: RankedRule, i: Whole, a: Whole) -> bool:
    surface = Word(pile.top[i])
    return bool(pile.slope[i] < rule.threshold[surface * Word(len(rule.ranks)) + a])


@inlined
def _capture(pile: Slope, rule: RankedRule, log: Log, i: Whole, a: Whole) -> None:
    log.grains[log.length[0]] = (pile.first + i * pile.downhill) * Word(len(rule.ranks)) + a
    log.length[0] += ONE
    pile.top[i] = a
    pile.slope[i] += rule.grain_height[a]


@inlined
def _show_uphill(pile: Slope, rule: RankedRule, log: Log, first: Whole, last: Whole) -> None:
    """Let the uphill neighbours feel what the log tells from entry `first` to before `last`."""
    ranks = Word(len(rule.ranks))
    for entry in range(first, last):
        column = Word(log.grains[entry]) // ranks
        i = (column - pile.first) * pile.downhill
        if i > EMPTY:
            a = Word(log.grains[entry]) - column * ranks
            pile.slope[i - ONE] -= rule.grain_height[a]
            _mark(pile, rule, i - ONE)


@inlined
def _mark(pile: Slope, rule: RankedRule, i: Whole) -> None:
    """Note which ranks place i would capture."""
    if i < _end(pile):
        for a in range(Word(len(rule.ranks))):
            _mark_for(pile, rule, i, a, Word(_is_captured(pile, rule, i, a)))


@inlined
def _mark_for(pile: Slope, rule: RankedRule, i: Whole, a: Whole, captured: Whole) -> None:
    ranks, w = Word(len(rule.ranks)), word_of(i)
    word = (pile.eligible[w * ranks + a] & ~bit_of(i)) | (captured << place_in_word(i))
    words = pile.eligible_words[word_of(w) * ranks + a] & ~bit_of(w)
    pile.eligible[w * ranks + a] = word
    pile.eligible_words[word_of(w) * ranks + a] = words | (Word(word != EMPTY) << place_in_word(w))


@inlined
def _next_of_any(pile: Slope, rule: RankedRule, i: Whole) -> Whole:
    """The first place from i on that captures any rank of the packet; at the latest the end."""
    nearest = NOWHERE
    for a in range(Word(len(rule.ranks))):
        if pile.packet[a] > 0:
            nearest = min(nearest, Word(_next(pile, rule, a, i)))
    return nearest


@inlined
def _next(pile: Slope, rule: RankedRule, a: Whole, i: Whole) -> Whole:
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
