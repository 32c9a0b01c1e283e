"""A phase diagram: a set-up poured by both models at each point, in memory or into a file."""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import xarray as xr

from compare.campaign import POUR, Scheduler, scheduler_of
from compare.phase.axes import axes_of
from compare.phase.findings import PLAN, Findings
from compare.phase.journal import Journal, journal_beside
from compare.phase.plan import Plan, plan_of
from experiment import Experiment, OutputExistsError, StratifyError
from experiment.archive.files import refuse_existing, refuse_folder
from experiment.archive.storage import read_whole, write_whole
from experiment.pouring import Progress

__all__ = ["phase", "phase_to_file"]

LINES = 16


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
    refuse_folder(path)
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
) -> Findings:
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
    if found.left():
        raise StratifyError(f"{len(found.left())} of {len(plan)} jobs were not done")
    return found
