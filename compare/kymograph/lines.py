"""Kinks and fronts of an archive: the linked lines, and what is measured of each."""

from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from compare.kymograph.fit import Curves, fit
from compare.kymograph.flow import Crossings, alarms, crossings, quieten
from compare.kymograph.link import link
from compare.kymograph.profile import profiles
from compare.kymograph.sampling import Sampling, hidden_growth
from compare.kymograph.slope import Slope, slope_of
from compare.kymograph.told import Rows, Told, compared
from compare.quantities import cell_width, velocity
from experiment.arrays import Floats, Ints

__all__ = ["follow", "fronts", "kinks", "kinks_and_fronts"]

SHORTEST = 0.15  # of the slope, on which a line was seen
LASTS = 1.0  # record between which it was first and last seen
FEWEST = 5  # columns in which it was seen
LEAST_JUMP = 0.25  # of R0, by which R differs on both sides of a line
FASTEST = 3.0  # times as fast as grains: what seems to go faster still is no line
NEAR_END = 0.2  # of the slope: what is born there was born at the end
Bools = NDArray[np.bool_]


class Lines(NamedTuple):
    """Linked lines of both kinds in order of time; NaN where a line was not seen."""

    passage: Floats  # (line, x) [s]
    before: Floats  # (line, x) [s] since the crossing before, of the other kind
    after: Floats  # (line, x) [s] until the next one
    rising: Bools  # (line,) whether the flow sets in, in a front; else it stops, in a kink


def kinks(archive: xr.Dataset) -> xr.Dataset:
    """Kinks, where the flow stops: lines that go uphill, velocities negative.

    A Dataset over `event`, in order of time, and the columns `x` of the slope below the source.
    A line counts if it was seen on SHORTEST of the slope and, in the mean, after the transient.

    - passage(event, x) [s], NaN where the line was not seen;
    - velocity [cm/s] and acceleration [cm/s2] in the columns that are `measured`, and their _error;
      NaN where the records do not tell. A line slows down where their signs differ;
    - time [s] when the line is, or would be, at the middle one of these columns;
    - birth_x, birth_time, end_x, end_time: where and when it was first and last seen;
    - born: at the `source`, on the `slope` (a trapped kink), or at the `wall` or the open `lip`;
    - width [cm] over which R, averaged in the line's moving frame, goes from 3/4 to 1/4 of its
      jump, and width_limit, what a sharp jump would seem to have;
    - upstream and downstream(event, species) [cm]: R_a beside the line, uphill and downhill of it;
    - passed_fraction(event, species): in the line's frame grains arrive from uphill with
      (v_a - velocity) R_a upstream; this share of them goes on downhill; and passed_volume [cm2],
      how much that is in all, while the line is seen.

    Attributes tell what the records can resolve, and `comment` what they cannot.
    """
    return kinks_and_fronts(archive)[0]


def fronts(archive: xr.Dataset) -> xr.Dataset:
    """Avalanche fronts, where the flow sets in: lines that go downhill. As :func:`kinks`."""
    return kinks_and_fronts(archive)[1]


def kinks_and_fronts(archive: xr.Dataset) -> tuple[xr.Dataset, xr.Dataset]:
    """Both, in hardly more than the time that one takes."""
    stops, starts = follow(archive)
    return stops.dataset(), starts.dataset()


def follow(archive: xr.Dataset) -> tuple[Told, Told]:
    """What :func:`kinks` and :func:`fronts` tell, as arrays."""
    slope = slope_of(archive)
    interval = float(np.median(np.diff(slope.time))) if len(slope.time) > 1 else np.inf
    drift, width = velocity(archive), cell_width(archive)
    flow = slope.thickness.sum(axis=-1) / slope.inflow
    rolled = min(drift * interval, slope.length) / width
    flow, smoothed, noise = quieten(flow, rolled)
    rolling = alarms(flow, noise, rolled)
    hidden = hidden_growth(slope.height, rolling)
    records = Sampling(interval, drift, slope.length, width, smoothed, noise, hidden)
    stops, starts = crossings(slope.time, flow, rolling)
    lines = _lines(slope, records, (stops, starts))
    path = fit(slope.x, lines.passage, 2, records.least)
    motion = _motion(slope, records, lines, path)
    rows: Rows = {
        "passage": (("event", "x"), lines.passage, "s", "time of passage"),
        **motion,
        **_life(slope, lines),
        **_beside(slope, records, lines, path, motion["velocity"][1]),
    }
    jump = rows["upstream"][1].sum(axis=1) - rows["downstream"][1].sum(axis=1)
    parted = jump > LEAST_JUMP * slope.inflow
    return compared(
        _told(slope, records, rows, parted & ~lines.rising),
        _told(slope, records, rows, parted & lines.rising),
    )


def _told(slope: Slope, records: Sampling, rows: Rows, chosen: Bools) -> Told:
    """The `chosen` ones (line,) of the lines that `rows` are about."""
    told: Rows = {name: (dims, every[chosen], *said) for name, (dims, every, *said) in rows.items()}
    attributes = records.attributes(
        told["passage"][1][:, slope.measured], told["velocity"][1], told["velocity_error"][1]
    )
    return Told(slope.x, slope.measured, told, attributes)


