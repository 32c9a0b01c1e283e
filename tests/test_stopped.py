"""A pour that is stopped, or finds no room, says so in one line and harms nothing."""

import os
import re
import resource
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import netCDF4
import pytest
import xarray as xr
from zygote import CASES, ODD, pour

from compare.cli.stopping import Stop
from experiment import ArchiveError, OutputExistsError, SetupError, StoppedError
from experiment.archive import read
from experiment.archive.digest import DIGEST
from experiment.archive.storage import read_whole, seal, write_whole
from experiment.pouring.work import CHECKPOINT, work_folder

STRATIFY = Path(sys.executable).parent / "stratify"
ROOT = Path(__file__).parent.parent
LONG = [  # seconds of pouring, with records all the time
    "pour",
    "makse-stratification",
    "--model=continuum",
    "--set=cell.length=20.0",
    "--set=pour.duration=9000.0",
    "--set=pour.records=300",
    "--set=continuum.cells=80",
    "-o",
    "out",
]
ARCHIVE, WORK = Path("out", "continuum.nc"), Path("out", "continuum.nc.unfinished")
Files = dict[str, bytes]


def started(*arguments: str, folder: Path, **options: object) -> subprocess.Popen[str]:
    """A real `stratify`, of these sources."""
    return subprocess.Popen(
        [str(STRATIFY), *arguments],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        **options,
    )


def ended(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    out, err = process.communicate(timeout=60)
    return process.returncode, out, err


def stratify(*arguments: str, folder: Path, **options: object) -> tuple[int, str, str]:
    return ended(started(*arguments, folder=folder, **options))


def wait_for(path: Path) -> None:
    while not path.exists():
        time.sleep(0.01)


def refusal(found: tuple[int, str, str]) -> str:
    """The one line with which a command ended."""
    status, _, err = found
    assert status == 2, found
    assert len(err.splitlines()) == 1, err
    assert err.startswith("stratify: ")
    return err


def files(folder: Path) -> Files:
    """All that is in a folder, but for the lock, which is always empty."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != "lock"
    }


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The archive of LONG that nobody stopped."""
    folder = tmp_path_factory.mktemp("whole")
    assert stratify(*LONG, folder=folder)[0] == 0
    return folder / ARCHIVE


def content_of(path: Path) -> str:
    """The digest, which was found to be that of the content."""
    read(path)
    with xr.open_dataset(path) as archive:
        return str(archive.attrs[DIGEST])


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_stopped_pour_says_how_to_go_on_and_that_works(
    number: signal.Signals, whole: Path, tmp_path: Path
) -> None:
    pouring = started(*LONG, folder=tmp_path)
    wait_for(tmp_path / WORK / "lock")
    pouring.send_signal(number)
    status, _, err = ended(pouring)
    assert status == 128 + number
    assert len(err.splitlines()) == 1, err
    told = re.fullmatch(
        r"stratify: continuum: stopped after \d+ of 36000 steps; go on with: stratify (.*)\n", err
    )
    assert told, err
    assert not (tmp_path / ARCHIVE).exists()
    status, _, err = stratify(*shlex.split(told[1]), folder=tmp_path)
    assert (status, err) == (0, "")
    assert files(tmp_path).keys() == {str(ARCHIVE)}
    assert content_of(tmp_path / ARCHIVE) == content_of(whole)


def test_whoever_asks_to_stop_twice_is_heard_at_once() -> None:
    before = signal.getsignal(signal.SIGTERM)
    with Stop() as stop:
        assert not stop()
        signal.raise_signal(signal.SIGINT)
        assert stop()
        assert signal.getsignal(signal.SIGTERM) == before
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)


def test_the_command_line_is_killed_and_goes_on(whole: Path, tmp_path: Path) -> None:
    """Fresh interpreters, by SIGKILL."""
    for delay in (0.1, 0.3, 0.6):
        pouring = started(*LONG, "--resume", "--checkpoint=0.05", folder=tmp_path)
        wait_for(tmp_path / WORK / "lock")
        time.sleep(delay)
        pouring.kill()
        assert ended(pouring)[0] == -signal.SIGKILL
        assert not (tmp_path / ARCHIVE).exists()
        assert (tmp_path / WORK).exists()
    status, out, _ = stratify(*LONG, "--resume", folder=tmp_path)
    assert status == 0
    assert content_of(tmp_path / ARCHIVE) == content_of(whole)
    assert files(tmp_path).keys() == {str(ARCHIVE)}
    before = files(tmp_path)
    status, out, _ = stratify(*LONG, "--resume", folder=tmp_path)
    assert status == 0
    assert f"{ARCHIVE} is whole already" in out
    assert files(tmp_path) == before


