"""A pour that is killed at any moment, again and again, ends as the archive of one that was not.

Real processes are killed by SIGKILL at random moments. And of a pour that nobody kills the files
are copied before and after each change to them, which is all that a kill could leave behind.
"""

import json
import os
import random
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from zygote import CASES, PHASES, pour

from experiment import Experiment
from experiment.archive import read
from experiment.archive.digest import DIGEST, digest_of
from experiment.archive.storage import read_whole
from experiment.pouring import pour_in_memory
from experiment.pouring.extension import STATE, extended
from experiment.pouring.slabs import Slab
from experiment.pouring.work import Work, work_folder

HERE = Path(__file__).parent
KILLS = int(os.environ.get("STRATIFY_KILLS", "100"))
LONGEST = 0.2  # s; about as long as it takes to put an archive together
PATIENCE = 1.05  # so much longer each time, or it would never come to its end
AT_MOST = 20  # of the states in which a kill may leave files
KINDS = ("new", "force")
EXTENDED = [name for name, case in CASES.items() if case.longer > 1]


class Killer:
    """Pours that are killed after a while, each in a real process of its own."""

    def __init__(self) -> None:
        self.kills: Counter[str] = Counter()  # by what the pour was doing
        self._zygote = subprocess.Popen(
            [sys.executable, "-W", "error", str(HERE / "zygote.py")],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=os.environ | {"PYTHONPATH": str(HERE.parent), "OPENBLAS_NUM_THREADS": "1"},
        )
        assert self._told(), "one that forks may have no other threads"

    def pour(self, case: str, path: Path, delay: float, **options: bool) -> bool:
        """Whether the pour came to its end before it was killed."""
        asked = {"case": case, "path": str(path), "delay": delay, **options}
        self._zygote.stdin.write(json.dumps(asked) + "\n")
        self._zygote.stdin.flush()
        told = self._told()
        assert told["status"] in (0, -9), told
        if told["status"]:
            self.kills[told["phase"]] += 1
        return told["status"] == 0

    def _told(self) -> Any:
        return json.loads(self._zygote.stdout.readline())

    def close(self) -> None:
        self._zygote.stdin.close()
        assert self._zygote.wait(10) == 0
        self._zygote.stdout.close()


@pytest.fixture(scope="module")
def killer() -> Iterator[Killer]:
    killer = Killer()
    yield killer
    killer.close()


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """The archive of an uninterrupted pour, of all its `times` its duration from the first."""
    folder, poured = tmp_path_factory.mktemp("whole"), {}

    def archive(case: str, times: int = 1) -> Path:
        if (case, times) not in poured:
            poured[case, times] = path = folder / f"{case}-{times}.nc"
            if times > 1:
                shutil.copy(archive(case), path)
            pour(case, str(path), extend=times > 1, every=1e9)
        return poured[case, times]

    return archive


def content(path: Path) -> xr.Dataset:
    """All that an archive holds, but for when it was written."""
    archive = read(path)
    assert "poured by stratify" in archive.attrs.pop("history")
    return archive


def assert_same(path: Path, whole: Path) -> None:
    """Every variable and attribute but the date, and the state in which the pour ended."""
    with xr.open_dataset(path) as there, xr.open_dataset(whole) as expected:
        assert there.attrs[DIGEST] == expected.attrs[DIGEST] == digest_of(there)
    xr.testing.assert_identical(content(path), content(whole))
    assert (content(path)["time"].diff("time") > 0).all()
    xr.testing.assert_identical(read_whole(path, STATE), read_whole(whole, STATE))
    assert not work_folder(path).exists()


@pytest.mark.parametrize("case", CASES)
def test_a_pour_to_disk_is_the_pour_in_memory(case: str, whole) -> None:
    """Whatever slabs and checkpoints it makes on its way."""
    path = whole(case)
    in_memory = pour_in_memory(CASES[case].begin, CASES[case].experiment(), None)
    del in_memory.attrs["history"]
    xr.testing.assert_identical(content(path), in_memory)


@pytest.mark.parametrize("case", CASES)
def test_checkpoints_change_nothing(case: str, whole, tmp_path: Path) -> None:
    pour(case, str(tmp_path / "pour.nc"))
    assert_same(tmp_path / "pour.nc", whole(case))
    assert [path.name for path in tmp_path.iterdir()] == ["pour.nc"]


@pytest.mark.parametrize("case", EXTENDED)
def test_an_extended_pour_is_one_that_was_longer_from_the_start(
    case: str, whole, tmp_path: Path
) -> None:
    at_once = pour_in_memory(CASES[case].begin, extended_setup(case), None)
    del at_once.attrs["history"]
    xr.testing.assert_identical(content(whole(case, CASES[case].longer)), at_once)
    shutil.copy(whole(case), tmp_path / "pour.nc")
    pour(case, str(tmp_path / "pour.nc"), extend=True)
    assert_same(tmp_path / "pour.nc", whole(case, CASES[case].longer))


