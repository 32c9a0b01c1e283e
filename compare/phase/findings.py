"""What the jobs of a diagram told, gathered into one Dataset over what varies."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from compare.campaign import Outcome, Table
from compare.phase.boundary import boundary
from compare.phase.plan import Plan
from compare.phase.theory import ONSET
from compare.quantities import named
from experiment.archive.layout import CONVENTIONS, REFERENCES, history
from experiment.archive.provenance import made_by
from experiment.arrays import Floats

__all__ = ["PLAN", "Findings"]

PLAN = "plan_sha256"


class Findings:
    """What the jobs of a plan told, as they come."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._pours, self._lines = Table(plan.pours), Table(len(plan.lines))
        self._pictures: dict[int, Floats] = {}

    @property
    def told(self) -> int:
        """How many jobs are done."""
        return self._pours.told + self._lines.told

    def left(self) -> list[int]:
        """The numbers of the jobs that are not."""
        return np.flatnonzero(~np.append(self._pours.done, self._lines.done)).tolist()

    def put(self, number: int, outcome: Outcome) -> None:
        """Keep what came of a job."""
        if number < self._plan.pours:
            self._pours.put(number, outcome)
        else:
            self._lines.put(number - self._plan.pours, outcome)
        if outcome.picture is not None:
            self._pictures[number] = outcome.picture

    def dataset(self) -> xr.Dataset:
        """The diagram. Raises :class:`StratifyError` where no pour could be measured."""
        plan = self._plan
        sizes = {axis.dim: axis.size for axis in plan.axes}
        told = self._pours.variables(sizes | {"model": len(plan.models)})
        known = {name: there for axis in plan.axes for name, there in axis.coordinates.items()}
        found = xr.Dataset(
            {name: values for name, values in told.items() if name not in known}
            | self._onsets(sizes)
            | self._deposits(),
            known | {"model_name": ("model", list(plan.models))},
            {
                "Conventions": CONVENTIONS,
                "title": f"{plan.experiment.title}: phase diagram",
                "source": made_by(),
                "history": history("mapped"),
                "references": REFERENCES,
                "experiment": plan.experiment.to_toml(),
                PLAN: plan.digest,
            },
        )
        words = [str(name) for name in found.coords if str(name).endswith("_name")]
        for name in words:
            found = found.set_xindex(name)
        return found.assign(boundary(found, plan.axes[0].dim)) if plan.is_graded else found

    def _onsets(self, sizes: Mapping[str, int]) -> dict[str, tuple[Any, ...]]:
        """The onset in the spectrum over all dimensions but the first."""
        if not self._plan.lines:
            return {}
        dims, shape = list(sizes)[1:], list(sizes.values())[1:]
        key = next(iter(self._plan.axes[0].fields))
        onset = np.full(math.prod(shape), np.nan)
        onset[list(self._plan.lines)] = self._lines.values_of(ONSET)
        units = self._plan.axes[0].units[key]
        said = named(f"{key} from which on disturbances of the steady pile grow", units)
        reasons = dict.fromkeys(filter(None, self._lines.failure))
        if reasons:
            said["comment"] = "where it is not known: " + "; ".join(reasons)
        return {ONSET: (dims, onset.reshape(shape), said)}

    def _deposits(self) -> dict[str, tuple[Any, ...]]:
        """The small pictures, and what they are of."""
        if not self._pictures:
            return {}
        numbers = np.array(sorted(self._pictures))
        point, model = np.divmod(numbers, len(self._plan.models))
        pictures = np.array([self._pictures[number] for number in numbers.tolist()])
        return {
            "deposit": (
                ("picture", "row", "column"),
                pictures,
                named("coarseness of the deposit, its columns let down to one floor"),
            ),
            "picture_point": (
                "picture",
                point,
                named("number of its point, the last axis fastest"),
            ),
            "picture_model": ("picture", model, named("number of its model")),
        }
