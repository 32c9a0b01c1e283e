"""Where the feed falls: at x = 0, or from a spout that travels along a heap."""

from typing import Self

import numpy as np
from pydantic import model_validator

from experiment.arrays import Floats
from experiment.fields import NonNegative, Number, Part

__all__ = ["Source"]


class Source(Part):
    """A spout that is at `x` at each `time`, and travels evenly between.

    It stays at the last place, or begins again if it `repeats`.
    """

    time: tuple[NonNegative, ...]  #: s; 2 or more, that grow from 0 on
    x: tuple[Number, ...]  #: cm; above the cell, one a time
    repeats: bool = False  #: whether it begins again after the last time

    def position(self, times: Floats) -> Floats:
        """The spout's x [cm] at `times` (time,) [s]."""
        phase = np.mod(times, self.time[-1]) if self.repeats else times
        return np.asarray(np.interp(phase, self.time, self.x))

    @model_validator(mode="after")
    def _check_path(self) -> Self:
        time, x = list(self.time), list(self.x)
        if len(time) < 2 or time[0] != 0 or not (np.diff(time) > 0).all():
            raise ValueError(f"time = {time}: it should be 2 or more values that grow from 0 on")
        if len(x) != len(time):
            raise ValueError(f"x = {x}: it should have {len(time)} values, one a time")
        return self
