"""Sixty-four places of a slope in registers, where packet after packet is captured.

What captures moves slowly: a kink climbs the pile, and most packets come to rest within a few
places of the last one. Over 64 places about them slopes, the topmost grains and their thresholds
are bytes of vectors, so one comparison finds all places that capture a rank, and a capture is two
additions under a mask. Arrays and sets are read when the window opens and written when it closes:
where a packet is not captured as a whole, where the place above the window or slopes beyond +-40
are concerned, and where packets begin or end inside. Those are for :mod:`ca_model.kernel.packets`.
"""

from collections.abc import Callable
from typing import NamedTuple

from numba.cpython.unsafe.tuple import tuple_setitem

from ca_model.kernel.bits import ALL, EMPTY, NOWHERE, ONE, Whole, Word, bit_of, lowest
from ca_model.kernel.compiled import inlined
from ca_model.kernel.log import Log
from ca_model.kernel.slope import RankedRule, Slope, end, entry_at, logged, mark_places, next_place
from ca_model.kernel.vectors import (
    PLACES,
    Bytes,
    below,
    choose,
    each,
    loaded,
    minus,
    plus,
    splat,
    store,
)
from experiment.arrays import Ints

__all__ = ["FEW_RANKS", "Passage", "Queue", "fits", "pass_window"]

STEEPEST = 40
UPHILL = Word(40)  # places of the window above the first one that captures
FEW_RANKS = 4
WIDE = Word(PLACES)


class Queue(NamedTuple):
    """Packets that follow one after the other."""

    grains: Ints  # (row, rank), used up
    row: Whole  # of the first packet
    onward: Whole  # from one packet's row to the next one's: 1, or -1 as unsigned
    packets: Whole
    begin: Whole  # the place where the first one begins; those after it do so no further down
    reach: Whole  # the last place that it touches; those after it come one less far each


class Passage(NamedTuple):
    """How a queue came through the window."""

    passed: Whole  # packets that were captured as a whole
    withheld: Whole  # entry of the log where the last of them begins
    own: Whole  # and where the next one does
    goes_on: Whole  # the place from which the rest of that one goes on, or 0: it is still queueing


class Surface(NamedTuple):
    """The places of a window, a byte a place."""

    slope: Bytes
    top: Bytes
    held: Bytes  # what the packet that passes adds downhill of a place
    thresholds: tuple[Bytes, ...]  # (rank,)


@inlined
def fits(rule: RankedRule) -> bool:
    """Whether no slope that can capture lies beyond +-40, nor gets there by a capture."""
    ranks, every = Word(len(rule.ranks)), True
    for b in range(ranks):
        for a in range(ranks):
            threshold = rule.threshold[b * ranks + a]
            every &= -STEEPEST <= threshold <= STEEPEST - rule.grain_height[a]
    return every


class Touch(NamedTuple):
    """What a packet has done in the window so far."""

    surface: Surface
    length: Word  # of the log
    captured: Word  # set of places
    onward: Word  # set of places that the packet has not left behind
    contacts: int  # with the last of the places that captured


@inlined
def pass_window(pile: Slope, rule: RankedRule, log: Log, queue: Queue, withheld: Whole) -> Passage:
    """Let a queue pass a window; what is left of a packet that is not captured is pile.packet.

    The log's entries from `withheld` on are not felt uphill yet.
    """
    base = _base(pile, rule)
    last = base + WIDE - ONE
    if base != NOWHERE and queue.begin <= base and last <= queue.reach:
        surface, can_open = _opened(pile, rule, log, base, withheld)
        if can_open:
            packets = min(queue.packets, queue.reach - last + ONE)
            queue = Queue(queue.grains, queue.row, queue.onward, packets, queue.begin, queue.reach)
            if rule.contacts == 1:
                return _pass(pile, rule, log, queue, base, withheld, surface, _at_once)
            return _pass(pile, rule, log, queue, base, withheld, surface, _one_by_one)
    return Passage(EMPTY, withheld, log.length[0], EMPTY)


@inlined
def _opened(
    pile: Slope, rule: RankedRule, log: Log, base: Whole, withheld: Whole
) -> tuple[Surface, bool]:
    """The surface of the places from `base` on, and whether it fits."""
    slope, top, held = loaded(pile.slope, base), loaded(pile.top, base), splat(0)
    outside = below(slope, splat(-STEEPEST)) | below(splat(STEEPEST), slope)
    for entry in range(withheld, log.length[0]):
        downhill, a = logged(pile, log, entry)
        place = downhill - ONE - base
        if place < WIDE:
            higher = plus(held, splat(rule.grain_height[a]))
            held = choose(bit_of(place), higher, held)
            outside |= below(splat(STEEPEST), held)
        elif downhill > EMPTY:
            outside = ALL
    thresholds = each(rule.ranks, held)
    for a in range(Word(len(rule.ranks))):
        thresholds = _resurfaced(rule, thresholds, ~below(top, splat(a)), a)
    return Surface(slope, top, held, thresholds), outside == EMPTY


