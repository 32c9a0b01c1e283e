"""Jobs on a real Dask cluster: the same numbers, each once, whatever is lost; one line if not."""

import json
import os
import signal
import socket
import sqlite3
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from importlib import import_module
from itertools import count
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import pytest
import xarray as xr
from running import stratify

from compare import phase
from compare.campaign import LOST, Job, Outcome, scheduler_of
from experiment import Experiment, SetupError, load

pytest.importorskip("distributed")
from distributed import Client

QUICK = ["cell.length=20.0", "pour.duration=100.0", "pour.records=100", "continuum.cells=40"]
VARY = {"mixture.delta": [-0.2, 0.0, 0.1, 0.3], "mixture.psi": [0.1, 0.3, 1.5]}
JOBS = 2 * 12 + 2  # both models at each point, a third of which makes no set-up, and two lines
DASK = [sys.executable, "-m", "dask"]
HERE = ["--host", "127.0.0.1", "--no-dashboard"]
LEFT_ALONE = ["--idle-timeout", "10 minutes"]  # it ends, where the tests were killed


class Cluster(NamedTuple):
    """A scheduler and its workers, each a process; the address is all that others know."""

    address: str
    scheduler: subprocess.Popen[bytes]
    workers: list[subprocess.Popen[bytes]]


@contextmanager
def cluster(
    folder: Path, *workers: int, restarted: bool = False, allowed_failures: int = 3
) -> Iterator[Cluster]:
    """A cluster of `workers` with so many threads; with `restarted` those that are lost return."""
    search = [str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")]
    here = os.environ | {
        "PYTHONPATH": os.pathsep.join(filter(None, search)),
        "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": str(allowed_failures),
    }
    with ExitStack() as running:

        def start(*command: str) -> subprocess.Popen[bytes]:
            log = running.enter_context((folder / f"{command[0]}.log").open("ab"))
            started = subprocess.Popen(
                [*DASK, *command, *HERE], env=here, stderr=log, stdout=log, start_new_session=True
            )
            running.callback(end, started)
            return started

        told = folder / "scheduler.json"
        scheduler = start("scheduler", "--port", "0", "--scheduler-file", str(told), *LEFT_ALONE)
        address = eventually(lambda: address_in(told))
        options = [f"--{'' if restarted else 'no-'}nanny", "--local-directory", str(folder)]
        yield Cluster(
            address,
            scheduler,
            [start("worker", address, "--nthreads", str(n), *options) for n in workers],
        )


def address_in(told: Path) -> str | None:
    with suppress(OSError, ValueError):
        return str(json.loads(told.read_text())["address"])
    return None


def end(process: subprocess.Popen[bytes]) -> None:
    """Kill a process and those that it started."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def eventually(ask: Callable[[], Any], patience: float = 20.0) -> Any:
    until = time.monotonic() + patience
    while time.monotonic() < until:
        if answer := ask():
            return answer
        time.sleep(0.02)
    raise TimeoutError


@pytest.fixture(scope="module")
def setup() -> Experiment:
    return load("makse-segregation", QUICK)


@pytest.fixture(scope="module")
def diagram(setup: Experiment) -> xr.Dataset:
    return phase(setup, VARY, deposits=4, lines=2, workers=1)


@pytest.fixture(scope="module")
def two_workers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """Two workers, of which one has two threads."""
    with cluster(tmp_path_factory.mktemp("cluster"), 1, 2) as there:
        yield there


@pytest.fixture
def hurried(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(import_module("compare.campaign.cluster"), "PATIENCE", 1.0)


def assert_same(found: xr.Dataset, expected: xr.Dataset) -> None:
    """Identical, but for when it was made."""
    when = {"history": expected.attrs["history"]}
    xr.testing.assert_identical(found.assign_attrs(when), expected)


def succeed() -> Outcome:
    return Outcome({"found": 1.0}, {"found": {}})


def end_the_process() -> Outcome:
    os._exit(1)


def take_a_while() -> Outcome:
    time.sleep(0.1)
    return succeed()


def say_who() -> Outcome:
    return Outcome({"process": float(os.getpid())}, {"process": {}})


# the same numbers, each once


def test_a_diagram_is_the_same_here_and_on_a_cluster(setup, diagram, two_workers) -> None:
    assert_same(phase(setup, VARY, deposits=4, lines=2, scheduler=two_workers.address), diagram)


def test_when_a_worker_is_killed_half_way_all_points_arrive_once(setup, diagram, tmp_path) -> None:
    shares: list[float] = []
    with cluster(tmp_path, 1, 1) as there:

        def kill_one_half_way(share: float) -> None:
            shares.append(share)
            if len(shares) == JOBS // 2:
                there.workers[0].kill()

        found = phase(
            setup, VARY, deposits=4, lines=2, scheduler=there.address, progress=kill_one_half_way
        )
        assert [worker.poll() for worker in there.workers] == [-signal.SIGKILL, None]
    assert shares == pytest.approx([(k + 1) / JOBS for k in range(JOBS)])
    assert_same(found, diagram)


def test_a_job_that_ends_its_worker_is_told_and_the_others_arrive(tmp_path) -> None:
    """Those that waited behind it, which Dask gives up with it, arrive too."""
    jobs = [succeed, end_the_process, *[succeed] * 8]
    with cluster(tmp_path, 1, 1, restarted=True, allowed_failures=0) as there:
        arrived = list(scheduler_of(None, there.address, len(jobs))(jobs))
    found = dict(arrived)
    assert sorted(number for number, _ in arrived) == list(range(len(jobs)))
    assert found.pop(1).failure == LOST
    assert all(outcome == succeed() for outcome in found.values())


def test_what_is_lost_with_the_worker_that_had_done_it_is_done_again(tmp_path, monkeypatch) -> None:
    gather, doomed = Client.gather, []

    def gather_too_late(client: Client, *what: Any, **how: Any) -> Any:
        while doomed:
            os.kill(doomed.pop(), signal.SIGKILL)
        return gather(client, *what, **how)

    monkeypatch.setattr(Client, "gather", gather_too_late)
    with cluster(tmp_path, 1, restarted=True) as there:
        outcomes = scheduler_of(None, there.address, 8)([say_who] * 8)
        arrived = [next(outcomes)]
        doomed.append(int(arrived[0][1].measured["process"]))
        arrived.extend(outcomes)
    assert sorted(number for number, _ in arrived) == list(range(8))
    assert len({outcome.measured["process"] for _, outcome in arrived}) == 2


def test_jobs_are_asked_for_a_little_ahead_and_none_is_left_behind(two_workers) -> None:
    asked: list[int] = []

    def endless() -> Iterator[Job]:
        for number in count():
            asked.append(number)
            yield take_a_while

    with closing(scheduler_of(None, two_workers.address, 10)(endless())) as outcomes:
        done = [next(outcomes) for _ in range(5)]
    assert len(asked) - len(done) <= 3 * 3 + len(done)
    assert not any(thread.name == "IO loop" for thread in threading.enumerate())
    with Client(two_workers.address, set_as_default=False) as client:
        assert eventually(lambda: not client.run_on_scheduler(tasks_of))


def tasks_of(dask_scheduler) -> int:
    return len(dask_scheduler.tasks)


# what is told where there is no such cluster


@pytest.mark.usefixtures("hurried")
@pytest.mark.parametrize(
    ("address", "reason"),
    [
        ("nonsense", "missing port number"),
        ("", "missing port number"),
        ("http://127.0.0.1:8786", "unknown address scheme 'http'"),
        ("tcp://127.0.0.1:eight", "invalid literal"),
        ("tls://127.0.0.1:8786", "TLS"),
        ("tcp://127.0.0.1:1", "Connection refused"),
    ],
)
def test_an_address_without_a_scheduler_is_refused(address, reason, setup) -> None:
    with pytest.raises(SetupError) as refused:
        phase(setup, VARY, scheduler=address)
    told = str(refused.value)
    assert told.startswith(f"scheduler = {address}: no Dask scheduler answers there (")
    assert reason in told
    assert "\n" not in told


@pytest.mark.usefixtures("hurried")
def test_what_listens_there_and_is_no_scheduler_is_refused(setup, two_workers) -> None:
    with socket.create_server(("127.0.0.1", 0)) as mute:
        address = f"tcp://127.0.0.1:{mute.getsockname()[1]}"
        with pytest.raises(SetupError, match=f"^scheduler = {address}: no Dask scheduler answers"):
            phase(setup, VARY, scheduler=address)
    with Client(two_workers.address, set_as_default=False) as client:
        worker = next(iter(client.nthreads()))
    with pytest.raises(SetupError, match="it is that of a Worker"):
        phase(setup, VARY, scheduler=worker)


@pytest.mark.usefixtures("hurried")
def test_a_scheduler_without_workers_is_told_how_to_have_some(setup, tmp_path) -> None:
    with cluster(tmp_path) as there:
        how = f"scheduler = {there.address}: it has no workers; `dask worker {there.address}`"
        with pytest.raises(SetupError, match=how):
            phase(setup, VARY, scheduler=there.address)


def test_when_the_last_worker_is_lost_that_is_told(tmp_path, monkeypatch) -> None:
    with cluster(tmp_path, 1) as there:
        outcomes = scheduler_of(None, there.address, 2)([end_the_process, succeed])
        monkeypatch.setattr(import_module("compare.campaign.cluster"), "PATIENCE", 1.0)
        with pytest.raises(SetupError, match="it has no workers"), closing(outcomes):
            list(outcomes)


def test_workers_that_may_give_other_numbers_do_nothing(two_workers, monkeypatch) -> None:
    scheduler = scheduler_of(None, two_workers.address, 1)
    monkeypatch.setattr(
        import_module("compare.campaign.cluster"), "_made_by", lambda: "stratify 0.0.9 with numpy 1"
    )
    with pytest.raises(SetupError) as refused:
        list(scheduler([succeed]))
    told = str(refused.value)
    assert told.startswith(f"scheduler = {two_workers.address}: its worker tcp://127.0.0.1:")
    assert told.endswith("here is stratify 0.0.9 with numpy 1; both should be the same")
    assert "\n" not in told


def test_workers_without_these_packages_are_told(two_workers, monkeypatch) -> None:
    elsewhere = ModuleType("elsewhere")
    exec("def job(): ...", elsewhere.__dict__)  # noqa: S102
    monkeypatch.setitem(sys.modules, "elsewhere", elsewhere)
    with pytest.raises(SetupError, match=r"this stratify installed \(No module .* 'elsewhere'\)"):
        list(scheduler_of(None, two_workers.address, 1)([elsewhere.job]))


def test_where_dask_is_not_installed_that_is_told(setup, monkeypatch) -> None:
    monkeypatch.delitem(sys.modules, "compare.campaign.cluster", raising=False)
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(SetupError, match=r"scheduler = tcp://.*: it needs dask: pip install"):
        phase(setup, VARY, scheduler="tcp://127.0.0.1:1")


def test_when_the_scheduler_is_lost_what_is_done_is_kept(diagram, tmp_path) -> None:
    vary = [f"--vary={key}={','.join(map(str, values))}" for key, values in VARY.items()]
    settings = [f"--set={setting}" for setting in QUICK]
    options = ["--deposits=0", "--lines=0", "-o", "phase.nc"]
    command = ["phase", "makse-segregation", *vary, *settings, *options]
    journal = tmp_path / "phase.nc.unfinished" / "outcomes.sqlite"

    def kept() -> int:
        with suppress(sqlite3.Error), closing(sqlite3.connect(f"file:{journal}?mode=ro")) as base:
            return int(base.execute("SELECT count(*) FROM outcome").fetchone()[0])
        return 0

    with cluster(tmp_path, 1) as there:
        killer = threading.Thread(target=lambda: (eventually(kept), there.scheduler.kill()))
        killer.start()
        stopped = stratify(*command, "--scheduler", there.address, folder=tmp_path)
        killer.join()
    assert stopped.returncode == 2
    assert stopped.stderr == (
        f"stratify: scheduler = {there.address}: the connection to it was lost\n"
    )
    assert 0 < kept() < JOBS
    resumed = stratify(*command, "--resume", "--workers=1", folder=tmp_path)
    assert resumed.returncode == 0
    with xr.open_dataset(tmp_path / "phase.nc") as found:
        xr.testing.assert_equal(found["regime"], diagram["regime"].load())
