"""A pour's work in progress: a folder beside the archive that is to be.

    run.nc.unfinished/
        lock                held by the process that pours
        records-0.nc ...    records, from the one of that number on
        slab-0.nc ...       slabs of the deposit
        checkpoint.nc       the state of the model, and which of the other files belong to it

Every file is whole or absent, and a checkpoint is the moment in which checkpoint.nc takes its name.
What lies beside it without being named in it was written later, and is dropped by who goes on.
"""

import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import netCDF4
import numpy as np
from filelock import FileLock, Timeout

from experiment.archive.digest import DIGEST, refuse_damaged
from experiment.archive.files import make_folder
from experiment.archive.places import beside
from experiment.archive.provenance import difference, stamp
from experiment.archive.storage import holds, opened, read_whole, reading, told_by, write_whole
from experiment.arrays import Floats
from experiment.errors import ArchiveError, OutputExistsError, StoppedError
from experiment.experiment import Experiment
from experiment.pouring.extension import STATE, Base
from experiment.pouring.loop import Pouring
from experiment.pouring.recorder import Recorder, record_steps
from experiment.pouring.slabs import Slab
from experiment.pouring.state import State, arrays_in, bare_dataset

__all__ = ["Work", "locked", "work_folder"]

CHECKPOINT = "checkpoint.nc"
LOCK = "lock"
ROOM = 2**24  # bytes of records in memory

Records = dict[str, Floats]


def work_folder(path: Path) -> Path:
    """Where the work on the archive at `path` goes on."""
    plain = beside(path)
    return plain.with_name(f"{plain.name}.unfinished")


@contextmanager
def locked(path: Path) -> Iterator[Path]:
    """The folder for the work on the archive at `path`, which no other process may enter.

    It is gone afterwards if nothing is left in it. Raises :class:`OutputExistsError` where another
    process is in it, and :class:`ArchiveError` where it cannot be written.
    """
    folder = work_folder(path)
    for made in (path.parent, folder):
        make_folder(made)
    lock = FileLock(folder / LOCK, timeout=0)
    try:
        lock.acquire()
    except Timeout:
        raise OutputExistsError(f"{str(path)!r} is being poured by another process") from None
    except OSError as error:
        reason = error.strerror or error
        raise ArchiveError(f"folder {str(folder)!r} cannot be written: {reason}") from None
    try:
        yield folder
    finally:
        if folder.exists() and not any(entry.name != LOCK for entry in folder.iterdir()):
            shutil.rmtree(folder, ignore_errors=True)
        lock.release()


