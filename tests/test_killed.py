"""A pour that is killed at any moment, again and again, ends as the archive of one that was not.

Real processes are killed by SIGKILL at random moments; and of a pour that nobody kills the files are
copied before and after each single change to them, which are all that a kill could leave behind.
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

import pytest
import xarray as xr
from zygote import CASES, PHASES, pour

from experiment.archive import read
from experiment.digest import DIGEST, digest_of
from experiment.extension import STATE
from experiment.storage import read_whole
from experiment.work import work_folder

HERE = Path(__file__).parent
KILLS = int(os.environ.get("STRATIFY_KILLS", "110"))
LONGEST = 0.2  # s; about as long as it takes to put an archive together
PATIENCE = 1.05  # so much longer each time, or it would never come to its end
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
def test_a_pour_to_disk_is_the_pour_in_memory(case: str, whole, models) -> None:
    """Whatever slabs and checkpoints it makes on its way."""
    path = whole(case)
    in_memory = models[CASES[case].model].pour(CASES[case].experiment())
    del in_memory.attrs["history"]
    xr.testing.assert_identical(content(path), in_memory)


@pytest.mark.parametrize("case", CASES)
def test_checkpoints_change_nothing(case: str, whole, tmp_path: Path) -> None:
    pour(case, str(tmp_path / "pour.nc"))
    assert_same(tmp_path / "pour.nc", whole(case))
    assert [path.name for path in tmp_path.iterdir()] == ["pour.nc"]


@pytest.mark.parametrize("case", EXTENDED)
def test_an_extended_pour_is_one_that_was_longer_from_the_start(case, whole, tmp_path) -> None:
    pass
