"""A pour to disk: records and deposit are streamed, and the archive is whole or absent.

It can be stopped, or be killed, at any moment, and goes on from its last checkpoint to the archive
that it would have come to anyway.
"""

from collections.abc import Callable
from pathlib import Path

from experiment.archive.files import put_in_place, refuse_existing, refuse_folder, writing
from experiment.archive.layout import experiment_of
from experiment.archive.places import in_store
from experiment.archive.provenance import difference, stamp
from experiment.archive.storage import opened
from experiment.archive.zarr_store import fill_store, make_ready
from experiment.errors import ArchiveError, OutputExistsError
from experiment.experiment import Experiment
from experiment.pouring.assembly import assemble_on_disk
from experiment.pouring.extension import extended, refuse_another_setup
from experiment.pouring.loop import Begin, Pouring, Progress, run_to_the_end
from experiment.pouring.work import Work, locked

__all__ = ["Finish", "pour_to_file"]

EVERY = 30.0  # s
Finish = Callable[[Path, Pouring, Work], None]


def pour_to_file(
    begin: Begin,
    experiment: Experiment,
    path: Path,
    *,
    resume: bool = False,
    extend: bool = False,
    force: bool = False,
    every: float = EVERY,
    progress: Progress | None = None,
    stop: Callable[[], bool] = lambda: False,
    finish: Finish = assemble_on_disk,
) -> bool:
    """Pour `experiment` into the archive `path`; False where it is there already, to `resume`.

    With `resume` a pour that did not end goes on from its last checkpoint, of which there is one
    `every` so many seconds. With `extend` the pour goes on from the end of the archive that is
    there, to the longer duration of `experiment`. Nothing that exists is replaced without `force`,
    but by a pour that extends it, and then only once the new archive is whole.

    Raises :class:`StoppedError` where `stop` told to, :class:`OutputExistsError` for what is in the
    way, :class:`ArchiveError` for what cannot be read, written or gone on from,
    :class:`SetupError` where the set-up is not one to extend by, and what `begin` raises.
    """
    with locked(path) as folder:
        _refuse_what_is_in_the_way(path, folder, force=force or resume or extend)
        work = Work(folder, every, stop)
        if extend:
            experiment = _extending(experiment, path, resume=resume)
        pouring = begin(experiment, work)
        if not _take_up(pouring, work, path, resume=resume, extend=extend, force=force):
            return False
        run_to_the_end(pouring, work, progress)
        work.refuse_if_gone()
        with writing(path):
            part = folder / path.name
            finish(part, pouring, work)
            if in_store(path):
                fill_store(part, path)
            else:
                put_in_place(part, path)
        work.clear()
    return True


def _refuse_what_is_in_the_way(path: Path, folder: Path, *, force: bool) -> None:
    if in_store(path):
        make_ready(path, folder)
    else:
        refuse_folder(path)
    refuse_existing([path], force=force)


def _extending(asked: Experiment, path: Path, *, resume: bool) -> Experiment:
    """The pour that extends the archive at `path`, or that which did so before, to `resume`."""
    with opened(path) as archive:
        there = experiment_of(archive)
    if resume and asked.pour.duration == there.pour.duration:
        refuse_another_setup(asked, there)
        return there
    return extended(asked, there)


def _take_up(
    pouring: Pouring, work: Work, path: Path, *, resume: bool, extend: bool, force: bool
) -> bool:
    """Take `pouring` to where it is to go on; False where its archive is there already."""
    if work.is_begun and not (resume or force):
        raise OutputExistsError(
            f"{str(work.folder)!r} holds an unfinished pour; --resume goes on with it, "
            "--force begins anew"
        )
    if resume and path.exists():
        other = _difference(pouring, path, force=force)
        if not other:
            work.refuse_another(pouring.experiment)
            work.clear()
            return False
        if not (extend or force):
            raise OutputExistsError(
                f"{str(path)!r} is of another pour: {other}; --force replaces it"
            )
    if resume and work.is_begun:
        work.go_on(pouring, path)
        return True
    work.clear()
    if extend:
        work.extend(pouring, path)
    return True


def _difference(pouring: Pouring, path: Path, *, force: bool) -> str:
    """How what is at `path` differs from the archive of `pouring`; with `force` it may be none."""
    try:
        with opened(path) as archive:
            return difference(archive.attrs, stamp(pouring.model, pouring.experiment))
    except ArchiveError as error:
        if not force:
            raise
        return str(error)
