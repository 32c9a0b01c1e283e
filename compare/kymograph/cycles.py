"""What lines have in common: the time between them, and their velocity."""

from typing import NamedTuple

import numpy as np
import scipy
import xarray as xr

from experiment.arrays import Floats

__all__ = ["Seen", "cycle_period", "intervals", "mean_velocity", "median", "median_and_error"]

EFFICIENCY = np.sqrt(np.pi / 2)  # standard error of a median, over that of a mean
MANY = 10  # values, from which on their scatter is told robustly


class Seen(NamedTuple):
    """Lines in the measured columns, NaN where one was not seen or its velocity is not told."""

    passage: Floats  # (line, x) [s]
    velocity: Floats  # (line,) [cm/s]
    velocity_error: Floats  # (line,) [cm/s]
    least: float  # s, standard error of a passage at best
    aliased: bool  # whether cycles seem slower than they are

    def period(self) -> tuple[float, float]:
        """As :func:`cycle_period`."""
        if self.aliased:
            return np.nan, np.nan
        between, columns = intervals(self.passage)
        return median_and_error(between, np.full(len(between), self.least), columns)

    def mean_velocity(self) -> tuple[float, float]:
        """As :func:`mean_velocity`."""
        columns, told = np.isfinite(self.passage).sum(axis=1), np.isfinite(self.velocity)
        return median_and_error(self.velocity[told], self.velocity_error[told], columns[told])


def cycle_period(lines: xr.Dataset) -> tuple[float, float]:
    """T [s] between successive lines, and its standard error; NaN for fewer than two of them.

    NaN, too, where the records are aliased. The median over measured columns and cycles, so that a
    line that was missed, or that does not go all the way, does not count where it was not seen.
    """
    return _seen(lines).period()


def mean_velocity(lines: xr.Dataset) -> tuple[float, float]:
    """Median velocity [cm/s] of the lines, and its standard error; NaN where none is told.

    A line weighs as much as the length on which it was seen in the measured columns.
    """
    return _seen(lines).mean_velocity()


def _seen(lines: xr.Dataset) -> Seen:
    return Seen(
        lines["passage"].values[:, lines["measured"].values],
        lines["velocity"].values,
        lines["velocity_error"].values,
        lines.attrs["sampling_s"],
        bool(lines.attrs["aliased"]),
    )


def median_and_error(values: Floats, errors: Floats, weights: Floats) -> tuple[float, float]:
    """Median of independent values, and its standard error from their scatter or own errors.

    As many count as equal weights would make as certain, n = (sum w)^2 / sum w^2. The scatter of
    MANY is 1.48 times the median deviation; that of fewer the standard deviation, times Student's
    factor for what n - 1 degrees of freedom leave open; of one nothing but its own error is known.
    """
    if len(values) < 2:
        return (float(values[0]), float(errors[0])) if len(values) else (np.nan, np.nan)
    middle = median(values, weights)
    n = float(weights.sum() ** 2 / (weights**2).sum())
    if n < MANY:
        student = scipy.special.stdtrit(max(n - 1.0, 1.0), float(scipy.special.ndtr(1.0)))
        scatter = float(student * np.sqrt(np.cov(values, aweights=weights)))
    else:
        scatter = 1.4826 * median(np.abs(values - middle), weights)
    return middle, float(EFFICIENCY * max(scatter, median(errors, weights)) / np.sqrt(n))


def median(values: Floats, weights: Floats) -> float:
    """Where half of the weight is passed, interpolated between `values`; NaN of none."""
    if not len(values):
        return np.nan
    order = np.argsort(values)
    passed = np.cumsum(weights[order]) - weights[order] / 2
    return float(np.interp(weights.sum() / 2, passed, values[order]))


def intervals(passage: Floats) -> tuple[Floats, Floats]:
    """Times [s] since the line before, of all lines (line, x) that have one; and their weights.

    The mean over the columns where there is one, whose number is the weight.
    """
    last = np.full(passage.shape[1], np.nan)
    found: list[tuple[float, float]] = []
    for line in passage:
        since = (line - last)[np.isfinite(line) & np.isfinite(last)]
        if len(since):
            found.append((since.mean(), len(since)))
        last = np.where(np.isfinite(line), line, last)
    between, columns = np.array(found).reshape(-1, 2).T
    return between, columns
