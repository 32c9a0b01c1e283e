"""A diagram's work in progress: each outcome on disk as it comes, for a diagram that is resumed.

    phase.nc.unfinished/
        lock                held by the process that makes the diagram
        outcomes.sqlite     what it is a diagram of, and the outcome of each job that is done

An outcome is there whole or not at all, whenever the process is killed.
"""

import json
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np

from compare.campaign import LOST, Outcome
from compare.deposit.picture import PIXEL, SHAPE
from compare.phase.plan import Plan
from experiment import ArchiveError, OutputExistsError
from experiment.pouring.work import locked

__all__ = ["Journal", "journal_beside"]

NAME = "outcomes.sqlite"
TABLES = """
PRAGMA journal_mode = WAL;
PRAGMA synchronous = NORMAL;
CREATE TABLE IF NOT EXISTS plan (name TEXT PRIMARY KEY, told TEXT);
CREATE TABLE IF NOT EXISTS quantity (name TEXT PRIMARY KEY, attributes TEXT);
CREATE TABLE IF NOT EXISTS outcome (
    job INTEGER PRIMARY KEY, measured TEXT, failure TEXT, picture BLOB
);
"""


@contextmanager
def journal_beside(path: Path, plan: Plan, *, resume: bool, force: bool) -> Iterator["Journal"]:
    """The journal of the diagram of `plan` that is to be at `path`; it is gone once all went well.

    With `resume` it goes on with the one that is there, with `force` it begins anew. Raises
    :class:`OutputExistsError` where one is there and neither is said, or another process has it,
    and :class:`ArchiveError` where it cannot be written or is of another diagram.
    """
    with locked(path) as folder, _on_disk(path):
        file = folder / NAME
        if file.exists() and not (resume or force):
            raise OutputExistsError(
                f"{str(folder)!r} holds an unfinished diagram; --resume goes on with it, "
                "--force begins anew"
            )
        if not resume:
            _forget(folder)
        with closing(sqlite3.connect(file)) as base:
            journal = Journal(base)
            journal.begin(plan)
            yield journal
        _forget(folder)


class Journal:
    """The outcomes of a plan's jobs, on disk."""

    def __init__(self, base: sqlite3.Connection) -> None:
        self._base = base
        base.executescript(TABLES)
        self._known = {name for (name,) in base.execute("SELECT name FROM quantity")}

    def begin(self, plan: Plan) -> None:
        """Say what the outcomes are of. Raises :class:`ArchiveError` where they are of another."""
        there = dict(self._base.execute("SELECT name, told FROM plan"))
        here = plan.told()
        other = [name for name in there if there[name] != here.get(name)]
        if other:
            raise ArchiveError(
                f"what is unfinished is another diagram: its {other[0]} differs; "
                "--force begins anew"
            )
        with self._base:
            self._base.executemany("INSERT OR IGNORE INTO plan VALUES (?, ?)", here.items())

    def keep(self, job: int, outcome: Outcome) -> None:
        """Put the outcome of a job on disk."""
        pixels = None if outcome.picture is None else outcome.picture.tobytes()
        new = {name: told for name, told in outcome.attributes.items() if name not in self._known}
        with self._base:
            self._base.execute(
                "INSERT OR REPLACE INTO outcome VALUES (?, ?, ?, ?)",
                (job, json.dumps(outcome.measured), outcome.failure, pixels),
            )
            self._base.executemany(
                "INSERT INTO quantity VALUES (?, ?)",
                ((name, json.dumps(told)) for name, told in new.items()),
            )
        self._known |= set(new)

    def outcomes(self) -> Iterator[tuple[int, Outcome]]:
        """The job and the outcome of all that is done; what was LOST is to be tried again."""
        rows = self._base.execute("SELECT name, attributes FROM quantity")
        attributes = {name: json.loads(told) for name, told in rows}
        for job, measured, failure, pixels in self._base.execute(
            "SELECT job, measured, failure, picture FROM outcome WHERE failure <> ?", (LOST,)
        ):
            picture = None if pixels is None else np.frombuffer(pixels, PIXEL).reshape(SHAPE)
            yield job, Outcome(json.loads(measured), attributes, failure, picture)


@contextmanager
def _on_disk(path: Path) -> Iterator[None]:
    """Raise :class:`ArchiveError` where the journal of the diagram at `path` cannot be used."""
    try:
        yield
    except sqlite3.Error as error:
        raise ArchiveError(f"the journal of {str(path)!r} cannot be used: {error}") from None


def _forget(folder: Path) -> None:
    """Remove the journal in `folder`, and what the database put beside it."""
    for file in folder.glob(f"{NAME}*"):
        file.unlink()
