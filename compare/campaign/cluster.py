"""Jobs on the workers of a Dask cluster, on however many machines.

A job whose worker is lost is done by another one; each outcome arrives once. Workers must have this
version of `stratify` with the same numpy and numba, so that their numbers are the same as here.
"""

from collections.abc import Generator, Iterable, Iterator
from contextlib import contextmanager
from itertools import islice
from typing import TYPE_CHECKING

from compare.campaign.jobs import Job, Outcome, do, failed
from experiment import SetupError, StratifyError
from experiment.archive.provenance import made_by

if TYPE_CHECKING:
    from distributed import Client

__all__ = ["on_cluster"]

AHEAD = 3  # jobs a worker's thread, of which one is done and the others wait
PATIENCE = 20.0  # s, to reach the scheduler, and to see a worker

Outcomes = Generator[tuple[int, Outcome], None, None]


def on_cluster(jobs: Iterable[Job], address: str) -> Outcomes:
    """The outcomes of `jobs` as they come from the cluster whose scheduler is at `address`.

    Raises :class:`SetupError` where there is none, or its workers differ from this process.
    """
    from distributed import CancelledError, KilledWorker, as_completed

    waiting = iter(enumerate(jobs))
    with _client(address) as client:
        room = AHEAD * sum(client.nthreads().values())
        numbers = {
            client.submit(do, job, pure=False): number for number, job in islice(waiting, room)
        }
        done = as_completed(numbers)
        for future in done:
            try:
                outcome = future.result()
            except KilledWorker as error:
                outcome = failed(f"workers were lost with it: {error}")
            except CancelledError:
                raise StratifyError(f"scheduler = {address}: it was lost") from None
            yield numbers.pop(future), outcome
            for number, job in islice(waiting, 1):
                after = client.submit(do, job, pure=False)
                numbers[after] = number
                done.add(after)


@contextmanager
def _client(address: str) -> Iterator["Client"]:
    """A connection to a cluster that has workers like this process."""
    try:
        from distributed import Client
    except ImportError:
        raise SetupError(
            f"scheduler = {address}: it needs dask: pip install 'stratify[cluster]'"
        ) from None
    try:
        client = Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise SetupError(
            f"scheduler = {address}: no Dask scheduler answers there: {error}"
        ) from None
    with client:
        _refuse_unlike(client, address)
        yield client


def _refuse_unlike(client: "Client", address: str) -> None:
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
    except TimeoutError:
        raise SetupError(f"scheduler = {address}: it has no workers") from None
    here = made_by()
    for worker, there in client.run(made_by).items():
        if there != here:
            raise SetupError(
                f"scheduler = {address}: its worker {worker} is {there}, here is {here}"
            )
