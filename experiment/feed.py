"""What is poured at x = 0, as the rolling thickness of each species there."""

from typing import Self

import numpy as np
from pydantic import Field, model_validator

from experiment.arrays import Floats
from experiment.fields import NonNegative, Part

__all__ = ["Feed"]


class Feed(Part):
    """A constant feed. Models ask :meth:`thickness` at their own times, so a feed may vary."""

    inflow: tuple[NonNegative, ...] = Field(min_length=1)  # cm, one a species

    def thickness(self, time: Floats) -> Floats:
        """Rolling thickness R_a^0 [cm] at x = 0: an array (time, species) for times (time,) [s]."""
        return np.tile(np.asarray(self.inflow, dtype=np.float64), (len(time), 1))

    @property
    def mean_inflow(self) -> Floats:
        """R_a^0 (species,) [cm], averaged over time."""
        return np.asarray(self.inflow, dtype=np.float64)

    @model_validator(mode="after")
    def _check_that_something_is_poured(self) -> Self:
        if sum(self.inflow) <= 0:
            raise ValueError(f"inflow = {list(self.inflow)}: at least one should be greater than 0")
        return self
