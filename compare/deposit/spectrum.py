"""The wavelength by spectrum: the lag at which the deposit repeats itself along the vertical.

The coarseness c(z) of each column is correlated with itself,

    A(lag) = sum c'(z) c'(z + lag) / (number of terms),        c' = c - <c> in its column,

which is its power spectrum, transformed; sums and numbers run over all columns together, so that
a thin one counts for what it has. A cycle may lay more than one pair of layers, so the wavelength
is not the first peak but the shortest lag whose peak comes close to the highest one: the lag at
which the whole pattern repeats. Each peak counts by the share of the terms that its lag leaves: of
irregular layers, a peak of which little is left may be high by chance. The strength of the layering
is the amplitude of what repeats, 2 sqrt(A(wavelength)): 1 for equal layers of pure small and pure
large grains.
"""

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from experiment.arrays import Floats

__all__ = ["Correlation", "Repeat", "correlate"]

AS_HIGH_AS = 0.8  # of the highest peak
WEAKEST = 0.1  # strength that still counts as a layering
FEWEST_TERMS = 1 / 3  # of those at lag 0, for a lag to be looked at
NEAR = 0.3  # how far from the mean wavelength that of a single column may be


class Repeat(NamedTuple):
    """The lag, in cells of the deposit, at which a pattern repeats, and the strength of it."""

    lag: float  # NaN where nothing repeats
    strength: float


NOTHING = Repeat(np.nan, 0.0)


class Correlation(NamedTuple):
    """Sums of c'(z) c'(z + lag) and their numbers of terms, each (lag, x)."""

    sums: Floats
    terms: Floats

    def pooled(self, columns: NDArray[np.bool_]) -> "Correlation":
        """That of the chosen `columns` (x,) together, as one column."""
        return Correlation(*(part[:, columns].sum(1, keepdims=True) for part in self))

    def neighbourly(self, width: int) -> "Correlation":
        """That of each column together with its neighbours, `width` columns in all."""

        def smooth(values: Floats) -> Floats:
            filtered: Floats = scipy.ndimage.uniform_filter1d(values, width, axis=1, mode="nearest")
            return filtered

        return Correlation(smooth(self.sums), smooth(self.terms))

    def repeat(self, shortest: float = 0.0) -> Repeat:
        """Of a single column: where it repeats, unless that is below the `shortest` lag."""
        a, share = self._normalized(0)
        negative = np.flatnonzero(a < 0)
        if not len(negative):
            return NOTHING
        first = int(negative[0])
        peaks = first + scipy.signal.find_peaks(a[first:])[0]
        counted = a[peaks] * share[peaks]
        if not len(peaks) or counted.max() <= 0:
            return NOTHING
        chosen = int(peaks[counted >= AS_HIGH_AS * counted.max()][0])
        strength = float(2.0 * np.sqrt(a[chosen]))
        repeat = Repeat(_summit(a, chosen), strength)
        return repeat if strength >= WEAKEST and repeat.lag >= shortest else NOTHING

    def repeat_near(self, lag: float, column: int) -> Repeat:
        """As :meth:`repeat`, but the highest peak near `lag`."""
        a, _ = self._normalized(column)
        peaks = scipy.signal.find_peaks(a)[0]
        near = peaks[np.abs(peaks - lag) < NEAR * lag]
        if not len(near) or a[near].max() <= 0:
            return NOTHING
        chosen = int(near[a[near].argmax()])
        return Repeat(_summit(a, chosen), float(2.0 * np.sqrt(a[chosen])))

    def _normalized(self, column: int) -> tuple[Floats, Floats]:
        """A(lag) and the share of the terms, at the lags that leave enough of them."""
        terms = self.terms[:, column]
        if not terms[0]:
            return np.zeros(0), np.zeros(0)
        share = terms / terms[0]
        kept = int(np.argmax(np.append(share, 0.0) < FEWEST_TERMS))
        return self.sums[:kept, column] / terms[:kept], share[:kept]


def correlate(coarse: Floats) -> Correlation:
    """Each column of `coarse` (z, x), NaN outside of the deposit, correlated with itself."""
    inside = np.isfinite(coarse)
    number = inside.sum(axis=0)
    mean = np.where(inside, coarse, 0.0).sum(axis=0) / np.maximum(number, 1)
    varying = np.where(inside, coarse - mean, 0.0)
    return Correlation(_with_itself(varying), np.round(_with_itself(inside.astype(np.float64))))


def _with_itself(values: Floats) -> Floats:
    """sum_z values(z) values(z + lag) of each column, (lag, x)."""
    n = len(values)
    size = scipy.fft.next_fast_len(2 * n, real=True)
    spectrum = scipy.fft.rfft(values, size, axis=0)
    sums: Floats = scipy.fft.irfft(np.abs(spectrum) ** 2, size, axis=0)[:n]
    return sums


def _summit(values: Floats, k: int) -> float:
    """Place of the maximum of the parabola through three neighbouring values."""
    left, middle, right = values[k - 1 : k + 2]
    bend = left - 2 * middle + right
    return float(k + 0.5 * (left - right) / bend) if bend < 0 else float(k)
