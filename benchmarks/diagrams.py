"""Phase diagrams: what a point costs, what processors are worth, what a million points would take.

Pours of 200 columns or cells and 30 fillings (L / v each), with 8 records a filling, as many as a
cycle needs. On request, as in `STRATIFY_POINTS=10000`, so many set-ups are mapped by both models;
400 by default.
"""

import os
import tempfile
import time
from collections.abc import Iterable, Iterator
from math import isqrt
from pathlib import Path

import numpy as np

from benchmarks.clock import once
from compare.campaign import POUR, Outcome, Pour
from compare.campaign.jobs import do
from compare.campaign.processes import in_processes
from compare.campaign.schedulers import in_turn
from compare.phase.axes import axes_of
from compare.phase.diagram import phase_to_file
from compare.phase.plan import Plan, plan_of
from experiment import load

POINTS = int(os.environ.get("STRATIFY_POINTS", "400"))
SETTINGS = (
    "continuum.cells=200",
    "ca_model.column_width=0.5",
    "ca_model.unit=0.05",
    "pour.duration=3000.0",
    "pour.records=240",
)
FEW = 64  # jobs by which schedulers are compared
MANY, CORES = 10**6, 100


def plan_with(side: int) -> Plan:
    """The set-ups of (delta, psi), `side` of each, by both models."""
    vary = {
        "mixture.delta": np.linspace(-0.3, 0.5, side).tolist(),
        "mixture.psi": np.linspace(0.02, 0.5, side).tolist(),
    }
    return plan_of(load("makse-segregation", SETTINGS), axes_of(vary), tuple(POUR))


def job_costs(plan: Plan) -> float:
    """Print the mean cost of a job of each model in this process; seconds a point."""
    jobs = list(plan.jobs(range(0, len(plan), max(1, len(plan) // FEW) | 1)))
    total = 0.0
    for model in plan.models:
        mine = [job for job in jobs if isinstance(job, Pour) and job.model == model]
        for job in mine:
            job()
        took = [once(job) for job in mine]
        total += float(np.mean(took))
        print(f"{model:10s} pour and measure {np.mean(took) * 1e3:6.1f} ms")
    return total


def rate(outcomes: Iterator[tuple[int, Outcome]], after: int) -> float:
    """Outcomes a second, from the one on by which all processes are under way."""
    times = np.array([time.perf_counter() for _ in outcomes])[after:]
    return float((len(times) - 1) / (times[-1] - times[0]))


def speed_up(plan: Plan) -> None:
    """Print how many outcomes a second come of one process, and of one a processor."""
    workers = os.cpu_count() or 1
    jobs = list(plan.jobs(range(min(len(plan), 4 * FEW))))
    alone = rate(in_turn(jobs), FEW // 2)
    together = rate(in_processes(jobs, workers), FEW // 2)
    print(f"{workers} processes: {together / alone:.2f} times the pours of one")


def mapped(plan: Plan) -> None:
    """Print how long the whole diagram takes, start and file included."""
    workers = os.cpu_count() or 1
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "phase.nc"
        took = once(lambda: phase_to_file(plan, path, lambda jobs: in_processes(jobs, workers)))
        size = path.stat().st_size
    points = len(plan) // len(plan.models)
    print(
        f"{points} set-ups by both models: {took / 60:.1f} min on {workers} processors, "
        f"{took / points * 1e3:.0f} ms each, {size / points:.0f} bytes each in the file"
    )


def overhead(plan: Plan) -> float:
    """Print what the process that shares out the jobs does for each outcome; seconds a job."""
    outcome = do(next(plan.jobs([0])))

    def known(jobs: Iterable[object]) -> Iterator[tuple[int, Outcome]]:
        yield from ((number, outcome) for number, _ in enumerate(jobs))

    with tempfile.TemporaryDirectory() as folder:
        took = once(lambda: phase_to_file(plan, Path(folder) / "phase.nc", known))
    print(f"journal and table of an outcome {took / len(plan) * 1e6:6.0f} us")
    return took / len(plan)


def main() -> None:
    plan = plan_with(isqrt(POINTS))
    point = job_costs(plan)
    speed_up(plan)
    kept = overhead(plan)
    mapped(plan)
    hours = MANY * point / CORES / 3600
    print(
        f"{MANY:.0e} points on {CORES} processors like these: {hours:.2f} h; "
        f"their outcomes occupy one process for {MANY * 2 * kept / 3600:.2f} h of it"
    )
