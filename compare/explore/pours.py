"""One set-up, poured by both models, to be looked at in the course of time."""

import math
from functools import cached_property
from typing import NamedTuple, Self

import xarray as xr

from compare.campaign import POUR
from compare.measurement import numbers_of
from compare.pictures.moment import Course, Moment
from compare.quantities import values_of
from compare.so_far import so_far
from experiment import Experiment

__all__ = ["Numbers", "Poured", "Pours"]

STEPS = 40  # of a pour, at which it is measured


class Numbers(NamedTuple):
    """What the instrument tells of a pour, as far as it has come; NaN where it tells nothing."""

    regime: str = "unsettled"
    wavelength: float = math.nan  # cm
    wavelength_error: float = math.nan
    kink_velocity: float = math.nan  # cm/s, uphill
    kink_velocity_error: float = math.nan

    @classmethod
    def of(cls, archive: xr.Dataset) -> Self:
        """Those of an archive."""
        found, _ = numbers_of(archive)
        regime, *numbers = (found[name][1] for name in cls._fields)
        return cls(regime, *map(float, numbers))


class Poured:
    """The pour of one model."""

    def __init__(self, archive: xr.Dataset) -> None:
        self.archive = archive
        self.course = Course(archive)
        self._told: dict[int, Numbers] = {}

    @property
    def duration(self) -> float:
        """How long it was poured [s]."""
        return float(self.course.records[-1])

    def at(self, share: float) -> Moment:
        """What there is when this `share` of it is over."""
        return self.course.at(share * self.duration)

    def known(self, share: float) -> Numbers | None:
        """What :meth:`measure` tells, if it has been measured there; else None."""
        return self._told.get(int(share * STEPS))

    def measure(self, share: float) -> Numbers:
        """What the instrument tells at the last of the STEPS that are over."""
        step = int(share * STEPS)
        if step not in self._told:
            self._told[step] = Numbers.of(so_far(self.archive, step / STEPS * self.duration))
        return self._told[step]

    @cached_property
    def delta(self) -> float:
        """The difference of the pure repose slopes that acts: on a lattice they come in steps."""
        told = self.archive.attrs.get("effective_repose_slope")
        slopes = values_of(self.archive, "repose_slope").ravel() if told is None else told
        return float(slopes[-1] - slopes[0])


class Pours:
    """Both models' pours of a set-up. Raises :class:`SetupError` where one cannot pour it."""

    def __init__(self, setup: Experiment) -> None:
        self.setup = setup
        self.of = {model: Poured(pour(setup)) for model, pour in POUR.items()}

    @property
    def duration(self) -> float:
        """How long both poured [s]."""
        return max(poured.duration for poured in self.of.values())

    def known(self, share: float) -> dict[str, Numbers] | None:
        """What :meth:`measure` would tell, if it has been measured there; else None."""
        told = {model: poured.known(share) for model, poured in self.of.items()}
        known = {model: numbers for model, numbers in told.items() if numbers is not None}
        return known if len(known) == len(told) else None

    def measure(self, share: float) -> dict[str, Numbers]:
        """What the instrument tells of each when this `share` of it is over."""
        return {model: poured.measure(share) for model, poured in self.of.items()}
