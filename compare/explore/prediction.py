"""Predict, then run: what somebody expects, held against what each model laid.

A pile with layers on a part of it whose grains lie apart on the rest, layered-and-segregated, is
both: who said either was right. A wavelength is right within a fifth.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

from compare.explore.pours import Numbers
from compare.regimes import LAYERED_REGIMES

__all__ = ["PATTERNS", "Guess", "Try", "Verdict", "judge", "score"]

PATTERNS = {
    "layers": LAYERED_REGIMES,
    "segregated": ("segregated", "layered-and-segregated"),
    "mixed": ("mixed",),
}
WITHIN = 0.2


class Guess(NamedTuple):
    """What somebody expects: one of PATTERNS, and of layers the wavelength [cm], or NaN."""

    pattern: str
    wavelength: float = math.nan


class Verdict(NamedTuple):
    """How a guess stands beside what one model laid."""

    guess: Guess
    found: Numbers
    pattern: bool
    wavelength: bool | None  # None: there was none to be right about

    @property
    def points(self) -> int:
        """One for the pattern, one for the wavelength."""
        return int(self.pattern) + int(self.wavelength is True)

    @property
    def possible(self) -> int:
        """How many points there were; none where a pile has not told by its end what it is."""
        if self.found.regime == "unsettled":
            return 0
        return 1 + int(self.wavelength is not None)


class Try(NamedTuple):
    """A guess, what it was about, and its verdict for each model."""

    delta: float
    guess: Guess
    verdicts: dict[str, Verdict]


def judge(guess: Guess, found: Mapping[str, Numbers]) -> dict[str, Verdict]:
    """Hold a guess against the numbers of each model's pile."""
    return {model: _verdict(guess, numbers) for model, numbers in found.items()}


def score(tries: list[Try]) -> tuple[int, int]:
    """Points of all tries, and how many there could have been."""
    verdicts = [verdict for one in tries for verdict in one.verdicts.values()]
    return sum(one.points for one in verdicts), sum(one.possible for one in verdicts)


def _verdict(guess: Guess, found: Numbers) -> Verdict:
    pattern = found.regime in PATTERNS[guess.pattern]
    told = guess.pattern == "layers" and math.isfinite(guess.wavelength)
    if not (pattern and told and math.isfinite(found.wavelength)):
        return Verdict(guess, found, pattern, None)
    near = abs(guess.wavelength - found.wavelength) <= WITHIN * found.wavelength
    return Verdict(guess, found, pattern, near)
