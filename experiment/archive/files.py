"""Files that are whole or absent: written under a temporary name, then renamed."""

import os
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from experiment.errors import ArchiveError, OutputExistsError

__all__ = [
    "make_folder",
    "put_in_place",
    "refuse_existing",
    "refuse_folder",
    "size_of",
    "sync",
    "whole_file",
    "writing",
]


def refuse_existing(paths: Iterable[Path], *, force: bool) -> None:
    """Raise :class:`OutputExistsError` for a path that exists, unless `force` is given."""
    for path in paths:
        if path.exists() and not force:
            raise OutputExistsError(f"{str(path)!r} exists already; --force replaces it")


def refuse_folder(path: Path) -> None:
    """Raise :class:`ArchiveError` where a folder has the name that a file is to have."""
    if path.is_dir():
        raise ArchiveError(f"{str(path)!r} cannot be written: it is a folder")


def make_folder(folder: Path) -> None:
    """Make `folder` if it is not there. Raises :class:`ArchiveError` where nothing can go in."""
    missing = [made for made in (folder, *folder.parents) if not made.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for made in missing:
            sync(made.parent)
    except OSError as error:
        reason = error.strerror or error
        raise ArchiveError(f"folder {str(folder)!r} cannot be written: {reason}") from None
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ArchiveError(f"folder {str(folder)!r} cannot be written: it is read-only")


@contextmanager
def whole_file(path: Path, *, force: bool = False) -> Iterator[Path]:
    """A temporary file beside `path`, of its ending, that takes its name once all is well.

    Raises :class:`OutputExistsError` where `path` exists and `force` is not given, and
    :class:`ArchiveError` where it cannot be written.
    """
    refuse_existing([path], force=force)
    with writing(path):
        make_folder(path.parent)
        handle, name = tempfile.mkstemp(path.suffix, f".{path.stem}.part-", path.parent)
        os.close(handle)
        part = Path(name)
        try:
            yield part
            part.chmod(0o644)
            put_in_place(part, path)
        finally:
            part.unlink(missing_ok=True)


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Raise :class:`ArchiveError` where what is to become `path` cannot be written."""
    try:
        yield
    except (OSError, RuntimeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ArchiveError(f"{str(path)!r} cannot be written: {reason}") from None


def put_in_place(part: Path, path: Path) -> None:
    """Let the finished file `part` take the name of `path`, in the same folder or below, for good.

    First its content is on the disk, then its name.
    """
    sync(part)
    part.replace(path)
    sync(path.parent)


def size_of(path: Path) -> int:
    """The size [bytes] of a file, or of a folder and all in it."""
    return sum(entry.stat().st_size for entry in (path, *path.rglob("*")))


def sync(path: Path) -> None:
    """Wait until the file or folder `path` is on the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
