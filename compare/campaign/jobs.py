"""One pour of many: what is poured, and what comes of it."""

from collections.abc import Callable, Generator, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import xarray as xr

import ca_model
import continuum
from compare.deposit.picture import picture_of
from compare.measurement import numbers_of
from compare.quantities import (
    Quantity,
    cell_length,
    collision_rate,
    quantity,
    total_inflow,
    velocity,
)
from experiment import Experiment, StratifyError
from experiment.arrays import Floats
from experiment.pouring import Begin

__all__ = [
    "AHEAD",
    "BEGIN",
    "CHECK",
    "LOST",
    "POUR",
    "Job",
    "Numbered",
    "Outcome",
    "Outcomes",
    "Pour",
    "Scheduler",
    "do",
    "failed",
    "with_chance",
]

POUR: dict[str, Callable[..., xr.Dataset]] = {
    "ca_model": ca_model.pour,
    "continuum": continuum.pour,
}
BEGIN: dict[str, Begin] = {"ca_model": ca_model.begin, "continuum": continuum.begin}
CHECK = {"ca_model": ca_model.check, "continuum": continuum.check}

AHEAD = 3  # jobs for each worker, of which one is done and the others wait
LOST = "it was lost with its process, more than once, perhaps for want of memory"

Attributes = Mapping[str, Mapping[str, str]]


class Outcome(NamedTuple):
    """What came of a job: its numbers and words by name, or why there are none."""

    measured: dict[str, float | str]
    attributes: Attributes  # of what was measured
    failure: str = ""
    picture: Floats | None = None  # (row, column) of the deposit, where it was asked for


@dataclass(frozen=True)
class Pour:
    """A set-up to be poured by a model and measured, some fields of it at other values."""

    model: str
    experiment: Experiment
    values: Mapping[str, object] = field(default_factory=dict)
    picture: bool = False

    def __call__(self) -> Outcome:
        """Pour and measure."""
        experiment = self.experiment.with_values(self.values) if self.values else self.experiment
        archive = POUR[self.model](experiment)
        numbers, _ = numbers_of(archive)
        found = numbers | _scales(archive)
        return Outcome(
            {name: _plain(value) for name, (_, value, _) in found.items()},
            {name: attributes for name, (_, _, attributes) in found.items()},
            picture=picture_of(archive) if self.picture else None,
        )


Job = Callable[[], Outcome]
Numbered = tuple[int, Job]
Outcomes = Generator[tuple[int, Outcome], None, None]  # with the number of each job
Scheduler = Callable[[Iterable[Job]], Outcomes]


def do(job: Job) -> Outcome:
    """What comes of `job`; an error in one of many is told as its outcome, and the others go on."""
    try:
        return job()
    except StratifyError as error:
        return failed(str(error))
    except Exception as error:
        return failed(f"{type(error).__name__}: {error}")


def _plain(value: Any) -> float | str:
    """A number or a word of no library's own type, which travels light between processes."""
    return value if isinstance(value, str) else float(value)


def failed(reason: str) -> Outcome:
    """The outcome of a job that has none, and why."""
    return Outcome({}, {}, " ".join(reason.split()))


def with_chance(experiment: Experiment, model: str) -> bool:
    """Whether pours that differ in `pour.pile` only are different in `model`."""
    if model != "ca_model":
        return False
    settings = ca_model.Settings.parse(experiment.ca_model, "ca_model")
    toppling_at_random = settings.rule == "toppling" and settings.threshold_spread > 0
    return settings.rule == "rate" or toppling_at_random or settings.arrivals != "fixed"


def _scales(archive: xr.Dataset) -> dict[str, Quantity]:
    r0, v, gamma = total_inflow(archive), velocity(archive), collision_rate(archive)
    length = cell_length(archive)
    return {
        "slope_length": quantity(length, "cm", "length L of the slope"),
        "total_inflow": quantity(r0, "cm", "thickness R0 of what is poured"),
        "drift_velocity": quantity(v, "cm s-1", "velocity v of what is poured"),
        "collision_rate": quantity(gamma, "s-1", "rate gamma of what is poured"),
    }
