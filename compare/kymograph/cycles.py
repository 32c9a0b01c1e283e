"""What lines have in common: the time between them, and their velocity."""

import numpy as np
import xarray as xr

from experiment.arrays import Floats

__all__ = ["cycle_period", "intervals", "mean_velocity", "median_and_error"]

EFFICIENCY = np.sqrt(np.pi / 2)  # standard error of a median, over that of a mean


def cycle_period(lines: xr.Dataset) -> tuple[float, float]:
    """T [s] between successive lines, and its standard error; NaN for fewer than two of them.

    NaN, too, where the records are aliased. The median over measured columns and cycles, so that a
    line that was missed, or that does not go all the way, does not count where it was not seen.
    """
    passage = lines["passage"].values[:, lines["measured"].values]
    between = intervals(passage)
    if not len(between) or lines.attrs["aliased"]:
        return np.nan, np.nan
    cycles = len(between) / passage.shape[1]
    _, error = median_and_error(between, np.full(len(between), lines.attrs["sampling_s"]))
    return float(np.median(between)), error * np.sqrt(len(between) / max(cycles, 1.0))


def mean_velocity(lines: xr.Dataset) -> tuple[float, float]:
    """Median velocity [cm/s] of the lines, and its standard error; NaN where none is told."""
    told = np.isfinite(lines["velocity"].values)
    return median_and_error(lines["velocity"].values[told], lines["velocity_error"].values[told])


def median_and_error(values: Floats, errors: Floats) -> tuple[float, float]:
    """Median of independent values, and its standard error from their scatter and own errors."""
    if not len(values):
        return np.nan, np.nan
    middle = float(np.median(values))
    scatter = 1.4826 * float(np.median(np.abs(values - middle)))
    own = float(np.median(errors))
    return middle, float(EFFICIENCY * np.hypot(scatter, own) / np.sqrt(len(values)))


def intervals(passage: Floats) -> Floats:
    """Times [s] since the line before, of all lines in all columns (line, x) where there is one.

    Of each line the mean over its columns, once for each of them.
    """
    last = np.full(passage.shape[1], np.nan)
    found = [np.zeros(0)]
    for line in passage:
        since = (line - last)[np.isfinite(line) & np.isfinite(last)]
        if len(since):
            found.append(np.full(len(since), since.mean()))
        last = np.where(np.isfinite(line), line, last)
    return np.concatenate(found)
