"""Sets of numbers as bits, 64 a word.

All numbers are unsigned 64-bit integers: no index of one can count from the end of an array.
"""

import numpy as np
from numba.cpython.unsafe.numbers import trailing_zeros

from ca_model.kernel.compiled import inlined

__all__ = [
    "ALL",
    "EMPTY",
    "NOWHERE",
    "ONE",
    "Whole",
    "Word",
    "bit_of",
    "lowest",
    "place_in_word",
    "word_count",
    "word_of",
]

Word = np.uint64
Whole = int | np.uint64  # an unsigned integer, which a range makes ints of before it is compiled

EMPTY, ALL, ONE, SIX, LAST = Word(0), Word(2**64 - 1), Word(1), Word(6), Word(63)
NOWHERE = Word(2**63)  # beyond every number in a set


def word_count(numbers: int) -> int:
    """How many words a set of the numbers below `numbers` takes."""
    return -(-numbers // 64)


@inlined
def word_of(k: Whole) -> Whole:
    """The word that number k lies in."""
    return k >> SIX


@inlined
def place_in_word(k: Whole) -> Whole:
    """The place of number k in its word."""
    return k & LAST


@inlined
def bit_of(k: Whole) -> Whole:
    """The word that holds number k only."""
    return ONE << (k & LAST)


@inlined
def lowest(word: Whole) -> Whole:
    """The lowest place that is taken in a word that is not empty."""
    return Word(trailing_zeros(word))  # type: ignore[call-arg]  # numba passes the context
