"""How a feed varies in time: the rolling thickness R_a(t) at x = 0, from the feed's R_a^0.

    constant   R_a(t) = R_a^0
    pulses     R_a(t) = the pulse's inflow_a while t mod T < share T, else R_a^0
    sine       R_a(t) = R_a^0 + amplitude_a sin(2 pi t / T)
    table      R_a(t) = linear between the rows of a table, constant after the last

T is the `period`. Models are fed the mean over each of their steps, so that no pulse between two
steps is missed. R_a^0 of a table is its mean over the table's span.
Sine amplitudes of opposite sign vary the composition of the feed.
"""

from collections.abc import Sequence
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BeforeValidator, Field, model_validator
from scipy.interpolate import make_interp_spline

from experiment.arrays import Floats
from experiment.fields import NonNegative, Number, Part, Positive

__all__ = ["Constant", "Pulses", "Schedule", "Sine", "Table"]

Row = Annotated[tuple[NonNegative, ...], Field(min_length=1)]  # one value a species


class Variation(Part):
    """What each kind of schedule tells, from R_a^0 = `base` (species,) [cm]."""

    def thickness(self, base: Floats, times: Floats) -> Floats:
        """R_a (time, species) [cm] at `times` (time,) [s]."""
        return np.full((len(times), len(base)), base)

    def mean_thickness(self, base: Floats, edges: Floats) -> Floats:
        """R_a (time, species) [cm], averaged between successive `edges` (time + 1,) [s]."""
        return np.full((len(edges) - 1, len(base)), base)

    def largest(self, base: Floats) -> Floats:
        """The largest R_a (species,) [cm] that each species has at any time."""
        return base

    def check(self, base: Floats) -> None:
        """Raise ValueError, from the feed's point of view, where `base` cannot vary so."""


class Constant(Variation):
    """The same feed at all times."""

    kind: Literal["constant"] = "constant"  #: of schedule


class Pulses(Variation):
    """Another feed during the first `share` of each period."""

    kind: Literal["pulses"] = "pulses"  #: of schedule
    period: Positive  #: s; T, from pulse to pulse
    share: Annotated[float, Field(strict=True, gt=0, lt=1)]  #: 1; of each period that is pulse
    inflow: Row  #: cm; R_a in a pulse

    def thickness(self, base: Floats, times: Floats) -> Floats:
        """The pulse's inflow in a pulse, R_a^0 between."""
        in_pulse = np.mod(times, self.period) < self.share * self.period
        return np.where(in_pulse[:, None], np.array(self.inflow), base)

    def mean_thickness(self, base: Floats, edges: Floats) -> Floats:
        """As much of both as of pulse and pause in each interval."""
        periods, phase = np.divmod(edges, self.period)
        in_pulse = self.period * self.share
        pulsed = np.diff(periods * in_pulse + np.minimum(phase, in_pulse))
        part = np.clip(pulsed / np.diff(edges), 0.0, 1.0)[:, None]  # but for round-off it is
        return np.asarray(part * np.array(self.inflow) + (1.0 - part) * base)

    def largest(self, base: Floats) -> Floats:
        """The larger of pulse and R_a^0."""
        return np.maximum(base, self.inflow)

    def check(self, base: Floats) -> None:
        """A pulse has as many species as the feed."""
        _check_species("schedule.inflow", self.inflow, len(base))


