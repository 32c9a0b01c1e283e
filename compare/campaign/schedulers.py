"""Where jobs are done: in turn here, in processes of this machine, or on a cluster.

A scheduler takes jobs and hands out each job's number with its outcome, as they come. It asks for
jobs only a little ahead of what it does, so that they may be as many as there are points in a
diagram. When what it gave is closed, it stops.
"""

import os
from collections.abc import Iterable

from compare.campaign.jobs import Job, Outcomes, Scheduler, do
from compare.campaign.processes import in_processes
from experiment import SetupError

__all__ = ["in_turn", "scheduler_of"]


def scheduler_of(workers: int | None, address: str | None, jobs: int) -> Scheduler:
    """The scheduler for so many `jobs`: at the `address` of a Dask cluster, or here with `workers`.

    By default there is one worker a processor; one alone is this process itself. Raises
    :class:`SetupError` where there is no such cluster.
    """
    if address is not None:
        return _cluster_at(address)
    many = min(workers or os.cpu_count() or 1, jobs)
    return in_turn if many <= 1 else lambda jobs: in_processes(jobs, many)


def in_turn(jobs: Iterable[Job]) -> Outcomes:
    """The outcomes of `jobs`, one after the other, in this process."""
    return ((number, do(job)) for number, job in enumerate(jobs))


def _cluster_at(address: str) -> Scheduler:
    try:
        from compare.campaign.cluster import cluster_at
    except ImportError:
        raise SetupError(
            f"scheduler = {address}: it needs dask: pip install 'stratify[cluster]'"
        ) from None
    return cluster_at(address)
