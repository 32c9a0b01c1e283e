"""What an archive shows at an instant: the pile so far, what rolls on it, where kinks climb."""

from typing import NamedTuple

import numpy as np
import xarray as xr

from compare.accessor import Strata
from compare.quantities import values_of, why_not_measured
from experiment.archive import experiment_of
from experiment.arrays import Floats
from experiment.errors import NotApplicableError

__all__ = ["Course", "Moment"]


class Moment(NamedTuple):
    """One instant of a pour."""

    time: float  # [s]
    height: Floats  # (x,) [cm] of the pile at rest
    rolling: Floats  # (x, species) [cm], R_a
    kinks: Floats  # (kink, 2) [cm], x and z of each kink that climbs
    fronts: Floats  # (front, 2) [cm], x and z of each avalanche front that runs down


class Course:
    """A pour in the course of time, between its first record and its last.

    What lies in the pile at an instant is `deposit_fraction` below the height that the pile had
    then. (Where the flow took up again what lay there, an archive knows what came later only.)

    Raises :class:`NotApplicableError` for a drum: what it turns is not where it lay before.
    """

    def __init__(self, archive: xr.Dataset) -> None:
        if experiment_of(archive).cell.shape == "drum":
            raise NotApplicableError(
                "cell.shape = 'drum': its archive holds the last section only, nothing to follow"
            )
        self.x = values_of(archive, "x")
        self.records = values_of(archive, "time")
        self._height = values_of(archive, "height")
        self._rolling = values_of(archive, "rolling_thickness")
        self._lines_x, self._kinks, self._fronts = _lines(archive)

    def at(self, time: float) -> Moment:
        """The pour at a time [s], linear between two records."""
        k = int(np.searchsorted(self.records, time).clip(1, len(self.records) - 1))
        before, after = self.records[k - 1 : k + 1]
        share = min(max((time - before) / (after - before), 0.0), 1.0)
        height = (1.0 - share) * self._height[k - 1] + share * self._height[k]
        rolling = (1.0 - share) * self._rolling[k - 1] + share * self._rolling[k]
        kinks, fronts = (
            self._on_the_pile(passage, time, height) for passage in (self._kinks, self._fronts)
        )
        return Moment(time, height, rolling, kinks, fronts)

    def _on_the_pile(self, passage: Floats, time: float, height: Floats) -> Floats:
        """Where (line, 2) the lines are at a time, of those that were seen before and after it."""
        places = [x for line in passage if (x := _place(self._lines_x, line, time)) is not None]
        return np.column_stack([places, np.interp(places, self.x, height)])


def _lines(archive: xr.Dataset) -> tuple[Floats, Floats, Floats]:
    """Columns (x,) and times of passage (line, x) of kinks and fronts; none where none is told."""
    if why_not_measured(archive) is not None:
        return np.empty(0), np.empty((0, 0)), np.empty((0, 0))
    strata: Strata = archive.strata
    kinks, fronts = strata.kinks(), strata.fronts()
    return kinks["x"].values, kinks["passage"].values, fronts["passage"].values


def _place(x: Floats, passage: Floats, time: float) -> float | None:
    """Where a line is at a time; None before it was first seen and after it was last."""
    seen = np.isfinite(passage)
    passed = passage[seen]
    if not passed.min() <= time <= passed.max():
        return None
    order = np.argsort(passed)
    return float(np.interp(time, passed[order], x[seen][order]))