class Sine(Variation):
    """A feed that swings about its mean."""

    kind: Literal["sine"] = "sine"  #: of schedule
    period: Positive  #: s; T
    amplitude: tuple[Number, ...]  #: cm; one a species, at most its inflow in size

    def thickness(self, base: Floats, times: Floats) -> Floats:
        """R_a^0 and its swing."""
        swing = np.sin(2 * np.pi * times / self.period)
        return np.asarray(base + np.outer(swing, self.amplitude))

    def mean_thickness(self, base: Floats, edges: Floats) -> Floats:
        """R_a^0 and the mean of its swing."""
        turn = 2 * np.pi / self.period
        swing = -np.diff(np.cos(turn * edges)) / (turn * np.diff(edges))
        return np.asarray(base + np.outer(np.clip(swing, -1.0, 1.0), self.amplitude))

    def largest(self, base: Floats) -> Floats:
        """R_a at the crest."""
        return np.asarray(base + np.abs(self.amplitude))

    def check(self, base: Floats) -> None:
        """No thickness is ever negative."""
        _check_species("schedule.amplitude", self.amplitude, len(base))
        for a, (amplitude, inflow) in enumerate(zip(self.amplitude, base, strict=True)):
            if abs(amplitude) > inflow:
                raise ValueError(
                    f"schedule.amplitude[{a}] = {amplitude:g}: "
                    f"it should be at most inflow[{a}] = {inflow:g} in size"
                )


class Table(Variation):
    """A feed that is given at some times: a row of `inflow` for each `time`."""

    kind: Literal["table"] = "table"  #: of schedule
    time: tuple[NonNegative, ...]  #: s; 2 or more, that grow from 0 on
    inflow: tuple[Row, ...]  #: cm; R_a, a row for each time

    @property
    def average(self) -> tuple[float, ...]:
        """R_a^0 (species,) [cm]: the mean over the table's span."""
        volume: Floats = np.trapezoid(np.array(self.inflow), self.time, axis=0)
        return tuple(float(share) for share in volume / self.time[-1])

    def thickness(self, base: Floats, times: Floats) -> Floats:
        """The rows, linear between; a table needs no R_a^0."""
        fed = np.empty((len(times), len(base)))
        for a, column in enumerate(zip(*self.inflow, strict=True)):
            fed[:, a] = np.interp(times, self.time, column)
        return fed

    def mean_thickness(self, base: Floats, edges: Floats) -> Floats:  # noqa: ARG002
        """The area under the rows between two edges, over their distance."""
        rows = np.array(self.inflow)
        time = np.append(self.time, max(self.time[-1], edges[-1]) + 1.0)
        line = make_interp_spline(time, np.vstack([rows, rows[-1:]]), k=1)
        mean = np.diff(line.antiderivative()(edges), axis=0) / np.diff(edges)[:, None]
        return np.asarray(np.clip(mean, rows.min(axis=0), rows.max(axis=0)))  # but for round-off

    def largest(self, base: Floats) -> Floats:  # noqa: ARG002
        """The largest value of each column."""
        return np.asarray(np.max(self.inflow, axis=0))

    @model_validator(mode="after")
    def _check_rows(self) -> Self:
        time = list(self.time)
        if len(time) < 2 or time[0] != 0 or not (np.diff(time) > 0).all():
            raise ValueError(f"time = {time}: it should be 2 or more values that grow from 0 on")
        rows = [list(row) for row in self.inflow]
        if len(rows) != len(time):
            raise ValueError(f"inflow = {rows}: it should have {len(time)} rows, one a time")
        for k, row in enumerate(rows):
            _check_species(f"inflow[{k}]", row, len(rows[0]))
        return self


KINDS: dict[str, type[Variation]] = {
    "constant": Constant,
    "pulses": Pulses,
    "sine": Sine,
    "table": Table,
}


def _of_its_kind(given: Any) -> Any:
    """The schedule that a table of a set-up describes; its `kind` says which."""
    if isinstance(given, Variation):
        return given
    if not isinstance(given, dict):
        raise ValueError(f"it should be a table with a kind; allowed: {', '.join(KINDS)}")
    kind = given.get("kind")
    if kind is None:
        raise ValueError(f"kind: missing; allowed: {', '.join(KINDS)}")
    if not isinstance(kind, str) or kind not in KINDS:
        raise ValueError(f"kind = {kind!r}: it should be one of {', '.join(KINDS)}")
    return KINDS[kind].model_validate(given)


def _check_species(name: str, values: Sequence[float], species: int) -> None:
    if len(values) != species:
        raise ValueError(f"{name} = {list(values)}: it should have {species} values, one a species")


Schedule = Annotated[Constant | Pulses | Sine | Table, BeforeValidator(_of_its_kind)]
