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

from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from compare.deposit.kernel import extent, highest_near, summit
from experiment.arrays import Floats

__all__ = ["Correlation", "Repeat", "Repeats", "Transform", "correlate", "transform"]

AS_HIGH_AS = 0.8  # of the highest peak
WEAKEST = 0.1  # strength that still counts as a layering
FEWEST_TERMS = 1 / 3  # of those at lag 0, for a lag to be looked at
NEAR = 0.3  # how far from the mean wavelength that of a single column may be


class Repeat(NamedTuple):
    """The lag, in cells of the deposit, at which a pattern repeats, and the strength of it."""

    lag: float  # NaN where nothing repeats
    strength: float


NOTHING = Repeat(np.nan, 0.0)


class Repeats(NamedTuple):
    """The repeat in each of several columns, (x,)."""

    lag: Floats
    strength: Floats


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
        a, share = self._normalized()
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
        repeat = Repeat(float(summit(a, chosen)), strength)
        return repeat if strength >= WEAKEST and repeat.lag >= shortest else NOTHING

    def repeats_near(self, lag: float) -> Repeats:
        """As :meth:`repeat`, but of each column, and the highest peak near `lag`."""
        place, height = highest_near(self.sums, self.terms, FEWEST_TERMS, lag, NEAR * lag)
        return Repeats(place, 2.0 * np.sqrt(height))

    def _normalized(self) -> tuple[Floats, Floats]:
        """Of a single column A(lag) and the share of the terms, at lags that leave enough."""
        sums, terms = self.sums[:, 0], self.terms[:, 0]
        if not terms[0]:
            return np.zeros(0), np.zeros(0)
        share = terms / terms[0]
        kept = int(np.argmax(np.append(share, 0.0) < FEWEST_TERMS))
        return sums[:kept] / terms[:kept], share[:kept]


class Transform(NamedTuple):
    """The transform of c' in each column, by which columns are correlated."""

    spectrum: NDArray[np.complexfloating[Any]]  # (x, frequency)
    terms: Floats  # (lag, x)

    def with_itself(self) -> Correlation:
        """Each column correlated with itself."""
        sums = _back(np.abs(self.spectrum) ** 2, len(self.terms))
        return Correlation(sums[: len(self.terms)], self.terms)

    def between(self, apart: int) -> Floats:
        """sum_z c'(x, z) c'(x + apart, z + lag) of columns so far `apart`, (lag, x - apart).

        Lags below 0 are counted from the end.
        """
        product = np.conj(self.spectrum[:-apart]) * self.spectrum[apart:]
        return _back(product, len(self.terms))


def transform(coarse: Floats) -> Transform:
    """That of the columns of `coarse` (z, x), NaN outside of the deposit."""
    inside = np.isfinite(coarse)
    number = inside.sum(axis=0)
    mean = np.where(inside, coarse, 0.0).sum(axis=0) / np.maximum(number, 1)
    terms = np.maximum(number - np.arange(len(coarse))[:, None], 0.0)
    begin, end = extent(coarse, np.zeros_like(number))
    gaps = end - begin > number
    if gaps.any():
        spectrum = _forth(inside[:, gaps].astype(np.float64))
        terms[:, gaps] = np.round(_back(np.abs(spectrum) ** 2, len(coarse)))[: len(coarse)]
    return Transform(_forth(np.where(inside, coarse - mean, 0.0)), terms)


def correlate(coarse: Floats) -> Correlation:
    """Each column of `coarse` (z, x), NaN outside of the deposit, correlated with itself."""
    return transform(coarse).with_itself()


def _forth(values: Floats) -> NDArray[np.complexfloating[Any]]:
    """Of columns (z, x), so long that they do not meet their own ends; (x, frequency)."""
    rows, columns = values.shape
    longer = np.zeros((columns, _size(rows)))
    longer[:, :rows] = values.T
    return np.asarray(scipy.fft.rfft(longer))


def _back(spectrum: NDArray[Any], rows: int) -> Floats:
    """Back to (lag, x), from columns of so many `rows`."""
    values: Floats = scipy.fft.irfft(spectrum, _size(rows))
    return values.T


def _size(rows: int) -> int:
    return int(scipy.fft.next_fast_len(2 * rows, real=True))
