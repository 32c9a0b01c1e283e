"""What is to be done for a phase diagram: each point poured by each model, and lines of theory.

Jobs are numbered, point by point and model by model, the lines last; so a diagram that was
interrupted knows what is left.
"""

import hashlib
import json
import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from compare.campaign import CHECK, Job, Pour
from compare.phase.axes import DRAW, Axis
from compare.phase.theory import Onset
from experiment import Experiment, SetupError
from experiment.archive.provenance import made_by

__all__ = ["Plan", "plan_of", "sound_setup", "thinned"]

MOST_POINTS = 10_000_000


@dataclass(frozen=True)
class Plan:
    """The points of a diagram, and what is done at them; see :func:`plan_of`."""

    experiment: Experiment
    axes: tuple[Axis, ...]
    models: tuple[str, ...]
    pictured: tuple[int, ...]  # points whose deposits are kept
    lines: tuple[int, ...] = ()  # across the first axis, along which the spectrum is asked

    @property
    def shape(self) -> tuple[int, ...]:
        """How many points there are along each axis."""
        return tuple(axis.size for axis in self.axes)

    @property
    def pours(self) -> int:
        """How many of the jobs are pours."""
        return math.prod(self.shape) * len(self.models)

    def __len__(self) -> int:
        return self.pours + len(self.lines)

    @property
    def is_graded(self) -> bool:
        """Whether a field grows along the first axis, so that there is where something begins."""
        first = self.axes[0]
        values = next(iter(first.fields.values()))
        numbers = all(type(value) in {int, float} for value in values)
        return first.dim != DRAW and numbers and len(values) > 1 and sorted(values) == list(values)

    def jobs(self, left: Collection[int]) -> Iterator[Job]:
        """Those jobs whose numbers are `left`."""
        pictured = set(self.pictured)
        for number in left:
            point, model = divmod(number, len(self.models))
            if number < self.pours:
                values = _at(self.axes, point)
                yield Pour(self.models[model], self.experiment, values, point in pictured)
            else:
                yield self._onset(self.lines[number - self.pours])

    def _onset(self, line: int) -> Onset:
        first, *others = self.axes
        ((key, values),) = first.fields.items()
        return Onset(self.experiment, key, values, _at(others, line))

    def told(self) -> dict[str, str]:
        """All that the outcomes depend on, in words."""
        return {
            "made by": made_by(),
            "set-up": self.experiment.to_toml(),
            "models": ", ".join(self.models),
            "axes": json.dumps([axis.fields for axis in self.axes]),
            "deposits": json.dumps(self.pictured),
            "lines of the spectrum": json.dumps(self.lines),
        }

    @property
    def digest(self) -> str:
        """SHA-256 of that."""
        return hashlib.sha256(json.dumps(self.told()).encode()).hexdigest()


def plan_of(
    experiment: Experiment,
    axes: tuple[Axis, ...],
    models: Sequence[str],
    deposits: int = 0,
    lines: int = 0,
) -> Plan:
    """The plan of a diagram of which so many `deposits` are kept as small pictures.

    Those are spread evenly over the diagram. Along so many `lines` across the first axis, evenly
    spread over the others, the spectrum of the steady pile is asked where disturbances begin to
    grow, unless the first axis is not of numbers that grow, of mixture, cell or feed, or the
    continuum does not pour. Raises
    :class:`SetupError` where a field cannot vary as an axis says, at not a single place; and
    :class:`NotApplicableError` where a model cannot pour what it says.
    """
    shape = tuple(axis.size for axis in axes)
    points = math.prod(shape)
    if points > MOST_POINTS:
        raise SetupError(f"vary: {points} points; at most {MOST_POINTS} are allowed")
    unknown = [model for model in models if model not in CHECK]
    for name, number in (("deposits", deposits), ("lines", lines)):
        if number < 0:
            raise SetupError(f"{name} = {number}: it should be at least 0")
    if unknown or not models:
        raise SetupError(f"models = {list(models)}: allowed: {', '.join(CHECK)}, one or both")
    sound = sound_setup(experiment, axes)
    for model in models:
        CHECK[model](sound)
    plan = Plan(experiment, axes, tuple(models), pictured=_spread(shape, deposits))
    key = next(iter(axes[0].fields))
    of_the_pile = key.split(".")[0] in {"mixture", "cell", "feed"}
    if "continuum" not in models or not plan.is_graded or not of_the_pile:
        return plan
    return replace(plan, lines=thinned(points // shape[0], lines))


def sound_setup(experiment: Experiment, axes: Iterable[Axis]) -> Experiment:
    """The set-up at the first place along each axis at which it is one.

    Raises :class:`SetupError` where there is none.
    """
    values: dict[str, Any] = {}
    for axis in axes:
        values = _with_any_place(experiment, values, axis)
    return experiment.with_values(values)


def _with_any_place(experiment: Experiment, values: dict[str, Any], axis: Axis) -> dict[str, Any]:
    """The `values` and those at the first place along `axis` that make a set-up with them."""
    refusal = None
    for place in range(axis.size):
        there = values | axis.at(place)
        try:
            experiment.with_values(there)
        except SetupError as error:
            refusal = refusal or error
        else:
            return there
    raise refusal or SetupError(f"{axis.dim}: no values")


def _at(axes: Collection[Axis], point: int) -> dict[str, Any]:
    """The values of the fields at the point of this number, the last axis fastest."""
    places = np.unravel_index(point, tuple(axis.size for axis in axes)) if axes else ()
    found: dict[str, Any] = {}
    for axis, place in zip(axes, places, strict=True):
        found |= axis.at(int(place))
    return found


def _spread(shape: tuple[int, ...], count: int) -> tuple[int, ...]:
    """The numbers of about `count` points, evenly spread over the first two axes."""
    if not 0 < count < math.prod(shape):
        return tuple(range(min(count, math.prod(shape))))
    most = math.isqrt(count) if len(shape) > 1 else 1
    across = max(n for n in range(1, most + 1) if count % n == 0)
    wanted = [count // across, across, *[1] * len(shape)]
    places = [
        np.unique((np.arange(n) + 0.5) * size // n).astype(int)
        for n, size in zip(wanted, shape, strict=False)
    ]
    grid = np.meshgrid(*places, indexing="ij")
    return tuple(np.ravel_multi_index([g.ravel() for g in grid], shape).tolist())


def thinned(size: int, count: int) -> tuple[int, ...]:
    """About `count` of so many places, the first and last among them."""
    return tuple(np.unique(np.linspace(0, size - 1, min(size, count)).round().astype(int)).tolist())
