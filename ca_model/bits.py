"""Sets of numbers as bits, 64 a word, and a summary of them: a bit for each word in use.

The summary may say that a word is in use though it is empty; whoever finds it so clears the bit.
All numbers are unsigned 64-bit integers: no index of one can count from the end of an array.
"""

import numpy as np
from numba.cpython.unsafe.numbers import trailing_zeros

from ca_model.compiled import inlined

__all__ = [
    "EMPTY",
    "ONE",
    "Word",
    "bit_of",
    "lowest",
    "place_in_word",
    "window",
    "without_lowest",
    "word_of",
]

Word = np.uint64

EMPTY, ONE, SIX, LAST = Word(0), Word(1), Word(6), Word(63)


@inlined
def word_of(k: Word) -> Word:
    """The word that number k lies in."""
    return k >> SIX


@inlined
def place_in_word(k: Word) -> Word:
    """The place of number k in its word."""
    return k & LAST


@inlined
def bit_of(k: Word) -> Word:
    """The word that holds number k only."""
    return ONE << (k & LAST)


@inlined
def lowest(word: Word) -> Word:
    """The lowest place that is taken in a word that is not empty."""
    return Word(trailing_zeros(word))  # type: ignore[call-arg]  # numba passes the context


@inlined
def without_lowest(word: Word) -> Word:
    """A word that is not empty, less its lowest member."""
    return word & (word - ONE)


@inlined
def window(low: Word, high: Word, shift: Word) -> Word:
    """The 64 places from `shift` on of two neighbouring words."""
    return (low >> shift) | ((high << ONE) << (LAST - shift))
