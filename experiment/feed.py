"""What is poured, as the rolling thickness of each species at the source, and how that varies."""

from typing import Any, Self

import numpy as np
from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from experiment.arrays import Floats
from experiment.fields import NonNegative, Part
from experiment.schedule import Constant, Schedule, Table
from experiment.source import Source

__all__ = ["Feed"]


def _average_of_table(part: dict[str, Any]) -> tuple[float, ...]:
    schedule = part["schedule"]
    return schedule.average if isinstance(schedule, Table) else ()


class Feed(Part):
    """A feed R_a^0 and its schedule. Models ask :meth:`mean_thickness` over their own steps.

    `inflow` is given for every schedule but a table, whose average it is.
    """

    schedule: Schedule = Constant()
    source: Source | None = None  # where it falls; default: at x = 0
    inflow: tuple[NonNegative, ...] = Field(default_factory=_average_of_table, min_length=1)  # cm

    def thickness(self, times: Floats) -> Floats:
        """Rolling thickness R_a [cm] at the source: (time, species) for times (time,) [s]."""
        return self.schedule.thickness(np.array(self.inflow), times)

    def mean_thickness(self, edges: Floats) -> Floats:
        """R_a [cm] at the source, averaged between successive `edges` (time + 1,) [s].

        An array (time, species).
        """
        return self.schedule.mean_thickness(np.array(self.inflow), edges)

    @property
    def largest_inflow(self) -> Floats:
        """The largest R_a (species,) [cm] that each species has at any time."""
        return self.schedule.largest(np.array(self.inflow))

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