def test_two_pours_into_one_folder_do_not_meet(whole: Path, tmp_path: Path) -> None:
    first = started(*LONG, folder=tmp_path)
    wait_for(tmp_path / WORK / "lock")
    for options in ({}, {"force": True}, {"resume": True}):
        with pytest.raises(OutputExistsError, match="is being poured by another process"):
            pour("godunov", str(tmp_path / ARCHIVE), **options)
    assert ended(first)[0] == 0
    assert content_of(tmp_path / ARCHIVE) == content_of(whole)


def after(calls: int, then: Callable[[], bool] = lambda: True) -> Callable[[], bool]:
    """What says to stop, or does something else, when it is asked for the last of so many times."""
    left = iter(range(calls - 1, -1, -1))
    return lambda: next(left, 1) == 0 and then()


def stopped(case: str, path: Path, **options: bool) -> None:
    with pytest.raises(StoppedError, match=r"stopped after \d+ of \d+ steps"):
        pour(case, str(path), stop=after(3), **options)


OTHERS = {
    "another set-up": ("muscl", "continuum.scheme = not set there, muscl here"),
    "another number of cells": ("more cells", "continuum.cells = 20 there, 40 here"),
    "another model": ("poisson", "there continuum of stratify .*, here ca_model of"),
}


@pytest.mark.parametrize("other", OTHERS)
def test_another_pour_does_not_go_on_with_it(other: str, tmp_path: Path) -> None:
    case, difference = OTHERS[other]
    path = tmp_path / "pour.nc"
    stopped("godunov", path)
    before = files(tmp_path)
    with pytest.raises(ArchiveError, match=f"holds another pour: .*{difference}"):
        pour(case, str(path), resume=True)
    assert files(tmp_path) == before


def test_another_version_does_not_go_on_with_it(tmp_path: Path) -> None:
    path = tmp_path / "pour.nc"
    stopped("godunov", path)
    checkpoint = work_folder(path) / CHECKPOINT
    whole = read_whole(checkpoint)
    older = whole.attrs["source"].replace("stratify 0", "stratify 7")
    write_whole(whole.assign_attrs(source=older), checkpoint, force=True)
    before = files(tmp_path)
    with pytest.raises(ArchiveError, match=r"there continuum of stratify 7.* here .*stratify 0"):
        pour("godunov", str(path), resume=True)
    assert files(tmp_path) == before


def test_what_was_damaged_is_not_gone_on_from(tmp_path: Path) -> None:
    """A flipped bit in any file of the work is found, and nothing comes of it."""
    path = tmp_path / "pour.nc"
    stopped("godunov", path)
    for damaged in sorted(work_folder(path).glob("*.nc")):
        sound = damaged.read_bytes()
        damaged.write_bytes(sound[:2000] + bytes([sound[2000] ^ 4]) + sound[2001:])
        before = files(tmp_path)
        with pytest.raises(ArchiveError, match=f"{damaged.name}'.*damaged") as refused:
            pour("godunov", str(path), resume=True)
        assert "\n" not in str(refused.value)
        assert not path.exists()
        assert (
            files(tmp_path)[str(damaged.relative_to(tmp_path))]
            == before[str(damaged.relative_to(tmp_path))]
        )
        damaged.write_bytes(sound)
    pour("godunov", str(path), resume=True)


def test_an_unfinished_pour_is_neither_lost_nor_mixed_up(tmp_path: Path) -> None:
    path = tmp_path / "pour.nc"
    stopped("godunov", path)
    before = files(tmp_path)
    with pytest.raises(OutputExistsError, match="holds an unfinished pour; --resume goes on with"):
        pour("godunov", str(path))
    assert files(tmp_path) == before
    pour("muscl", str(path), force=True)
    assert CASES["muscl"].experiment().to_toml() == read(path).attrs["experiment"]


@pytest.mark.parametrize("old", [b"no archive", None])
def test_a_forced_pour_that_was_stopped_goes_on_over_whatever_was_there(
    old: bytes | None, tmp_path: Path
) -> None:
    path = tmp_path / "pour.nc"
    if old is None:
        pour("muscl", str(path))
    else:
        path.write_bytes(old)
    before = path.read_bytes()
    stopped("godunov", path, force=True)
    assert path.read_bytes() == before
    with pytest.raises((ArchiveError, OutputExistsError)):
        pour("godunov", str(path), resume=True)
    assert pour("godunov", str(path), resume=True, force=True)
    assert CASES["godunov"].experiment().to_toml() == read(path).attrs["experiment"]
    assert list(tmp_path.iterdir()) == [path]


