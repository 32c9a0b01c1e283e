"""What is poured, as the rolling thickness of each species at the source, and how that varies."""

import math
from collections.abc import Mapping
from typing import Any, Self

import numpy as np
from pydantic import (
    Field,
    SerializerFunctionWrapHandler,
    TypeAdapter,
    ValidationError,
    model_serializer,
    model_validator,
)

from experiment.arrays import Floats
from experiment.fields import LARGEST, NonNegative, Part, number_between
from experiment.schedule import Constant, Schedule, Table
from experiment.source import Source

__all__ = ["Feed"]

HIGHEST = {"total_inflow": LARGEST, "share_2": 1.0}
INFLOW: TypeAdapter[tuple[float, ...]] = TypeAdapter(tuple[NonNegative, ...])


def _average_of_table(part: dict[str, Any]) -> tuple[float, ...]:
    schedule = part["schedule"]
    return schedule.average if isinstance(schedule, Table) else ()


class Feed(Part):
    """A feed R_a^0, and how it varies.

    `inflow` is given for every schedule but a table, whose average it is. Beside it,
    `total_inflow` [cm] scales it to this sum R0, its composition kept, and `share_2` sets what
    part of that sum is species 2, of two. Neither touches what a schedule adds to `inflow`.
    """

    schedule: Schedule = Constant()  #: how the feed varies in time
    source: Source | None = None  #: where it falls; default: at x = 0
    #: cm; R_a^0, rolling thickness of each species at the source; default: the mean of a table
    inflow: tuple[NonNegative, ...] = Field(default_factory=_average_of_table, min_length=1)

    def thickness(self, times: Floats) -> Floats:
        """Rolling thickness R_a [cm] at the source: (time, species) for times (time,) [s]."""
        return self.schedule.thickness(np.array(self.inflow), times)

    def mean_thickness(self, edges: Floats) -> Floats:
        """R_a [cm] at the source, averaged between successive `edges` (time + 1,) [s].

        An array (time, species), which models ask for over their own steps.
        """
        return self.schedule.mean_thickness(np.array(self.inflow), edges)

    @property
    def largest_inflow(self) -> Floats:
        """The largest R_a (species,) [cm] that each species has at any time."""
        return self.schedule.largest(np.array(self.inflow))

    @classmethod
    def known_fields(cls, given: Mapping[str, Any]) -> set[str]:
        """The fields and their shorthands."""
        return super().known_fields(given) | set(HIGHEST)

    @model_validator(mode="before")
    @classmethod
    def _resolve_shorthands(cls, given: Any) -> Any:
        if not isinstance(given, dict):
            return given
        wanted = {
            name: number_between(name, given[name], 0.0, highest)
            for name, highest in HIGHEST.items()
            if name in given
        }
        fields = {name: value for name, value in given.items() if name not in wanted}
        if wanted:
            _resolve_inflow(fields, wanted)
        return fields

    @model_validator(mode="after")
    def _check_schedule(self) -> Self:
        if not self.inflow:
            raise ValueError("inflow: missing; it has no default, unless the schedule is a table")
        if isinstance(self.schedule, Table) and "inflow" in self.model_fields_set:
            raise ValueError(
                f"inflow = {list(self.inflow)}: it should be left out, for schedule.inflow tells it"
            )
        self.schedule.check(np.array(self.inflow))
        return self

    @model_serializer(mode="wrap")
    def _leave_out_what_a_table_tells(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        told: dict[str, Any] = dump(self)
        if isinstance(self.schedule, Table):
            del told["inflow"]
        return told


def _resolve_inflow(fields: dict[str, Any], wanted: Mapping[str, float]) -> None:
    """Give `inflow` the total and share that are `wanted`; one that is none, the feed refuses."""
    name, value = next(iter(wanted.items()))
    schedule = fields.get("schedule")
    described = isinstance(schedule, dict) and schedule.get("kind") == "table"
    if described or isinstance(schedule, Table):
        raise ValueError(
            f"{name} = {value:g}: it should be left out, for schedule.inflow tells the feed"
        )
    if "inflow" not in fields:
        raise ValueError(f"inflow: missing; {name} changes one that is given")
    try:
        inflow = INFLOW.validate_python(fields["inflow"])
    except ValidationError:
        return
    present = math.fsum(inflow)
    if present == 0:
        raise ValueError(
            f"{name} = {value:g}: it should be left out, for inflow = {list(inflow)} is no feed"
        )
    shares = [thickness / present for thickness in inflow]
    if "share_2" in wanted:
        if len(inflow) != 2:
            raise ValueError(
                f"share_2 = {wanted['share_2']:g}: it should be left out, "
                f"for inflow = {list(inflow)} is not of two species"
            )
        shares = [1.0 - wanted["share_2"], wanted["share_2"]]
    total = wanted.get("total_inflow", present)
    fields["inflow"] = [total * share for share in shares]
