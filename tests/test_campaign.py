"""Many pours at once: the same numbers for any number of workers, and one that fails stops none."""

import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import closing
from itertools import count
from typing import Any

import numpy as np
import pytest
import xarray as xr

from compare import campaign, measure
from compare.campaign import LOST, POUR, Job, Outcome, Pour, with_chance
from compare.campaign.jobs import do
from compare.campaign.processes import in_processes
from experiment import Experiment, StratifyError, load


@pytest.fixture(scope="module")
def pours() -> list[Experiment]:
    """Three piles, one that the lattice does not know, and one with nothing to measure."""
    quick = ["cell.length=20.0", "pour.duration=100.0", "pour.records=100", "continuum.cells=40"]
    settings = [*quick, "ca_model.arrivals=drawn"]
    piles = [load("makse-stratification", [*settings, f"pour.pile={pile}"]) for pile in range(3)]
    dispersing = piles[0].with_values({"mixture.dispersion": 0.1})
    return [*piles, dispersing, load("drum-mixture", ["pour.duration=1.0"])]


@pytest.fixture(scope="module")
def in_turn(pours: list[Experiment]) -> xr.Dataset:
    return campaign(pours, workers=1)


def test_the_numbers_are_the_same_for_any_number_of_workers(pours, in_turn) -> None:
    xr.testing.assert_identical(campaign(pours, workers=2), in_turn)


def test_a_campaign_measures_what_each_pour_alone_gives(pours, in_turn, models) -> None:
    assert dict(in_turn.sizes) == {"model": 2, "pour": 5}
    for name, model in models.items():
        alone = measure(model.pour(pours[1]))
        found = in_turn.sel(model_name=name).isel(pour=1)
        for quantity in alone.data_vars:
            np.testing.assert_array_equal(found[quantity], alone[quantity])
            assert found[quantity].attrs == alone[quantity].attrs
    for scale in ("total_inflow", "drift_velocity", "collision_rate"):
        assert (in_turn[scale].isel(pour=slice(3)) == 1.0).all()


def test_a_pour_that_fails_is_told_and_the_others_go_on(in_turn) -> None:
    lattice, continuum = in_turn["failure"].values.tolist()
    assert lattice[:3] == continuum[:3] == [""] * 3
    assert "mixture.dispersion" in lattice[3]
    assert continuum[3] == ""
    assert "nothing is poured into a drum" in continuum[4]
    missing = np.isnan(in_turn["layering"].values)
    assert missing.tolist() == [[False] * 3 + [True] * 2, [False] * 4 + [True]]
    assert in_turn["regime"].values[1, 4] == ""


def test_a_campaign_in_which_every_pour_fails_says_why(pours) -> None:
    with pytest.raises(StratifyError, match=r"no pour could be measured: mixture\.dispersion"):
        campaign([pours[3]], ["ca_model"])


def test_a_model_that_stumbles_is_told_with_its_error(pours, monkeypatch) -> None:
    def stumble(_: Experiment) -> xr.Dataset:
        raise ZeroDivisionError("too thin")

    monkeypatch.setitem(POUR, "ca_model", stumble)
    found = campaign(pours[:1], workers=1)
    assert found["failure"].values.tolist() == [["ZeroDivisionError: too thin"], [""]]


def test_what_a_worker_had_when_it_was_ended_from_outside_is_poured_again(pours, in_turn) -> None:
    killed: list[int] = []

    def end_a_worker_once(_: float) -> None:
        for child in multiprocessing.active_children()[:1]:
            if not killed:
                child.kill()
                killed.append(child.pid)

    found = campaign(pours, workers=2, progress=end_a_worker_once)
    assert killed
    xr.testing.assert_identical(found, in_turn)


def end_the_process() -> Outcome:
    os._exit(1)


def succeed() -> Outcome:
    return Outcome({"found": 1.0}, {"found": {}})


def test_a_job_that_ends_its_process_is_told_and_the_others_are_done() -> None:
    jobs = [succeed, succeed, end_the_process, succeed]
    found = dict(in_processes(jobs, workers=2))
    assert sorted(found) == [0, 1, 2, 3]
    assert found.pop(2).failure == LOST
    assert all(outcome == succeed() for outcome in found.values())