def test_an_extension_that_goes_on_is_one_of_the_same_set_up(tmp_path: Path) -> None:
    path = tmp_path / "pour.nc"
    pour("godunov", str(path))
    assert not pour("godunov", str(path), resume=True, extend=True), "it is as long already"
    with pytest.raises(SetupError, match=r"same set-up can be extended: continuum\.scheme"):
        pour("muscl", str(path), resume=True, extend=True)


def test_an_extension_goes_on_from_no_other_archive(tmp_path: Path) -> None:
    path = tmp_path / "pour.nc"
    pour("pulses, extended", str(path))
    stopped("pulses, extended", path, extend=True)
    with netCDF4.Dataset(path, "a") as file:
        file.comment = "of the same set-up, but another"
    seal(path)
    before = files(tmp_path)
    with pytest.raises(ArchiveError, match=r"^'[^']*' is not the archive that was being extended"):
        pour("pulses, extended", str(path), resume=True, extend=True)
    assert files(tmp_path) == before


@pytest.mark.parametrize("case", ODD)
def test_an_extension_that_digs_deeper_than_the_archive_kept_is_refused(
    case: str, tmp_path: Path
) -> None:
    path = tmp_path / "pour.nc"
    pour(case, str(path))
    before = path.read_bytes()
    with pytest.raises(ArchiveError, match="cannot be extended so far: the flow would dig up"):
        pour(case, str(path), extend=True)
    assert path.read_bytes() == before


@pytest.mark.parametrize("folder", ["text/out", "/proc/out"])
def test_a_folder_that_cannot_be_is_refused(folder: str, tmp_path: Path) -> None:
    (tmp_path / "text").write_text("no folder")
    with pytest.raises(ArchiveError, match="cannot be written") as refused:
        pour("godunov", str(tmp_path / folder / "pour.nc"))
    assert "\n" not in str(refused.value)
    assert files(tmp_path) == {"text": b"no folder"}


@pytest.mark.parametrize("calls", [1, 3])
@pytest.mark.parametrize("every", [0.0, 1e9])
@pytest.mark.parametrize("case", ["godunov", "drum", "poisson"])
def test_a_folder_that_vanishes_is_told_and_not_made_again(
    case: str, every: float, calls: int, tmp_path: Path
) -> None:
    path = tmp_path / "out" / "pour.nc"
    vanish = after(calls, lambda: shutil.rmtree(path.parent))
    with pytest.raises(ArchiveError, match=r"pour.nc.unfinished' is gone") as refused:
        pour(case, str(path), every=every, stop=vanish)
    assert "\n" not in str(refused.value)
    assert not path.parent.exists()


def test_a_limit_to_the_size_of_files_is_told_and_harms_nothing(whole, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / ARCHIVE).write_bytes(b"old")
    limit = partial(resource.setrlimit, resource.RLIMIT_FSIZE, (200_000, 200_000))
    found = stratify(*LONG, "--force", "--checkpoint=0.2", folder=tmp_path, preexec_fn=limit)
    assert "cannot be written" in refusal(found)
    assert (tmp_path / ARCHIVE).read_bytes() == b"old"
    status, _, err = stratify(*LONG, "--force", "--resume", folder=tmp_path)
    assert (status, err) == (0, "")
    assert content_of(tmp_path / ARCHIVE) == content_of(whole)
    assert files(tmp_path).keys() == {str(ARCHIVE)}


UNSHARE = shutil.which("unshare") or ""


def may_mount() -> bool:
    mount = [UNSHARE, "-rm", "mount", "-t", "tmpfs", "none", "/mnt"]
    return bool(UNSHARE) and subprocess.run(mount, capture_output=True).returncode == 0


@pytest.mark.skipif(not may_mount(), reason="nothing may be mounted here")
def test_a_full_disk_is_told_and_with_more_room_it_goes_on(whole: Path, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    pour = f"{STRATIFY} {shlex.join(LONG)}"
    script = f"""
mount -t tmpfs -o size=1200k none out
echo old > {ARCHIVE}
{pour} --force --checkpoint=0.2 2> full
echo $? >> full
cat {ARCHIVE} >> full
mount -o remount,size=50m out
{pour} --force --resume > more 2>&1
ls -A out >> more
cp {ARCHIVE} whole.nc
"""
    command = [UNSHARE, "-rm", "sh", "-c", script]
    here = os.environ | {"PYTHONPATH": str(ROOT)}
    subprocess.run(command, cwd=tmp_path, check=True, env=here)
    told, *rest = (tmp_path / "full").read_text().splitlines()
    assert re.fullmatch("stratify: .* cannot be written: .*", told), told
    assert rest == ["2", "old"]
    assert (tmp_path / "more").read_text().splitlines()[1:] == [
        f"continuum: wrote {ARCHIVE}",
        ARCHIVE.name,
    ]
    assert content_of(tmp_path / "whole.nc") == content_of(whole)
