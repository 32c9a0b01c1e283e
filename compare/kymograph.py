"""Fronts and kinks: lines in the kymograph R(t, x) of the rolling grains.

At a place x the flow sets in when an avalanche front comes down (R rises through ON R0) and stops
when a kink comes up (R falls through OFF R0). Events of neighbouring places that are each other's
nearest in time belong to one line; a line that crosses most of the measured columns is an event of
the pour. Its velocity is 1 / (dt/dx), by the Theil-Sen median of slopes.
"""

import numpy as np
import scipy
import xarray as xr

from compare.quantities import measured_columns, settled_since, total_inflow
from experiment.arrays import Floats

__all__ = ["cycle_period", "fronts", "kinks", "mean_velocity"]


ON, OFF = 0.3, 0.15  # of R0
SMOOTHED = 5  # records and columns over which R is averaged
WHOLE_LINE = 0.75  # of the measured columns
FEWEST_COLUMNS = 3  # that make a line
EFFICIENCY = np.sqrt(np.pi / 2)  # standard error of a median, over that of a mean


def kinks(archive: xr.Dataset) -> xr.Dataset:
    """Kinks, where the flow stops: lines that go uphill.

    A Dataset over `event` and `x` (the measured columns): passage(event, x) [s], NaN where the
    line has a gap; time(event) [s] at the middle column; velocity and velocity_error(event) [cm/s],
    uphill negative.
    """
    return _lines(archive, rising=False)


def fronts(archive: xr.Dataset) -> xr.Dataset:
    """Avalanche fronts, where the flow sets in: lines that go downhill. As :func:`kinks`."""
    return _lines(archive, rising=True)


def cycle_period(lines: xr.Dataset) -> tuple[float, float]:
    """T [s] between successive lines, and its standard error; NaN for fewer than two of them.

    The median over the cycles, so that a line that was missed does not count.
    """
    periods = lines["passage"].diff("event").mean("x").values
    return median_and_error(periods, np.full(len(periods), lines.attrs["sampling_s"]))


def mean_velocity(lines: xr.Dataset) -> tuple[float, float]:
    """Median velocity [cm/s] of the lines, and its standard error; NaN where there is no line."""
    return median_and_error(lines["velocity"].values, lines["velocity_error"].values)


def median_and_error(values: Floats, errors: Floats) -> tuple[float, float]:
    """Median of independent values, and its standard error from their scatter and own errors."""
    if not len(values):
        return np.nan, np.nan
    middle = float(np.median(values))
    scatter = 1.4826 * float(np.median(np.abs(values - middle)))
    own = float(np.median(errors))
    return middle, float(EFFICIENCY * np.hypot(scatter, own) / np.sqrt(len(values)))


def _lines(archive: xr.Dataset, *, rising: bool) -> xr.Dataset:
    columns = measured_columns(archive)
    x = archive["x"].values[columns]
    times = _passages(archive, rising=rising)
    sampling = float(np.median(np.diff(archive["time"].values))) / np.sqrt(12.0)
    enough = max(WHOLE_LINE * len(x), FEWEST_COLUMNS)
    lines = [line for line in _link(times) if np.isfinite(line).sum() >= enough]
    passages = np.array(lines).reshape(len(lines), len(x))
    fits = np.array([_velocity(x, line, sampling) for line in passages]).reshape(len(lines), 3)
    velocity, middle = fits[:, 0], fits[:, 2]
    kept = (velocity > 0 if rising else velocity < 0) & (middle > settled_since(archive))
    order = np.argsort(fits[kept, 2])
    passages, fits = passages[kept][order], fits[kept][order]
    return xr.Dataset(
        {
            "passage": (("event", "x"), passages, {"units": "s", "long_name": "time of passage"}),
            "velocity": ("event", fits[:, 0], {"units": "cm s-1", "long_name": "velocity of line"}),
            "velocity_error": (
                "event",
                fits[:, 1],
                {"units": "cm s-1", "long_name": "standard error of velocity of line"},
            ),
            "time": ("event", fits[:, 2], {"units": "s", "long_name": "time at the middle column"}),
        },
        {"x": ("x", x, dict(archive["x"].attrs))},
        {"sampling_s": sampling},
    )


def _passages(archive: xr.Dataset, *, rising: bool) -> list[Floats]:
    """At each measured column the times at which the flow sets in (or stops)."""
    thickness = archive["rolling_thickness"].sum("species").values
    smooth = scipy.ndimage.uniform_filter(thickness, SMOOTHED, mode="nearest")
    scale = total_inflow(archive)
    time = archive["time"].values
    columns = np.flatnonzero(measured_columns(archive))
    return [_crossings(time, smooth[:, i] / scale, rising=rising) for i in columns]


def _crossings(time: Floats, flow: Floats, *, rising: bool) -> Floats:
    """Times at which `flow` (time,) rises through ON after it was below OFF, or the reverse."""
    known = np.where(flow > ON, 1, np.where(flow < OFF, 0, -1))
    last_known = np.maximum.accumulate(np.where(known >= 0, np.arange(len(known)), 0))
    state = np.maximum(known[last_known], 0)
    after = np.flatnonzero(np.diff(state) == (1 if rising else -1)) + 1
    level = ON if rising else OFF
    before = after - 1
    share = (level - flow[before]) / (flow[after] - flow[before])
    crossed: Floats = time[before] + share * (time[after] - time[before])
    return crossed


def _link(times: list[Floats]) -> list[Floats]:
    """Lines through events of neighbouring columns, each an array (column,) with NaN for gaps."""
    spacing = [np.diff(column).mean() for column in times if len(column) > 1]
    reach = np.median(spacing) / 3 if spacing else np.inf
    open_lines: list[Floats] = []
    for i, column in enumerate(times):
        ends = np.array([line[np.isfinite(line)][-1] for line in open_lines])
        taken = np.zeros(len(column), dtype=bool)
        if len(ends) and len(column):
            distance = np.abs(ends[:, None] - column[None, :])
            for k, line in enumerate(open_lines):
                nearest = int(distance[k].argmin())
                mutual = int(distance[:, nearest].argmin()) == k
                if mutual and distance[k, nearest] < reach:
                    line[i] = column[nearest]
                    taken[nearest] = True
        for start in column[~taken]:
            line = np.full(len(times), np.nan)
            line[i] = start
            open_lines.append(line)
    return open_lines


def _velocity(x: Floats, line: Floats, sampling: float) -> tuple[float, float, float]:
    """Velocity [cm/s], its standard error, and the time [s] at the middle column, of one line.

    The error counts what each time scatters about the line, and the `sampling` [s] of the records.
    """
    there = np.isfinite(line)
    at, when = x[there], line[there]
    fit = scipy.stats.theilslopes(when, at)
    scatter = 1.4826 * np.median(np.abs(when - fit.slope * at - fit.intercept))
    slope_error = np.hypot(scatter, sampling) / np.sqrt(((at - at.mean()) ** 2).sum())
    middle = float(fit.intercept + fit.slope * x[len(x) // 2])
    slope = float(fit.slope)
    if slope == 0.0:
        return np.nan, np.nan, middle
    return 1.0 / slope, float(slope_error / slope**2), middle