def test_no_job_is_lost_when_a_worker_is_killed_while_nobody_listens() -> None:
    """The pool is found broken by whoever gives it the next job, not by who waits for the last."""
    with closing(in_processes([succeed] * 40, workers=2)) as outcomes:
        arrived = [next(outcomes)[0] for _ in range(3)]
        for child in multiprocessing.active_children():
            child.kill()
            child.join()
        time.sleep(0.5)
        arrived += [number for number, outcome in outcomes if not outcome.failure]
    assert sorted(arrived) == list(range(40))


def test_a_script_that_forgets_its_guard_is_told_at_once(tmp_path) -> None:
    script = tmp_path / "unguarded.py"
    script.write_text(
        "from compare import campaign\n"
        "from experiment import load\n"
        "campaign([load('glass-sugar')] * 9, workers=2)\n"
    )
    done = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, check=False, timeout=60
    )
    assert done.stderr.splitlines()[-1].startswith(
        "experiment.errors.StratifyError: no process could be started to pour in: a script does so"
    )


def test_jobs_are_asked_for_only_a_little_ahead_of_what_is_done() -> None:
    asked: list[int] = []

    def endless() -> Iterator[Job]:
        for number in count():
            asked.append(number)
            yield succeed

    with closing(in_processes(endless(), workers=2)) as outcomes:
        done = [next(outcomes) for _ in range(20)]
    assert len(asked) - len(done) < 20


def test_a_worker_compiles_nothing_that_was_compiled_before(pours) -> None:
    """A fresh process takes the kernels of both models and of the measurements from disk."""
    script = (
        "import sys, pickle\n"
        "from numba.core import event\n"
        "jobs = pickle.load(sys.stdin.buffer)\n"
        "with event.install_recorder('numba:compile') as compiled:\n"
        "    outcomes = [job() for job in jobs]\n"
        "assert all(not outcome.failure for outcome in outcomes)\n"
        "print(len(compiled.buffer))"
    )
    jobs = [Pour(model, pours[0]) for model in POUR]
    assert all(not do(job).failure for job in jobs)
    told = subprocess.run(
        [sys.executable, "-c", script], input=pickle.dumps(jobs), capture_output=True, check=True
    )
    assert told.stdout == b"0\n"


def test_an_interrupt_while_workers_start_is_heard_and_no_worker_says_a_word(
    pours, monkeypatch, capfd
) -> None:
    submit = ProcessPoolExecutor.submit

    def submit_and_interrupt(*job: Any) -> Future:
        future = submit(*job)
        time.sleep(0.4)  # until a worker runs Python, not until it knows what it is for
        for process in [*multiprocessing.active_children(), multiprocessing.current_process()]:
            os.kill(process.pid, signal.SIGINT)
        return future

    monkeypatch.setattr(ProcessPoolExecutor, "submit", submit_and_interrupt)
    with pytest.raises(KeyboardInterrupt):
        campaign(pours[:2], ["ca_model"], workers=2)
    assert multiprocessing.active_children() == []
    assert capfd.readouterr() == ("", "")


def test_progress_grows_to_one(pours) -> None:
    shares: list[float] = []
    campaign(pours[:3], ["ca_model"], workers=1, progress=shares.append)
    assert shares == pytest.approx([1 / 3, 2 / 3, 1.0])


@pytest.mark.parametrize(
    ("preset", "settings", "expected"),
    [
        ("glass-sugar", [], False),
        ("glass-sugar", ["ca_model.arrivals=drawn"], True),
        ("glass-sugar", ["ca_model.arrivals=poisson"], True),
        ("franks", ["ca_model.arrivals=fixed"], True),
        ("franks", ["ca_model.arrivals=fixed", "ca_model.threshold_spread=0"], False),
        ("glass-sugar", ["ca_model.rule=rate"], True),
    ],
)
def test_where_chance_has_a_part_is_known(preset: str, settings: list[str], expected) -> None:
    experiment = load(preset, settings)
    assert with_chance(experiment, "ca_model") is expected
    assert not with_chance(experiment, "continuum")