class Work:
    """The records and slabs of a pour on disk: its :class:`Keeper` and its :class:`Slabs`.

    A checkpoint is made every so many seconds, and when `stop` says so; records are written when
    they fill the memory meant for them, too.
    """

    def __init__(self, folder: Path, every: float, stop: Callable[[], bool]) -> None:
        self.folder = folder
        self.base: Base | None = None
        self.steps = self.records = 0
        self._every, self._stop = every, stop
        self._due = time.monotonic() + every
        self._record_files: list[int] = []  # the first record of each
        self._slabs: list[tuple[int, int, int]] = []  # number, lowest and highest bin
        self._next_slab = 0
        self._recorder: Recorder | None = None

    def keep(self, **values: float | Floats) -> None:
        """Keep one record."""
        if self._recorder is None:
            rolling = np.shape(values["rolling_thickness"])
            size = sum(np.size(value) for value in values.values()) * 8
            self._recorder = Recorder(max(1, ROOM // size), *rolling)
        self._recorder.keep(**values)
        self.records += 1

    def pause(self, pouring: Pouring) -> None:
        """Put a checkpoint down if it is time. Raises :class:`StoppedError` if told to stop."""
        stop = self._stop()
        self.refuse_if_gone()
        if self._recorder is not None and self._recorder.is_full:
            self._write_records()
        if stop or time.monotonic() >= self._due:
            self.checkpoint(pouring)
        if stop:
            last = record_steps(pouring.experiment.pour, pouring.dt)[-1]
            raise StoppedError(f"stopped after {self.steps} of {last} steps")

    def checkpoint(self, pouring: Pouring) -> None:
        """Write what a pour needs that goes on from here."""
        pouring.bury()
        self._write_records()
        base = {} if self.base is None else {"floor": self.base.floor}
        dataset = bare_dataset(base | pouring.state()).assign_attrs(
            stamp(pouring.model, pouring.experiment),
            base="" if self.base is None else self.base.digest,
            steps=self.steps,
            records=self.records,
            record_files=self._record_files,
            slabs=np.array(self._slabs, dtype=np.int64).ravel(),
        )
        write_whole(dataset, self.folder / CHECKPOINT, force=True, squeeze=False)
        self._drop_strays()
        self._due = time.monotonic() + self._every

    def refuse_if_gone(self) -> None:
        """Raise :class:`ArchiveError` where the folder is no longer there."""
        if not (self.folder / LOCK).exists():
            raise ArchiveError(f"folder {str(self.folder)!r} is gone, and the work with it")

    def refuse_another(self, experiment: Experiment) -> None:
        """Raise :class:`OutputExistsError` where there is a checkpoint of another pour."""
        if not self.is_begun:
            return
        if told_by(self.folder / CHECKPOINT, "experiment") != experiment.to_toml():
            raise OutputExistsError(f"{str(self.folder)!r} holds another pour, unfinished")

    @property
    def is_begun(self) -> bool:
        """Whether there is a checkpoint."""
        return (self.folder / CHECKPOINT).exists()

    def clear(self) -> None:
        """Remove all there is, the checkpoint first."""
        (self.folder / CHECKPOINT).unlink(missing_ok=True)
        self._record_files, self._slabs = [], []
        self._drop_strays()

    def go_on(self, pouring: Pouring, path: Path) -> None:
        """Take `pouring` to the checkpoint; what was written after it is dropped.

        If the archive at `path` was being extended, that goes on too. Raises :class:`ArchiveError`
        where the work is damaged, or belongs to another pour, or to another archive.
        """
        try:
            checkpoint = read_whole(self.folder / CHECKPOINT)
        except ArchiveError as error:
            raise ArchiveError(f"{error}; --force without --resume begins anew") from None
        told, state = checkpoint.attrs, arrays_in(checkpoint)
        if other := difference(told, stamp(pouring.model, pouring.experiment)):
            raise ArchiveError(f"{str(self.folder)!r} holds another pour: {other}")
        if told["base"]:
            self.base = Base(path, told["base"], state.pop("floor"))
            self.base.refuse_another()
        self.steps, self.records = int(told["steps"]), int(told["records"])
        self._record_files = np.atleast_1d(told["record_files"]).astype(int).tolist()
        slabs = np.atleast_1d(told["slabs"]).astype(int).reshape(-1, 3)
        self._slabs = [(int(number), int(low), int(high)) for number, low, high in slabs]
        self._next_slab = 1 + max((number for number, *_ in self._slabs), default=-1)
        for file in self._files():
            with reading(file):
                refuse_damaged(file)
        self._drop_strays()
        _restore(pouring, state, self.folder)

    def extend(self, pouring: Pouring, path: Path) -> None:
        """Take `pouring` to the end of the archive at `path`.

        Raises :class:`ArchiveError` where that did not keep the state in which it ended.
        """
        with opened(path) as archive:
            digest, source = archive.attrs[DIGEST], archive.attrs["source"]
            time = archive["time"].values
        if source != stamp(pouring.model, pouring.experiment)["source"]:
            raise ArchiveError(f"{str(path)!r} cannot be extended: it is by {source}")
        if not holds(path, STATE):
            raise ArchiveError(f"{str(path)!r} cannot be extended: it holds no state of its end")
        recorded = record_steps(pouring.experiment.pour, pouring.dt)[: len(time)]
        if not np.array_equal(np.array(recorded) * pouring.dt, time):
            raise ArchiveError(
                f"{str(path)!r} cannot be extended to {pouring.experiment.pour.duration:g} s: by "
                "round-off its records would be of other steps; another duration may do"
            )
        self.steps, self.records = recorded[-1], len(recorded)
        _restore(pouring, arrays_in(read_whole(path, STATE)), path)
        self.base = Base(path, digest, pouring.floor())

    def _write_records(self) -> None:
        if self._recorder is None or not self._recorder.kept:
            return
        first = self.records - self._recorder.kept
        block = bare_dataset(self._recorder.arrays)
        write_whole(block, self._records_file(first), force=True, squeeze=False)
        self._record_files.append(first)
        self._recorder.forget()

    def recorded(self) -> Iterator[tuple[int, Records]]:
        """The records by and by: the number of a first one, and variables from it on."""
        if self.base is not None:
            yield from self.base.recorded()
        for first in self._record_files:
            block = read_whole(self._records_file(first))
            yield first, arrays_in(block)
        if self._recorder is not None and self._recorder.kept:
            yield self.records - self._recorder.kept, self._recorder.arrays

    def lay(self, slab: Slab) -> None:
        """Put a slab on top."""
        number = self._next_slab
        whole = bare_dataset(slab._asdict())
        write_whole(whole, self._slab_file(number), force=True, squeeze=False)
        self._slabs.append((number, int(slab.bottom.min()), int(slab.top.max())))
        self._next_slab += 1

    def take_back(self) -> Slab:
        """Take the topmost slab off again.

        Raises :class:`ArchiveError` where it is of the archive that is being extended, which kept
        the composition of what lies so deep, but not the grains.
        """
        if self.base is not None and not self._slabs:
            raise ArchiveError(
                f"{str(self.base.path)!r} cannot be extended so far: the flow would dig up what it "
                "handed on; the longer set-up can be poured from its start"
            )
        number, *_ = self._slabs.pop()
        stored = read_whole(self._slab_file(number))
        return Slab(*(stored[name].values for name in Slab._fields))

    def reaching(self, low: int, high: int) -> Iterator[Slab]:
        """The slabs that have something from bin `low` up to `high`, lowest first."""
        for number, lowest, highest in self._slabs:
            if lowest < high and highest > low:
                with reading(self._slab_file(number)):
                    part = _part_of_slab(self._slab_file(number), low, high)
                yield part

    def _records_file(self, first: int) -> Path:
        return self.folder / f"records-{first}.nc"

    def _slab_file(self, number: int) -> Path:
        return self.folder / f"slab-{number}.nc"

    def _files(self) -> list[Path]:
        """The records and slabs that there are."""
        records = [self._records_file(first) for first in self._record_files]
        return records + [self._slab_file(number) for number, *_ in self._slabs]

    def _drop_strays(self) -> None:
        """Remove what belongs to no checkpoint."""
        known = {self.folder / CHECKPOINT, self.folder / LOCK, *self._files()}
        for entry in self.folder.iterdir():
            if entry in known:
                continue
            if entry.is_dir():
                shutil.rmtree(entry)
            else:
                entry.unlink(missing_ok=True)


def _restore(pouring: Pouring, state: State, source: Path) -> None:
    try:
        pouring.restore(state)
    except (LookupError, ValueError) as error:
        raise ArchiveError(f"{str(source)!r} holds no state of this pour: {error}") from None


def _part_of_slab(path: Path, low: int, high: int) -> Slab:
    """A slab of which only the columns that reach into the bins from `low` up to `high` are read.

    The others have an empty share.
    """
    with netCDF4.Dataset(path) as file:
        file.set_auto_mask(False)
        bottom, top, ends = (file[name][:] for name in ("bottom", "top", "ends"))
        touched = np.flatnonzero((bottom < high) & (top > low))
        first, last = (int(touched[0]), int(touched[-1]) + 1) if len(touched) else (0, 0)
        pieces = file["pieces"][ends[first] : ends[last]]
    return Slab(bottom, top, np.clip(ends, ends[first], ends[last]) - ends[first], pieces)
