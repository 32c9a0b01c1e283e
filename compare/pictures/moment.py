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

UPHILL, DOWNHILL = np.minimum, np.maximum  # of x, which way a line goes


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
        self.height = values_of(archive, "height")
        self.rolling = values_of(archive, "rolling_thickness")
        self._lines_x, self._kinks, self._fronts = _lines(archive)
        self.has_kinks, self.has_fronts = len(self._kinks) > 0, len(self._fronts) > 0

    def at(self, time: float) -> Moment:
        """The pour at a time [s], linear between two records."""
        k = int(np.searchsorted(self.records, time).clip(1, len(self.records) - 1))
        before, after = self.records[k - 1 : k + 1]
        share = min(max((time - before) / (after - before), 0.0), 1.0)
        height = (1.0 - share) * self.height[k - 1] + share * self.height[k]
        rolling = (1.0 - share) * self.rolling[k - 1] + share * self.rolling[k]
        kinks = self._on_the_pile(_places(self._lines_x, self._kinks, time, UPHILL), height)
        fronts = self._on_the_pile(_places(self._lines_x, self._fronts, time, DOWNHILL), height)
        return Moment(time, height, rolling, kinks, fronts)

    def _on_the_pile(self, places: list[float], height: Floats) -> Floats:
        return np.column_stack([places, np.interp(places, self.x, height)])


def _lines(archive: xr.Dataset) -> tuple[Floats, Floats, Floats]:
    """Columns (x,) and times of passage (line, x) of kinks and fronts; none where none is told."""
    if why_not_measured(archive) is not None:
        return np.empty(0), np.empty((0, 0)), np.empty((0, 0))
    strata: Strata = archive.strata
    kinks, fronts = strata.kinks(), strata.fronts()
    return kinks["x"].values, kinks["passage"].values, fronts["passage"].values


def _places(x: Floats, passages: Floats, time: float, farthest: np.ufunc) -> list[float]:
    """Where lines are at a time, of those that were first seen before and last seen after it.

    A line is as far on its way as it has come: the records scatter, so that a few columns seem to
    be passed later than the next.
    """
    places = []
    for passage in passages:
        seen = np.flatnonzero(np.isfinite(passage))
        order = seen[np.argsort(passage[seen], kind="stable")]
        if passage[order[0]] <= time <= passage[order[-1]]:
            reached = farthest.accumulate(x[order])
            places.append(float(np.interp(time, passage[order], reached)))
    return places