def _lines(slope: Slope, records: Sampling, found: tuple[Crossings, Crossings]) -> Lines:
    """The lines that count: long enough, going the right way, after the transient."""
    tables = [_linked(slope, records, crossings) for crossings in found]
    table = np.concatenate(tables, axis=1)
    rising = np.repeat([False, True], [one.shape[1] for one in tables])
    middle = np.nanmean(table[0], axis=1)
    lasts = np.nanmax(table[0], axis=1) - np.nanmin(table[0], axis=1) > LASTS * records.interval
    kept = lasts & (middle > slope.settled)
    order = np.flatnonzero(kept)[np.argsort(middle[kept])]
    passage, before, after = table[:, order]
    course = fit(slope.x, passage, 1, records.least)
    slowness = course.coefficient[:, 1] / course.half * np.where(rising[order], 1.0, -1.0)
    slowest = slowness + 2.0 * course.error[:, 1] / course.half
    possible = (slowness > 0.0) & (slowest * records.drift > 1.0 / FASTEST)
    return Lines(*(every[possible] for every in (passage, before, after, rising[order])))


def _linked(slope: Slope, records: Sampling, found: Crossings) -> Floats:
    """Times, before and after (3, line, x) of lines that were seen in enough columns."""
    number = link(found, records.interval)
    seen = np.bincount(number)
    table = np.full((3, len(seen), len(slope.x)), np.nan)
    table[:, number, found.column] = found.time, found.before, found.after
    enough: Floats = table[:, seen >= max(FEWEST, SHORTEST * len(slope.x))]
    return enough


def _motion(slope: Slope, records: Sampling, lines: Lines, path: Curves) -> Rows:
    """Velocity, acceleration and time: t(x) = c_0 + c_1 u, and + c_2 u^2, in the measured columns.

    The velocity is half / c_1, the acceleration -v^3 t'' = -2 half c_2 / c_1^3.
    """
    inside = np.where(slope.measured, lines.passage, np.nan)
    straight, bent = (fit(slope.x, inside, degree, records.least) for degree in (1, 2))
    resolved = records.resolve(inside) & (straight.coefficient[:, 1] != 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        rate = np.where(resolved, straight.coefficient[:, 1], np.nan)
        v = straight.half / rate
        v_error = np.abs(v / rate) * straight.error[:, 1]
        rate = np.where(resolved, bent.coefficient[:, 1], np.nan)
        gain = -2.0 * bent.half / rate**3
    middle = slope.x[slope.measured][slope.measured.sum() // 2 :][:1]
    in_part = np.isfinite(straight.coefficient[:, 0])
    time = np.where(in_part[:, None], straight.at(middle), path.at(middle)).sum(axis=1)
    return {
        "velocity": ("event", v, "cm s-1", "velocity of line"),
        "velocity_error": ("event", v_error, "cm s-1", "standard error of velocity"),
        "acceleration": ("event", gain * bent.coefficient[:, 2], "cm s-2", "acceleration of line"),
        "acceleration_error": (
            "event",
            np.abs(gain) * bent.error[:, 2],
            "cm s-2",
            "standard error of acceleration",
        ),
        "time": ("event", time, "s", "time at the middle column"),
    }


def _life(slope: Slope, lines: Lines) -> Rows:
    """Where and when lines begin and end: fronts go downhill, kinks uphill."""
    top, bottom = _ends(lines.passage)
    first, last = np.where(lines.rising, (top, bottom), (bottom, top))
    line = np.arange(len(first))
    birth_x = slope.x[first]
    upper, lower = NEAR_END * slope.length, (1.0 - NEAR_END) * slope.length
    born = np.where(birth_x < upper, "source", np.where(birth_x > lower, slope.ends_at, "slope"))
    return {
        "birth_x": ("event", birth_x, "cm", "where the line was first seen"),
        "birth_time": ("event", lines.passage[line, first], "s", "when it was first seen"),
        "end_x": ("event", slope.x[last], "cm", "where the line was last seen"),
        "end_time": ("event", lines.passage[line, last], "s", "when it was last seen"),
        "born": ("event", born, "", "where the line was born"),
    }


def _beside(
    slope: Slope, records: Sampling, lines: Lines, path: Curves, velocities: Floats
) -> Rows:
    """Width, and the rolling layer on either side."""
    top, bottom = _ends(lines.passage)
    line = np.arange(len(top))
    there = np.isfinite(lines.passage)
    before, after = (np.where(there, rest, np.nan) for rest in (lines.before, lines.after))
    seen = profiles(slope.time, slope.thickness, path.at(slope.x), before, after, lines.rising)
    life = np.abs(lines.passage[line, bottom] - lines.passage[line, top])
    mean = np.divide(
        slope.x[bottom] - slope.x[top], life, where=life > 0, out=np.full(len(life), np.nan)
    )
    speed = np.where(np.isfinite(velocities), np.abs(velocities), mean)
    relative = slope.drift - np.where(lines.rising, speed, -speed)[:, None]
    share = np.divide(seen.calm, seen.flowing, where=seen.flowing > 0, out=np.zeros_like(seen.calm))
    per_species = ("event", "species")
    return {
        "width": (
            "event",
            speed * seen.duration,
            "cm",
            "distance from 3/4 to 1/4 of the jump in R",
        ),
        "width_limit": (
            "event",
            records.blur(speed, path.scatter),
            "cm",
            "width that a sharp jump would seem to have",
        ),
        "upstream": (per_species, seen.flowing, "cm", "rolling thickness uphill of the line"),
        "downstream": (per_species, seen.calm, "cm", "rolling thickness downhill of the line"),
        "passed_fraction": (per_species, share, "1", "share of what arrives that passes the line"),
        "passed_volume": (
            per_species,
            np.abs(relative) * seen.calm * life[:, None],
            "cm2",
            "volume per unit gap that passed the line while it was seen",
        ),
    }


def _ends(passage: Floats) -> tuple[Ints, Ints]:
    """The uppermost and the lowest column (line,) in which a line is seen."""
    there = np.isfinite(passage)
    return there.argmax(axis=1), passage.shape[1] - 1 - there[:, ::-1].argmax(axis=1)
