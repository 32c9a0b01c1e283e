"""Real processes to be killed, in milliseconds: one that has imported all forks one for each pour.

A line of JSON on its standard input asks for a pour, which is killed after so many seconds; a line
on its standard output tells how that ended, and what the process was doing.
"""

import json
import mmap
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from functools import partial, wraps
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import ca_model
import continuum
from experiment import Experiment, StratifyError, load
from experiment.pouring import Begin, streaming
from experiment.pouring.assembly import assemble_on_disk
from experiment.pouring.work import Work

PHASES = ("starting", "pouring", "writing a checkpoint", "putting together", "clearing up")
LATTICE = ["cell.length=40.0", "pour.duration=300.0", "pour.records=6"]
SILO = ["cell.length=10.0", "pour.duration=350.0", "pour.records=7", "continuum.cells=20"]
HEAP = ["cell.shape='heap'", "cell.end='open'"]
DIGGING = [  # smooth grains carry away the heap that rough ones made
    "mixture={names=['smooth','rough'], repose_slope=[[0.1,0.1],[3.0,3.0]], "
    "grain_diameter=[0.06,0.13], drift_velocity=1.0, collision_rate=[[1.0,1.0],[1.0,1.0]], "
    "surface_depth=0.1, curvature_length=0.1}",
    "cell.start_slope=0.0",
    "feed.inflow=[0.9,0.0]",
    "feed.schedule={kind='pulses', period=500.0, share=0.5, inflow=[0.0,0.9]}",
    "pour.duration=450.0",
]
RATES = ["ca_model={rule='rate', column_width=0.5, unit=0.02}"]


class Case(NamedTuple):
    """A small pour that makes some slabs, and to how many of its durations it is extended."""

    model: str
    preset: str
    settings: list[str]
    longer: int = 1

    def experiment(self, times: int = 1) -> Experiment:
        experiment = load(self.preset, self.settings)
        longer = experiment.pour.model_copy(update={"duration": experiment.pour.duration * times})
        return experiment.model_copy(update={"pour": longer})

    @property
    def begin(self) -> Begin:
        """The pour, with so little memory that deposits are handed on and dug up again."""
        if self.model == "ca_model":
            return partial(ca_model.begin, log=500, most_places=64)
        return partial(continuum.begin, most_bins=64)


CASES = {
    "poisson": Case(
        "ca_model", "lattice-stratification", [*LATTICE, "ca_model.arrivals='poisson'"]
    ),
    "drawn over a heap": Case(
        "ca_model", "lattice-stratification", [*LATTICE, *HEAP, "ca_model.arrivals='drawn'"]
    ),
    "uneven feed": Case(
        "ca_model", "lattice-stratification", [*LATTICE, "feed.inflow=[0.137,0.211]"], longer=2
    ),
    "moving source": Case(
        "ca_model",
        "stockpile",
        [
            "cell.length=5.0",
            "pour.duration=33.0",
            "pour.records=6",
            "feed.source.x=[-4.0,4.0,-4.0]",
        ],
    ),
    "toppling": Case(
        "ca_model", "franks", ["cell.length=9.0", "pour.duration=45.0", "pour.records=6"]
    ),
    "toppling, extended": Case(
        "ca_model", "franks", ["cell.length=9.0", "pour.duration=40.0", "pour.records=4"], longer=2
    ),
    "rates": Case("ca_model", "makse-stratification", [*SILO, *DIGGING, *RATES]),
    "rates, extended": Case(
        "ca_model",
        "makse-stratification",
        [*SILO, *RATES, "cell.start_slope=0.0", "pour.duration=150.0", "pour.records=4"],
        longer=2,
    ),
    "three species": Case(
        "ca_model", "ternary", ["cell.length=5.0", "pour.duration=9.0", "pour.records=6"]
    ),
    "godunov": Case("continuum", "makse-stratification", SILO),
    "more cells": Case("continuum", "makse-stratification", [*SILO, "continuum.cells=40"]),
    "muscl": Case("continuum", "makse-stratification", [*SILO, "continuum.scheme='muscl'"]),
    "pulses": Case("continuum", "pulsed-feed", [*SILO, "feed.schedule.period=60.0"]),
    "pulses, extended": Case(
        "continuum", "pulsed-feed", [*SILO, "feed.schedule.period=90.0", "pour.records=4"], longer=2
    ),
    "dug up again": Case("continuum", "makse-stratification", [*SILO, *DIGGING]),
    "flow over a heap": Case("continuum", "heap", [*SILO, "pour.duration=40.0"]),
    "drum": Case("continuum", "drum-mixture", [*SILO, "pour.duration=30.0"]),
    "three species flow": Case(
        "continuum", "ternary", [*SILO, "pour.duration=6.0", "continuum.bins_per_depth=1"]
    ),
}