@inlined
def _close(pile: Slope, rule: RankedRule, base: Whole, surface: Surface) -> None:
    store(pile.slope, base, surface.slope)
    store(pile.top, base, surface.top)
    for a in range(Word(len(rule.ranks))):
        mark_places(pile, rule, base, a, below(surface.slope, surface.thresholds[a]))


@inlined
def _base(pile: Slope, rule: RankedRule) -> Whole:
    """The first place of the window about the first one that captures."""
    ends, first = end(pile), end(pile)
    for a in range(Word(len(rule.ranks))):
        first = min(first, next_place(pile, rule, a, EMPTY))
    if ends < WIDE or first == ends:
        return NOWHERE
    return min(max(first, UPHILL) - UPHILL, ends - WIDE)


@inlined
def _resurfaced(
    rule: RankedRule, thresholds: tuple[Bytes, ...], places: Whole, a: Whole
) -> tuple[Bytes, ...]:
    """The thresholds after a grain of rank a became the topmost of `places`."""
    for b in range(len(rule.ranks)):
        threshold = splat(rule.threshold[a * Word(len(rule.ranks)) + Word(b)])
        new = choose(places, threshold, thresholds[b])
        thresholds = tuple_setitem(thresholds, b, new)  # type: ignore[call-arg]  # as in bits
    return thresholds


@inlined
def _laid(rule: RankedRule, surface: Surface, places: Whole, a: Whole) -> Surface:
    """The surface after a grain of rank a came to rest on each of `places`."""
    height = splat(rule.grain_height[a])
    return Surface(
        choose(places, plus(surface.slope, height), surface.slope),
        choose(places, splat(a), surface.top),
        choose(places >> ONE, plus(surface.held, height), surface.held),
        _resurfaced(rule, surface.thresholds, places, a),
    )


@inlined
def _pass(
    pile: Slope,
    rule: RankedRule,
    log: Log,
    queue: Queue,
    base: Whole,
    withheld: Whole,
    surface: Surface,
    lay: Callable[..., tuple[Touch, int]],
) -> Passage:
    """Let packets pass the open window until one does not fit, then close it."""
    edge, least = Word(base > EMPTY), splat(-STEEPEST)
    row, passed, goes_on = queue.row, EMPTY, EMPTY
    own = length = log.length[0]
    while passed < queue.packets:
        fresh = Surface(surface.slope, surface.top, splat(0), surface.thresholds)
        touch = Touch(fresh, length, EMPTY, ALL, 0)
        is_whole = True
        for a in range(Word(len(rule.ranks))):
            touch, left = lay(pile, rule, log, base, touch, fresh, queue.grains[row, a], a)
            queue.grains[row, a] = 0
            pile.packet[a] = left
            if left > 0:
                touch = Touch(touch.surface, touch.length, touch.captured, EMPTY, 0)
                is_whole = False
        own, length = length, touch.length
        held, surface = surface.held, touch.surface
        if not is_whole:
            goes_on = base + WIDE
            break
        surface = Surface(minus(surface.slope, held), surface.top, surface.held, surface.thresholds)
        withheld, own = own, length
        passed += ONE
        row += queue.onward
        if touch.captured & edge != EMPTY or below(surface.slope, least) != EMPTY:
            break
    log.length[0] = length
    _close(pile, rule, base, surface)
    return Passage(passed, withheld, own, goes_on)


@inlined
def _at_once(
    pile: Slope,
    rule: RankedRule,
    log: Log,
    base: Whole,
    touch: Touch,
    before: Surface,
    left: int,
    a: Whole,
) -> tuple[Touch, int]:
    """Lay grains of rank a where the surface from `before` the packet captures, one a place."""
    places = below(before.slope, before.thresholds[a]) & touch.onward
    taken, bit, length = EMPTY, EMPTY, touch.length
    while left > 0 and places != EMPTY:
        bit = places & (~places + ONE)
        places ^= bit
        taken |= bit
        log.grains[length] = entry_at(pile, base + lowest(bit), a)
        length += ONE
        left -= 1
    surface = _laid(rule, touch.surface, taken, a)
    onward = ~((bit << ONE) - ONE) if bit != EMPTY else touch.onward
    return Touch(surface, length, touch.captured | taken, onward, 0), left


@inlined
def _one_by_one(
    pile: Slope,
    rule: RankedRule,
    log: Log,
    base: Whole,
    touch: Touch,
    before: Surface,  # noqa: ARG001
    left: int,
    a: Whole,
) -> tuple[Touch, int]:
    """Lay grains of rank a each on the surface that the last one left."""
    places = below(touch.surface.slope, touch.surface.thresholds[a]) & touch.onward
    while left > 0 and places != EMPTY:
        bit = places & (~places + ONE)
        contacts = touch.contacts + 1 if touch.captured & bit != EMPTY else 1
        onward = ~(bit - ONE) if contacts < rule.contacts else ~((bit << ONE) - ONE)
        log.grains[touch.length] = entry_at(pile, base + lowest(bit), a)
        surface = _laid(rule, touch.surface, bit, a)
        touch = Touch(surface, touch.length + ONE, touch.captured | bit, onward, contacts)
        places = below(surface.slope, surface.thresholds[a]) & onward
        left -= 1
    return touch, left
