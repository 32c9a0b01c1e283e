"""Where theory expects layers to begin: delta = 0, and the onset of growth in the spectrum.

delta = theta_22 - theta_11 > 0     the paper's condition, of each pair of species
Re sigma = 0                        disturbances of the steady pile begin to grow
                                    (:mod:`continuum.theory.spectrum`)
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from compare.campaign import Outcome
from continuum.theory.spectrum import critical_value
from experiment import Experiment, SetupError
from experiment.archive import experiment_of
from experiment.arrays import Floats

__all__ = ["ONSET", "Onset", "pure_slopes"]

ONSET = "spectrum_onset"
PART = 0.02  # of the smallest step along the axis, to which an onset is found


@dataclass(frozen=True)
class Onset:
    """The value of a field from which on disturbances of the steady pile grow, a job to be done."""

    experiment: Experiment
    key: str
    along: Sequence[float]  # its values on the axis
    values: Mapping[str, object]  # of the other fields

    def __call__(self) -> Outcome:
        """Find it to a part of a step. Raises :class:`NotApplicableError` where it is not there."""
        at = self.experiment.with_values(self.values)
        accuracy = PART * float(np.diff(self.along).min())
        ends = self.along[0], self.along[-1]
        return Outcome({ONSET: critical_value(at, self.key, ends, accuracy)}, {})


def pure_slopes(diagram: xr.Dataset) -> Floats:
    """The repose slopes theta_aa (point, species) at each point, the last axis fastest.

    NaN where there is no such mixture.
    """
    experiment = experiment_of(diagram)
    fields = {
        there.attrs["field"]: there
        for there in diagram.coords.values()
        if there.attrs.get("field", "").startswith("mixture.")
    }
    like = diagram["regime"].isel(model=0, drop=True, missing_dims="ignore")
    columns = [xr.broadcast(there, like)[0].transpose(*like.dims) for there in fields.values()]
    points = zip(*(column.values.ravel().tolist() for column in columns), strict=True)
    found = np.tile(np.diagonal(experiment.mixture.repose_slope), (like.size, 1))
    for k, point in enumerate(points):
        values = [json.loads(value) if isinstance(value, str) else value for value in point]
        try:
            there = experiment.with_values(dict(zip(fields, values, strict=True)))
        except SetupError:
            found[k] = np.nan
        else:
            found[k] = np.diagonal(there.mixture.repose_slope)
    return found