ODD = {  # that come to no end
    "grains dug up later": Case(
        "ca_model",
        "makse-stratification",
        [*SILO, *DIGGING, *RATES, "mixture.surface_depth=0.02", "pour.duration=250.0"],
        longer=2,
    ),
    "dug up later": Case(
        "continuum", "makse-stratification", [*SILO, *DIGGING, "pour.duration=250.0"], longer=2
    ),
}


def pour(case: str, path: str, *, extend: bool = False, **options: Any) -> bool:
    """Pour a case into the archive `path`, with a checkpoint after each block of steps."""
    asked = (CASES | ODD)[case]
    experiment = asked.experiment(asked.longer if extend else 1)
    return streaming.pour_to_file(
        asked.begin, experiment, Path(path), extend=extend, **{"every": 0.0} | options
    )


def main() -> None:
    """Load and compile all that pours need, then do as told."""
    phase = mmap.mmap(-1, 1)
    Work.checkpoint = _telling(phase, 2, Work.checkpoint)
    Work.clear = _telling(phase, 4, Work.clear)
    streaming.run_to_the_end = _telling(phase, 1, streaming.run_to_the_end)
    with TemporaryDirectory() as folder:
        for name in CASES:
            pour(name, f"{folder}/{name}.nc")
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGCHLD})
    _tell(threading.active_count() == len(os.listdir("/proc/self/task")) == 1)
    for line in sys.stdin:
        asked = json.loads(line) | {"finish": _telling(phase, 3, assemble_on_disk)}
        _tell(_killed_after(phase, **asked))


def _tell(told: object) -> None:
    sys.stdout.write(json.dumps(told) + "\n")
    sys.stdout.flush()


def _killed_after(phase: mmap.mmap, delay: float, **asked: Any) -> dict[str, Any]:
    phase[0] = 0
    begun = time.perf_counter()
    child = os.fork()
    if not child:
        _be_poured(asked)
    signal.sigtimedwait({signal.SIGCHLD}, delay)
    os.kill(child, signal.SIGKILL)  # a zombie, if it was at its end; the number is not yet free
    _, status = os.waitpid(child, 0)
    signal.sigtimedwait({signal.SIGCHLD}, 0)  # heard
    return {
        "status": os.waitstatus_to_exitcode(status),
        "phase": PHASES[phase[0]],
        "seconds": time.perf_counter() - begun,
    }


def _be_poured(asked: dict[str, Any]) -> None:
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGCHLD})
    status = 1
    try:
        pour(**asked)
        status = 0
    except StratifyError as error:
        sys.stderr.write(f"{error}\n")
        status = 2
    finally:
        os._exit(status)


def _telling(phase: mmap.mmap, now: int, done: Callable[..., Any]) -> Callable[..., Any]:
    """The same function, and while it works the place in PHASES of what it does is told."""

    @wraps(done)
    def telling(*args: Any, **options: Any) -> Any:
        before, phase[0] = phase[0], now
        found = done(*args, **options)
        phase[0] = before
        return found

    return telling


if __name__ == "__main__":
    main()
