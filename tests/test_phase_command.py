"""`stratify phase`: what it writes and says, and that nothing that was done is lost."""

import json
import os
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
import xarray as xr
from running import stratify

from compare.campaign import LOST, Job, Outcome, Outcomes, scheduler_of
from compare.campaign.jobs import failed
from compare.cli import main
from compare.phase import phase_to_file
from compare.phase.axes import axes_of
from compare.phase.patterns import patterns
from compare.phase.plan import Plan, plan_of
from experiment import ArchiveError, Experiment, OutputExistsError, StratifyError, load
from experiment.archive.storage import content_of, read_whole

QUICK = ["cell.length=20.0", "pour.duration=100.0", "pour.records=50", "continuum.cells=40"]
VARY = ["--vary", "mixture.delta=-0.2,0.1,0.3", "--vary", "mixture.psi=0.1,0.3,1.5"]
QUICKLY = [part for setting in QUICK for part in ("--set", setting)]
COMMAND = ["phase", "makse-segregation", *QUICKLY, *VARY, "--lines", "2", "--deposits", "2"]
MEASURED = {"regime": "mixed", "layered_share": 0.0, "slope_length": 1.0}
IN_TURN = scheduler_of(1, None, 1)


@pytest.fixture(scope="module")
def plan() -> Plan:
    axes = axes_of({"mixture.delta": [-0.2, 0.1, 0.3], "mixture.psi": [0.1, 0.3, 1.5]})
    return plan_of(load("makse-segregation", QUICK), axes, ["ca_model", "continuum"], 2, 2)


