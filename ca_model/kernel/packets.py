"""The lattice rule of :mod:`ca_model.reference`, a packet of grains after the other.

What enters in one step rolls together, one column a step: a packet. Here each packet is followed on
its way before the next, which is the same pour. In column i packet k meets what all packets before
it left there; but of its downhill neighbour i + 1 it must see the height from before the step, when
packet k - 1 had not touched i + 1 yet. So what a packet adds to a column is withheld from the slope
of the uphill neighbour until the next packet has passed.

The columns that would capture a species are bits of a set, so the next one on a packet's way is
found by counting zeros: a packet costs its captures, not the length of its way. Most packets do
not even come here: they are captured in a window of :mod:`ca_model.kernel.window`.
"""

from numba import njit

from ca_model.kernel.bits import EMPTY, NOWHERE, ONE, Whole, Word, bit_of
from ca_model.kernel.compiled import UNCOUNTED, inlined
from ca_model.kernel.log import Log
from ca_model.kernel.slope import (
    RankedRule,
    Slope,
    capture,
    end,
    is_captured,
    mark,
    next_place,
    show_uphill,
)
from ca_model.kernel.window import FEW_RANKS, Queue, fits, pass_window
from experiment.arrays import Ints

__all__ = ["follow_packets"]

BACKWARD = Word(2**64 - 1)  # -1, from one row to the next
WORTH_IT, LONGEST_PAUSE = Word(8), Word(64)  # packets


@njit(cache=True, nogil=True, **UNCOUNTED)
def follow_packets(pile: Slope, rule: RankedRule, log: Log, arrivals: Ints) -> int:
    """Advance `pile` by one step per row of `arrivals` (step, rank), which are used up.

    The log must have room for all grains that roll or arrive. Returns how many packets were
    captured in windows.
    """
    packets = Word(pile.slope.size) + Word(arrivals.shape[0])
    has_windows = rule.percolation and len(rule.ranks) <= FEW_RANKS and fits(rule)
    withheld, pause, next_try, in_windows = log.length[0], ONE, EMPTY, EMPTY
    k = EMPTY if arrivals.shape[0] > 0 else packets
    while k < packets:
        queue = _queue(pile, arrivals, k)
        begin, reach, own, is_taken_up = queue.begin, queue.reach, log.length[0], False
        if has_windows and k >= next_try:
            passage = pass_window(pile, rule, log, queue, withheld)
            withheld, own = passage.withheld, passage.own
            pause = ONE if passage.passed > WORTH_IT else min(LONGEST_PAUSE, pause + pause)
            k += passage.passed
            in_windows += passage.passed
            next_try = k + pause
            is_taken_up = bool(passage.goes_on > EMPTY)
            if is_taken_up:
                begin, reach = passage.goes_on, reach - passage.passed
            elif passage.passed > EMPTY:
                continue
        if is_taken_up or _take_up(pile, rule, queue):
            if rule.percolation:
                _follow(pile, rule, log, begin, reach)
            else:
                _follow_in_turns(pile, rule, log, begin, reach)
        show_uphill(pile, rule, log, withheld, own)
        withheld = own
        k += ONE
    show_uphill(pile, rule, log, withheld, log.length[0])
    return int(in_windows)


@inlined
def _queue(pile: Slope, arrivals: Ints, k: Whole) -> Queue:
    """Packet k and those behind it: first those that roll already, the lowest first."""
    places, steps = Word(pile.slope.size), Word(arrivals.shape[0])
    reach = places - ONE - k + steps
    if k < places:
        return Queue(pile.rolling, places - ONE - k, BACKWARD, places - k, places - k, reach)
    return Queue(arrivals, k - places, ONE, places + steps - k, EMPTY, reach)


@inlined
def _take_up(pile: Slope, rule: RankedRule, queue: Queue) -> bool:
    """Make the first of the queue the packet that is followed; says whether it has grains."""
    has_grains = False
    for a in range(Word(len(rule.ranks))):
        pile.packet[a] = queue.grains[queue.row, a]
        has_grains = has_grains or pile.packet[a] > 0
        queue.grains[queue.row, a] = 0
    return has_grains


@inlined
def _follow(pile: Slope, rule: RankedRule, log: Log, begin: Whole, reach: Whole) -> None:
    """Let the packet touch the surface from place `begin` to `reach`, where it goes on rolling."""
    i, touches = begin, 0
    for a in range(Word(len(rule.ranks))):
        left = pile.packet[a]
        while left > 0:
            place = next_place(pile, rule, a, i)
            if place > reach:
                _roll_on(pile, rule, reach, a, left)
                return
            if place > i:
                i, touches = place, 0
            if place == end(pile):
                _come_to_the_end(pile, rule, log, a, left)
                break
            capture(pile, rule, log, i, a)
            mark(pile, rule, i)
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
    while i <= reach and i < end(pile):
        turns, touches = _present(pile, rule), 0
        while touches < rule.contacts and turns != EMPTY:
            for a in range(ranks):
                if turns & bit_of(a) != EMPTY:
                    captured = is_captured(pile, rule, i, a)
                    if captured:
                        pile.packet[a] -= 1
                        capture(pile, rule, log, i, a)
                    if not captured or pile.packet[a] == 0:
                        turns &= ~bit_of(a)
            touches += 1
        mark(pile, rule, i)
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
            capture(pile, rule, log, end(pile), a)
    else:
        pile.outflow[a] += count


@inlined
def _present(pile: Slope, rule: RankedRule) -> Whole:
    """The set of ranks in the packet."""
    present = EMPTY
    for a in range(Word(len(rule.ranks))):
        present |= Word(pile.packet[a] > 0) << a
    return present


@inlined
def _next_of_any(pile: Slope, rule: RankedRule, i: Whole) -> Whole:
    """The first place from i on that captures any rank of the packet; at the latest the end."""
    nearest = NOWHERE
    for a in range(Word(len(rule.ranks))):
        if pile.packet[a] > 0:
            nearest = min(nearest, Word(next_place(pile, rule, a, i)))
    return nearest
