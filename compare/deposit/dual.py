"""Two wavelengths on one slope: short above, long below, or the reverse (dual stratification).

Where a second kink is born part-way up the slope (Shimokawa and Ohta, Phys. Lett. A 366, 591
(2007)), more layers are laid above its birth place than below. The wavelength in place is then two
plateaus and a step; one drift over the whole slope is another thing. So the step must explain the
wavelengths better than a straight line does, and be large.
"""

from typing import NamedTuple

import numpy as np

from compare.deposit.kernel import squares_of_first
from experiment.arrays import Floats

__all__ = ["Plateaus", "plateaus"]

STEP = 1.3  # ratio of the longer to the shorter wavelength
SHORTEST = 1 / 6  # of the columns, a plateau
BETTER = 0.5  # squares that the step leaves, over those that a straight line leaves


class Plateaus(NamedTuple):
    """Wavelength above and below the step, and where it is [cm]; NaN for one wavelength."""

    upper: float
    lower: float
    x: float


ONE = Plateaus(np.nan, np.nan, np.nan)


def plateaus(wavelength: Floats, x: Floats) -> Plateaus:
    """The two plateaus of `wavelength` (x,), NaN in columns that tell none."""
    there = np.isfinite(wavelength)
    values, at = wavelength[there], x[there]
    n = len(values)
    shortest = max(3, int(n * SHORTEST))
    if n < 2 * shortest + 1:
        return ONE
    above, below = squares_of_first(values), squares_of_first(values[::-1])[::-1]
    left = above[shortest - 1 : n - shortest - 1] + below[shortest : n - shortest]
    k = shortest + int(left.argmin())
    line = np.polynomial.Polynomial.fit(at, values, 1)
    straight = float(((values - line(at)) ** 2).sum())
    upper, lower = float(np.median(values[:k])), float(np.median(values[k:]))
    ratio = max(upper, lower) / min(upper, lower)
    if ratio < STEP or left.min() > BETTER * straight:
        return ONE
    return Plateaus(upper, lower, float((at[k - 1] + at[k]) / 2))