@pytest.fixture(scope="module")
def whole(plan: Plan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("whole") / "phase.nc"
    phase_to_file(plan, path, IN_TURN)
    return path


def test_the_command_writes_a_diagram_with_its_picture_and_says_what_is_in_it(
    whole: Path, tmp_path: Path
) -> None:
    done = stratify(*COMMAND, "-o", "phase.nc", "--workers", 2, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert sorted(file.name for file in tmp_path.iterdir()) == ["phase.nc", "phase.png"]
    assert content_of(tmp_path / "phase.nc") == content_of(whole)
    assert "phase: 20 jobs done in" in done.stdout
    assert "mixture.delta from which on there are layers" in done.stdout
    assert "continuum: 3 failed: mixture.psi = 1.5: it makes a repose slope of" in done.stdout


def test_json_has_the_numbers_of_the_diagram(plan: Plan, tmp_path: Path) -> None:
    done = stratify(*COMMAND, "-o", "phase.nc", "--workers", 1, "--json", folder=tmp_path)
    record = json.loads(done.stdout)
    diagram = read_whole(tmp_path / "phase.nc")
    for model in plan.models:
        chosen = diagram.sel(model_name=model)
        points = record[model]["points"]
        assert sum(points.values()) == 9
        assert points.pop("failed") == sum(record[model]["failures"].values()) == 3
        assert all((patterns(chosen) == word).sum() == n for word, n in points.items())
    assert record["delta"] == [-0.2, 0.1, 0.3]


def test_a_set_up_that_one_model_cannot_pour_is_mapped_by_the_other(tmp_path: Path) -> None:
    changed = ["--set", "mixture.dispersion=0.1", "--workers", 1, "-o", "phase.nc"]
    done = stratify(*COMMAND, *changed, folder=tmp_path)
    assert "ca_model: does not apply: mixture.dispersion" in done.stdout
    assert read_whole(tmp_path / "phase.nc")["model_name"].values.tolist() == ["continuum"]


@pytest.mark.parametrize(
    ("changed", "complaint"),
    [
        (["--vary", "mixture.detla=1,2"], "no field 'detla'"),
        (["--vary", "feed.inflow"], "it should be KEY=LOW:HIGH:COUNT"),
        (["--vary", "cell.length=10:20"], "draws = 0: it should be at least 1"),
        (["-o", "phase.png"], "output = phase.png: it should end in .nc"),
        (["--set", "pour.records=0"], "pour.records = 0"),
    ],
)
def test_bad_input_is_told_in_one_line_and_nothing_is_written(
    tmp_path: Path,
    changed: list[str],
    complaint: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["stratify", *COMMAND, *changed])
    with pytest.raises(SystemExit) as ended:
        main()
    told = capsys.readouterr().err
    assert ended.value.code == 2
    assert complaint in told
    assert told.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_replaced_unless_it_is_said(whole: Path, plan: Plan, tmp_path: Path) -> None:
    (tmp_path / "phase.png").write_text("mine")
    done = stratify(*COMMAND, "-o", "phase.nc", folder=tmp_path)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "'phase.png' exists already; --force replaces it" in done.stderr
    with pytest.raises(OutputExistsError, match="--force replaces it"):
        phase_to_file(plan, whole, IN_TURN)


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_a_diagram_that_was_ended_goes_on_with_the_points_that_are_left(
    plan: Plan, whole: Path, tmp_path: Path, how: signal.Signals
) -> None:
    command = [str(Path(sys.executable).parent / "stratify"), *COMMAND, "-o", "phase.nc"]
    process = subprocess.Popen(
        [*command, "--workers", "2"], cwd=tmp_path, stderr=subprocess.PIPE, text=True
    )
    journal = tmp_path / "phase.nc.unfinished" / "outcomes.sqlite"
    wait_for_outcomes(journal, 3)
    process.send_signal(how)
    _, told = process.communicate(timeout=60)
    if how is not signal.SIGKILL:
        assert process.returncode == 128 + how
        assert told.startswith("stratify: phase: stopped; what is done is kept; go on with: ")
        assert told.rstrip().endswith("--resume")
    before = outcomes_in(journal)
    assert 3 <= before < 20
    with pytest.raises(OutputExistsError, match="unfinished diagram; --resume goes on with it"):
        phase_to_file(plan, tmp_path / "phase.nc", IN_TURN)
    phase_to_file(plan, tmp_path / "phase.nc", IN_TURN, resume=True)
    assert content_of(tmp_path / "phase.nc") == content_of(whole)
    assert not journal.parent.exists()


def test_a_diagram_that_is_whole_is_not_made_again(
    whole: Path, plan: Plan, small_pour: Experiment
) -> None:
    written = whole.stat().st_mtime_ns
    found = phase_to_file(plan, whole, killed_after(0, []), resume=True)
    xr.testing.assert_identical(found, read_whole(whole))
    with pytest.raises(OutputExistsError, match="is another diagram; --force replaces it"):
        phase_to_file(quick_plan(small_pour), whole, killed_after(0, []), resume=True)
    assert whole.stat().st_mtime_ns == written
    assert not whole.with_name("phase.nc.unfinished").exists()


def outcomes_in(journal: Path) -> int:
    with closing(sqlite3.connect(f"file:{journal}?mode=ro", uri=True)) as base:
        return int(base.execute("SELECT count(*) FROM outcome").fetchone()[0])


def wait_for_outcomes(journal: Path, number: int) -> None:
    for _ in range(1000):
        try:
            if journal.exists() and outcomes_in(journal) >= number:
                return
        except sqlite3.OperationalError:
            pass  # its tables are not there yet
        time.sleep(0.02)
    raise TimeoutError(journal)


class KilledError(Exception):
    pass


def killed_after(number: int, done: list[Job]):  # type: ignore[no-untyped-def]
    def scheduler(jobs: Iterator[Job]) -> Outcomes:
        for k, job in enumerate(jobs):
            if k == number:
                raise KilledError
            done.append(job)
            yield k, job()

    return scheduler


def quick_plan(setup: Experiment) -> Plan:
    return plan_of(setup, axes_of({"pour.pile": list(range(6))}), ["ca_model"])


def test_no_point_is_poured_twice_however_often_the_diagram_is_ended(
    small_pour: Experiment, tmp_path: Path
) -> None:
    plan, path, done = quick_plan(small_pour), tmp_path / "phase.nc", []
    for _ in range(2):
        with pytest.raises(KilledError):
            phase_to_file(plan, path, killed_after(2, done), resume=True)
        assert not path.exists()
    found = phase_to_file(plan, path, IN_TURN, resume=True)
    assert [job.values["pour.pile"] for job in done] == [0, 1, 2, 3]
    xr.testing.assert_identical(found.drop_attrs(), read_whole(path).drop_attrs())


def test_another_diagram_is_not_mixed_into_what_is_unfinished(
    small_pour: Experiment, tmp_path: Path
) -> None:
    path, done = tmp_path / "phase.nc", []
    with pytest.raises(KilledError):
        phase_to_file(quick_plan(small_pour), path, killed_after(2, done))
    other = quick_plan(small_pour.with_values({"mixture.psi": 0.2}))
    with pytest.raises(ArchiveError, match="another diagram: its set-up differs"):
        phase_to_file(other, path, IN_TURN, resume=True)
    assert outcomes_in(path.with_name("phase.nc.unfinished") / "outcomes.sqlite") == 2
    phase_to_file(other, path, IN_TURN, force=True)
    assert path.exists()


def test_what_was_lost_with_its_process_is_tried_again(
    small_pour: Experiment, tmp_path: Path
) -> None:
    plan, path = quick_plan(small_pour), tmp_path / "phase.nc"

    def losing(jobs: Iterator[Job]) -> Outcomes:
        yield from (
            (k, failed(LOST if k == 1 else "thin")) for k, _ in zip(range(3), jobs, strict=False)
        )
        raise KilledError

    with pytest.raises(KilledError):
        phase_to_file(plan, path, losing)
    found = phase_to_file(plan, path, IN_TURN, resume=True)
    assert found["failure"].values.ravel().tolist() == ["thin", "", "thin", "", "", ""]


def test_a_diagram_with_jobs_that_were_not_done_is_not_written(
    small_pour: Experiment, tmp_path: Path
) -> None:
    def lazy(jobs: Iterator[Job]) -> Outcomes:
        yield 0, next(iter(jobs))()

    with pytest.raises(StratifyError, match="5 of 6 jobs were not done"):
        phase_to_file(quick_plan(small_pour), tmp_path / "phase.nc", lazy)
    assert not (tmp_path / "phase.nc").exists()


def test_two_processes_cannot_make_one_diagram(small_pour: Experiment, tmp_path: Path) -> None:
    plan, path = quick_plan(small_pour), tmp_path / "phase.nc"

    def second(jobs: Iterator[Job]) -> Outcomes:
        with pytest.raises(OutputExistsError, match="another process"):
            phase_to_file(plan, path, IN_TURN, resume=True)
        yield from IN_TURN(jobs)

    phase_to_file(plan, path, second)


def test_a_journal_that_is_no_journal_is_refused_in_a_line(
    small_pour: Experiment, tmp_path: Path
) -> None:
    folder = tmp_path / "phase.nc.unfinished"
    folder.mkdir()
    (folder / "outcomes.sqlite").write_bytes(os.urandom(4096))
    with pytest.raises(ArchiveError, match=r"the journal of .* cannot be used"):
        phase_to_file(quick_plan(small_pour), tmp_path / "phase.nc", IN_TURN, resume=True)


def test_numbers_come_back_from_the_journal_as_they_were(
    small_pour: Experiment, tmp_path: Path
) -> None:
    plan, path = quick_plan(small_pour), tmp_path / "phase.nc"
    odd = [0.1 + 0.2, float("nan"), float("inf"), 5e-324, -0.0, 1 / 3]

    def scheduler(jobs: Iterator[Job]) -> Outcomes:
        for k, _ in enumerate(jobs):
            yield k, Outcome(MEASURED | {"odd": odd[k]}, {key: {} for key in [*MEASURED, "odd"]})
            if k == 4:
                raise KilledError

    with pytest.raises(KilledError):
        phase_to_file(plan, path, scheduler)

    def the_last(_: Iterator[Job]) -> Outcomes:
        yield 0, Outcome(MEASURED | {"odd": odd[5]}, {})

    found = phase_to_file(plan, path, the_last, resume=True)
    assert repr(found["odd"].values.ravel().tolist()) == repr(odd)
