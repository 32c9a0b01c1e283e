"""A phase diagram: what both models measure at each point, as one Dataset over what varies."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from compare.campaign import POUR, Outcome, Scheduler, Table, scheduler_of
from compare.phase.axes import axes_of
from compare.phase.boundary import boundary
from compare.phase.journal import Journal, journal_beside
from compare.phase.plan import Plan, plan_of
from compare.phase.theory import ONSET
from compare.quantities import named
from experiment import Experiment, OutputExistsError
from experiment.archive.files import refuse_existing
from experiment.archive.layout import CONVENTIONS, REFERENCES, history
from experiment.archive.provenance import made_by
from experiment.archive.storage import read_whole, write_whole
from experiment.arrays import Floats

__all__ = ["phase", "phase_to_file"]

LINES = 16
PLAN = "plan_sha256"
Progress = Callable[[float], object]


def phase(
    experiment: Experiment,
    vary: Mapping[str, Iterable[Any]],
    models: Sequence[str] = tuple(POUR),
    *,
    draw: Mapping[str, tuple[float, float]] | None = None,
    draws: int = 0,
    deposits: int = 0,
    lines: int = LINES,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
) -> xr.Dataset:
    """What both `models` do at each point of a diagram over fields of the set-up.

    `vary` says which values each field takes, such as {"mixture.delta": [-0.1, 0.0, 0.1]}; so many
    `draws` are made of those in `draw`, each between two ends. A Dataset over one dimension for
    each field of `vary`, over `draw` where there are draws, and over `model`:

    - regime, and all other numbers that :func:`compare.measure` finds, with their errors;
    - failure: why a point has none, where it has none;
    - slope_length L [cm], total_inflow R0 [cm], drift_velocity v [cm/s] and collision_rate gamma
      [1/s], the scales of the pour;
    - deposit(picture, row, column): so many `deposits`, evenly spread, as small pictures; the
      number of its point, picture_point, and of its model, picture_model;
    - layered_from: the value of the first field from which on there are layers, with its error and
      the points on the wrong side of it, as :mod:`compare.phase.boundary` says;
    - spectrum_onset: the value of the first field from which on disturbances of the steady pile
      grow, along so many `lines` across its axis; NaN where that was not asked or is not known.

    `workers`, `scheduler` and `progress` are those of :func:`compare.campaign`. Raises
    :class:`SetupError` where a field cannot vary so, or a model cannot pour at all.
    """
    plan = plan_of(experiment, axes_of(vary, draw, draws), models, deposits, lines)
    share_out = scheduler_of(workers, scheduler, len(plan))
    return _worked_out(plan, share_out, progress).dataset()


def phase_to_file(
    plan: Plan,
    path: Path,
    scheduler: Scheduler,
    *,
    resume: bool = False,
    force: bool = False,
    progress: Progress | None = None,
) -> xr.Dataset:
    """The diagram of `plan`, written to `path`; each outcome is on disk as soon as it is there.

    With `resume` a diagram that did not end, however it was stopped, goes on with the jobs that are
    left; one that did is read. Raises :class:`OutputExistsError` for what is in the way and not to
    be replaced by `force`, and :class:`ArchiveError` for what cannot be written or gone on with.
    """
    refuse_existing([path], force=force or resume)
    whole = _whole(path, plan) if path.exists() and not force else None
    with journal_beside(path, plan, resume=resume, force=force) as journal:
        if whole is not None:
            return whole
        diagram = _worked_out(plan, scheduler, progress, journal).dataset()
        write_whole(diagram, path, force=force)
    return diagram


def _whole(path: Path, plan: Plan) -> xr.Dataset:
    """The diagram at `path`. Raises :class:`OutputExistsError` where it is not that of `plan`."""
    diagram = read_whole(path)
    if diagram.attrs.get(PLAN) != plan.digest:
        raise OutputExistsError(f"{str(path)!r} is another diagram; --force replaces it")
    return diagram


def _worked_out(
    plan: Plan,
    scheduler: Scheduler,
    progress: Progress | None = None,
    journal: Journal | None = None,
) -> "Findings":
    """What all jobs of `plan` tell, those that the `journal` has and those left."""
    found = Findings(plan)
    for number, outcome in journal.outcomes() if journal is not None else ():
        found.put(number, outcome)
    left = found.left()
    with closing(scheduler(plan.jobs(left))) as outcomes:
        for k, outcome in outcomes:
            found.put(left[k], outcome)
            if journal is not None:
                journal.keep(left[k], outcome)
            if progress is not None:
                progress(found.told / len(plan))
    return found


class Findings:
    """What the jobs of a plan told, as they come."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._pours, self._lines = Table(plan.pours), Table(len(plan.lines))
        self._pictures: dict[int, Floats] = {}

    @property
    def told(self) -> int:
        """How many jobs are done."""
        return int(self._pours.done.sum() + self._lines.done.sum())

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
        onset = np.full(int(np.prod(shape)), np.nan)
        onset[list(self._plan.lines)] = self._lines.values_of(ONSET)
        meaning = f"{key} from which on disturbances of the steady pile grow"
        return {ONSET: (dims, onset.reshape(shape), named(meaning, ""))}

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
