"""The lattice rule of :mod:`ca_model.reference` on arrays, grain for grain the same.

A step costs what happens in it, not the length of the pile:

- Rolling grains are kept where they are, in slots that all move one column a step; a slot's grains
  are a packet. The slot of a flow's first column is its frame, which falls by one a step.
- Two sets say where something can happen: the eligible columns, which would capture a species, and
  the packets that offer it, the smallest they hold. Laid over each other, frame on column 0, they
  leave the columns that capture. Words of 64 columns that hold nothing are skipped by a summary.
- Captured grains go into a log, in the order of their capture; stacks are made from it elsewhere.

Columns are taken in their order along the flow: each then meets the height that its downhill
neighbour had before, so heights can be changed in place. A flow's order counts `place`s: those of
the flow to the right are the columns, those of the flow to the left are the columns in reverse.
Species are numbered by rank, the smallest is 0.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ca_model.bits import (
    EMPTY,
    ONE,
    Word,
    bit_of,
    lowest,
    place_in_word,
    window,
    without_lowest,
    word_of,
)
from ca_model.compiled import UNCOUNTED, inlined
from ca_model.lattice import MANY
from experiment.arrays import Ints

__all__ = ["FRAME", "LOGGED", "RankedRule", "State", "advance", "mark_all"]

RIGHT, LEFT = Word(0), Word(1)
FRAME, LOGGED, ROLLING = 0, 1, 2  # what Pile.count counts

Words = NDArray[np.uint64]


class RankedRule(NamedTuple):
    """A rule by the rank of its species; the number of ranks is known when it is compiled."""

    ranks: tuple[int, ...]  # (0, 1, ...)
    grain_height: Ints  # (rank,)
    threshold: Ints  # (surface rank * ranks + rolling rank,)
    contacts: int
    percolation: bool


class State(NamedTuple):
    """The state of a lattice pile, changed in place by :func:`advance`."""

    sides: tuple[int, ...]  # (0,) or (0, 1): flows to the right, and to the left
    wall: bool  # whether the ends are walls; else grains fall off over lips
    height: Ints  # (1 + column + 1,) in u; with the levels beyond the ends
    top: NDArray[np.int8]  # (column,) rank of the topmost grain
    rolling: Ints  # (side, slot * ranks + rank) grains
    packets: Words  # (side, word * ranks + rank): slots that offer a rank to the surface
    packet_words: Words  # (side, word): a summary of them
    eligible: Words  # (side, word * ranks + rank): places that would capture a rank
    eligible_words: Words  # (side, word): a summary of them
    outflow: Ints  # (rank,) grains that fell off the ends
    log: NDArray[np.int32]  # column * ranks + rank of captured grains
    counter: Words  # frame, grains in the log, grains that roll


@njit(cache=True, nogil=True, **UNCOUNTED)
def advance(pile: State, rule: RankedRule, arrivals: Ints, source: Words) -> int:
    """Advance `pile` by one step per row of `arrivals` (step, side, rank).

    The grains of step k enter to the right and left of the edge before column source[k]. Returns
    the number of steps taken, fewer than asked for where the log needs more room first.
    """
    for step in range(arrivals.shape[0]):
        arriving = 0
        for side in range(arrivals.shape[1]):
            for a in range(arrivals.shape[2]):
                arriving += arrivals[step, side, a]
        if pile.counter[LOGGED] + pile.counter[ROLLING] + Word(arriving) > Word(pile.log.size):
            return step
        logged = pile.counter[LOGGED]
        fell_off = _roll(pile, rule)
        for side in range(Word(len(pile.sides))):
            _feed(pile, rule, side, source[step], arrivals, step)
        for side in range(Word(len(pile.sides))):
            _touch(pile, rule, side)
        pile.counter[ROLLING] += Word(arriving) - fell_off - (pile.counter[LOGGED] - logged)
    return arrivals.shape[0]


@njit(cache=True, **UNCOUNTED)
def mark_all(pile: State, rule: RankedRule) -> None:
    """Find the eligible columns of a pile that was just set up."""
    for i in range(Word(pile.top.size)):
        _mark_around(pile, rule, i)


@inlined
def _roll(pile: State, rule: RankedRule) -> Word:
    """Move the frames; returns how many grains fell off the ends."""
    if pile.counter[FRAME] == EMPTY:
        _move_to_the_upper_slots(pile, rule)
    pile.counter[FRAME] -= ONE
    fell_off = EMPTY
    if not pile.wall:
        ranks = Word(len(rule.ranks))
        beyond = (pile.counter[FRAME] + Word(pile.top.size)) * ranks
        for side in range(Word(len(pile.sides))):
            for a in range(ranks):
                pile.outflow[a] += pile.rolling[side, beyond + a]
                fell_off += Word(pile.rolling[side, beyond + a])
                pile.rolling[side, beyond + a] = 0
    return fell_off


@njit(**UNCOUNTED)
def _move_to_the_upper_slots(pile: State, rule: RankedRule) -> None:
    """Once in as many steps as there are columns: make room below the frame."""
    columns, ranks = Word(pile.top.size), Word(len(rule.ranks))
    size = columns * ranks
    pile.packets[:] = EMPTY
    pile.packet_words[:] = EMPTY
    for side in range(Word(len(pile.sides))):
        for k in range(size):
            pile.rolling[side, size + k] = pile.rolling[side, k]
            pile.rolling[side, k] = 0
        for slot in range(columns, columns + columns):
            _mark_packet(pile, rule, side, slot)
    pile.counter[FRAME] = columns


@inlined
def _feed(
    pile: State, rule: RankedRule, side: Word, source: Word, arrivals: Ints, step: int
) -> None:
    """Grains enter at the source; from an end, those that would leave at once turn round."""
    columns, ranks = Word(pile.top.size), Word(len(rule.ranks))
    place = source if side == RIGHT else columns - source
    into = side
    if place == columns:
        into = LEFT if side == RIGHT else RIGHT
        place = EMPTY
    slot = pile.counter[FRAME] + place
    for a in range(ranks):
        pile.rolling[into, slot * ranks + a] += arrivals[step, side, a]
    _mark_packet(pile, rule, into, slot)


@inlined
def _touch(pile: State, rule: RankedRule, side: Word) -> None:
    """Let the flow touch the surface wherever that can capture from it."""
    frame, last = pile.counter[FRAME], Word(pile.top.size) - ONE
    first, shift = word_of(frame), place_in_word(frame)
    for block in range(Word(pile.eligible_words.shape[1])):
        words = _words_to_look_at(pile, side, block, first)
        while words != EMPTY:
            w = block * Word(64) + lowest(words)
            words = without_lowest(words)
            places = _places_that_capture(pile, rule, side, w, first, shift)
            while places != EMPTY:
                place = w * Word(64) + lowest(places)
                places = without_lowest(places)
                at_wall = pile.wall and place == last
                i = place if side == RIGHT else last - place
                if rule.percolation or at_wall:
                    contacts = MANY if at_wall else rule.contacts
                    _touch_smallest(pile, rule, side, frame + place, i, contacts)
                else:
                    _touch_each(pile, rule, side, frame + place, i)
                _mark_packet(pile, rule, side, frame + place)
                _mark_around(pile, rule, i)


@inlined
def _words_to_look_at(pile: State, side: Word, block: Word, first: Word) -> Word:
    """Which of 64 words hold both eligible columns and packets; those lie in two words each."""
    at, shift = word_of(first) + block, place_in_word(first)
    low, high = pile.packet_words[side, at], pile.packet_words[side, at + ONE]
    lower = window(low, high, shift)
    upper = (lower >> ONE) | ((high >> shift) << Word(63))
    return pile.eligible_words[side, block] & (lower | upper)


@inlined
def _places_that_capture(
    pile: State, rule: RankedRule, side: Word, w: Word, first: Word, shift: Word
) -> Word:
    """Which of the 64 places of word w hold what their columns would capture."""
    ranks = Word(len(rule.ranks))
    places, columns, packets = EMPTY, EMPTY, EMPTY
    for a in range(ranks):
        eligible = pile.eligible[side, w * ranks + a]
        low = pile.packets[side, (first + w) * ranks + a]
        high = pile.packets[side, (first + w + ONE) * ranks + a]
        places |= eligible & window(low, high, shift)
        columns |= eligible
        packets |= low
    if columns == EMPTY:
        pile.eligible_words[side, word_of(w)] &= ~bit_of(w)
    if packets == EMPTY:
        pile.packet_words[side, word_of(first + w)] &= ~bit_of(first + w)
    return places


@inlined
def _touch_smallest(
    pile: State, rule: RankedRule, side: Word, slot: Word, i: Word, contacts: int
) -> None:
    touches = 0
    a = _smallest(pile, rule, side, slot)
    while touches < contacts and a < Word(len(rule.ranks)) and _is_captured(pile, rule, side, i, a):
        _capture(pile, rule, side, slot, i, a)
        touches += 1
        a = _smallest(pile, rule, side, slot)


@inlined
def _touch_each(pile: State, rule: RankedRule, side: Word, slot: Word, i: Word) -> None:
    ranks = Word(len(rule.ranks))
    turns = EMPTY
    for a in range(ranks):
        if pile.rolling[side, slot * ranks + a] > 0:
            turns |= bit_of(a)
    touches = 0
    while touches < rule.contacts and turns != EMPTY:
        for a in range(ranks):
            if turns & bit_of(a) != EMPTY:
                captured = _is_captured(pile, rule, side, i, a)
                if captured:
                    _capture(pile, rule, side, slot, i, a)
                if not captured or pile.rolling[side, slot * ranks + a] == 0:
                    turns &= ~bit_of(a)
        touches += 1


@inlined
def _smallest(pile: State, rule: RankedRule, side: Word, slot: Word) -> Word:
    """The smallest rank in a packet; the number of ranks where it is empty."""
    ranks = Word(len(rule.ranks))
    smallest = ranks
    for k in range(ranks):
        a = ranks - ONE - k
        if pile.rolling[side, slot * ranks + a] > 0:
            smallest = a
    return smallest


@inlined
def _slope(pile: State, side: Word, i: Word) -> int:
    downhill = i + ONE + ONE if side == RIGHT else i
    return pile.height[i + ONE] - pile.height[downhill]


@inlined
def _is_captured(pile: State, rule: RankedRule, side: Word, i: Word, a: Word) -> bool:
    surface = Word(pile.top[i])
    return _slope(pile, side, i) < rule.threshold[surface * Word(len(rule.ranks)) + a]


@inlined
def _capture(pile: State, rule: RankedRule, side: Word, slot: Word, i: Word, a: Word) -> None:
    ranks = Word(len(rule.ranks))
    pile.rolling[side, slot * ranks + a] -= 1
    pile.log[pile.counter[LOGGED]] = i * ranks + a
    pile.counter[LOGGED] += ONE
    pile.top[i] = a
    pile.height[i + ONE] += rule.grain_height[a]


@inlined
def _mark_packet(pile: State, rule: RankedRule, side: Word, slot: Word) -> None:
    """Note what the packet in `slot` offers: its smallest grains, or without percolation all."""
    ranks = Word(len(rule.ranks))
    w = word_of(slot)
    offers, hidden = EMPTY, False
    for a in range(ranks):
        offered = pile.rolling[side, slot * ranks + a] > 0 and not hidden
        hidden = hidden or (offered and rule.percolation)
        others = pile.packets[side, w * ranks + a] & ~bit_of(slot)
        pile.packets[side, w * ranks + a] = others | (Word(offered) << place_in_word(slot))
        offers |= Word(offered)
    pile.packet_words[side, word_of(w)] |= offers << place_in_word(w)


@inlined
def _mark_around(pile: State, rule: RankedRule, i: Word) -> None:
    """Note what the columns would capture whose slopes the height of column i decides."""
    columns = Word(pile.top.size)
    for side in range(Word(len(pile.sides))):
        place = i if side == RIGHT else columns - ONE - i
        for uphill in range(Word(2)):
            if place >= uphill:
                _mark_column(pile, rule, side, place - uphill)


@inlined
def _mark_column(pile: State, rule: RankedRule, side: Word, place: Word) -> None:
    """Note which ranks the column at `place` would capture."""
    ranks = Word(len(rule.ranks))
    i = place if side == RIGHT else Word(pile.top.size) - ONE - place
    w = word_of(place)
    any_rank = EMPTY
    for a in range(ranks):
        captured = Word(_is_captured(pile, rule, side, i, a))
        others = pile.eligible[side, w * ranks + a] & ~bit_of(place)
        pile.eligible[side, w * ranks + a] = others | (captured << place_in_word(place))
        any_rank |= captured
    pile.eligible_words[side, word_of(w)] |= any_rank << place_in_word(w)