def extended_setup(case: str) -> Experiment:
    """The longer pour, recorded as often as the shorter one."""
    return extended(CASES[case].experiment(CASES[case].longer), CASES[case].experiment())


def test_pours_are_killed_in_all_they_do_and_end_as_if_nobody_had(
    killer: Killer, whole, tmp_path: Path
) -> None:
    """At any moment the file under the final name is absent, the old one or the new one."""
    dice, cases = random.Random(1), list(CASES)
    while killer.kills.total() < KILLS:
        case = cases.pop(0)
        cases.append(case)
        path = tmp_path / f"{case}.nc"
        kind = dice.choice(["new", "force", "extend"]) if case in EXTENDED else dice.choice(KINDS)
        old, new = None, whole(case)
        if kind == "force":
            old = whole(dice.choice([other for other in CASES if other != case]))
        elif kind == "extend":
            old, new = new, whole(case, CASES[case].longer)
        if old is not None:
            shutil.copy(old, path)
        options = {kind: True} if old is not None else {}
        kill_until_done(killer, dice, case, path, old, new, options)
        assert [entry.name for entry in tmp_path.iterdir()] == [path.name]
        path.unlink()
    sys.stdout.write(f"{killer.kills.total()} kills: {dict(killer.kills)}\n")
    assert set(killer.kills) >= set(PHASES[:4]), "of clearing up there is little to be killed in"


def kill_until_done(killer, dice, case, path, old, new, options) -> None:
    """Pour a case, be killed, resume and so on; look at the archive each time."""
    longest, before = LONGEST, None if old is None else old.read_bytes()
    while not killer.pour(case, path, dice.uniform(0.0, longest), resume=True, **options):
        longest *= PATIENCE
        if not path.exists():
            assert old is None
        elif path.read_bytes() != before:
            assert_same_content(path, new)
    assert_same(path, new)


def assert_same_content(path: Path, whole: Path) -> None:
    with xr.open_dataset(path) as there, xr.open_dataset(whole) as expected:
        assert digest_of(there) == there.attrs[DIGEST] == expected.attrs[DIGEST]


@pytest.mark.parametrize(
    ("case", "kind", "every"),
    [
        ("toppling, extended", "extend", 0.0),
        ("pulses, extended", "extend", 0.0),
        ("dug up again", "force", 0.0),
    ],
)
def test_whatever_a_kill_leaves_behind_is_gone_on_from(
    case: str, kind: str, every: float, whole, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every state that the files go through, one change after the other."""
    path, new = tmp_path / "0" / "pour.nc", whole(case, CASES[case].longer)
    old = whole(case) if kind == "extend" else whole("poisson")
    path.parent.mkdir()
    shutil.copy(old, path)
    left: list[Path] = []
    with monkeypatch.context() as patched:
        for name in ("replace", "unlink", "rmdir"):
            patched.setattr(os, name, copying(getattr(os, name), path.parent, left))
        pour(case, str(path), every=every, **{kind: True})
    assert_same(path, new)
    assert len(left) > 20
    for folder in random.Random(0).sample(left, min(len(left), AT_MOST)):
        path = folder / "pour.nc"
        if path.read_bytes() != old.read_bytes():
            assert_same_content(path, new)
        pour(case, str(path), every=1e9, resume=True, **{kind: True})
        assert_same(path, new)
        assert list(folder.iterdir()) == [path]


def copying(change: Callable[..., Any], folder: Path, left: list[Path]) -> Callable[..., Any]:
    """The same change to a file, with copies of `folder` before and after it."""
    copied: set[tuple[tuple[str, int], ...]] = set()

    def copy() -> None:
        files = [path for path in folder.rglob("*") if path.is_file()]
        there = tuple(sorted((str(path), path.stat().st_ino) for path in files))
        if there not in copied:
            copied.add(there)
            left.append(folder.parent / f"{change.__name__}-{len(left)}")
            shutil.copytree(folder, left[-1])

    def changing(*args: Any, **options: Any) -> None:
        copy()
        change(*args, **options)
        copy()

    return changing


def test_a_slab_that_was_dug_up_stays_where_a_checkpoint_may_name_it(tmp_path: Path) -> None:
    """And none that is laid later takes its place."""
    work = Work(tmp_path, 1e9, lambda: False)
    slabs = [
        Slab(np.array([k]), np.array([k + 1]), np.array([0, 1]), np.array([[1.0 + k]]))
        for k in range(4)
    ]
    work.lay(slabs[0])
    work.lay(slabs[1])
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    assert work.take_back().pieces == slabs[1].pieces
    work.lay(slabs[2])
    work.lay(slabs[3])
    assert {path: path.read_bytes() for path in before} == before
    left = [slab.pieces.item() for slab in work.reaching(0, 9)]
    assert left == [1.0, 3.0, 4.0]
