"""A pour to disk: records and deposit are streamed, and the archive is whole or absent.

It can be stopped, or be killed, at any moment, and goes on from its last checkpoint to the archive
that it would have come to anyway.
"""

from collections.abc import Callable
from pathlib import Path

from experiment.archive.files import put_in_place, refuse_existing, writing
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
        if in_store(path):
            make_ready(path, folder)
        refuse_existing([path], force=force or resume or extend)
        work = Work(folder, every, stop)
        if extend:
            there = _experiment_at(path)
            if resume and experiment.pour.duration == there.pour.duration:
                refuse_another_setup(experiment, there)
                if work.is_begun and not work.pours(there):
                    raise OutputExistsError(f"{str(folder)!r} holds a longer pour, unfinished")
                work.clear()
                return False
            experiment = extended(experiment, there)
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


def _take_up(
    pouring: Pouring, work: Work, path: Path, *, resume: bool, extend: bool, force: bool
) -> bool:
    """Take `pouring` to where it is to go on; False where its archive is there already."""
    if work.is_begun and not (resume or force):
        raise OutputExistsError(
            f"{str(work.folder)!r} holds an unfinished pour; --resume goes on with it, "
            "--force begins anew"
        )
    if resume and not extend and path.exists():
        other = _difference(pouring, path, force=force)
        if other and not force:
            raise OutputExistsError(
                f"{str(path)!r} is of another pour: {other}; --force replaces it"
            )
        if not other and not work.is_begun:
            work.clear()
            return False
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


def _experiment_at(path: Path) -> Experiment:
    with opened(path) as archive:
        return experiment_of(archive)
