"""Jobs on the workers of a Dask cluster, on however many machines.

A job whose worker is lost is done by another one; each outcome arrives once. Dask gives up a job
that was with several workers when they were lost, even one that only waited there. Such jobs are
then done one by one, and the one with which workers are lost again is told as failed.

Numbers are the same as here, for a worker does a job only if it has this version of `stratify`, of
numpy and of numba. Workers may join and leave at any time, and have any number of threads.
"""

import asyncio
import logging
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import cache, partial
from itertools import islice
from typing import Any

from distributed import (
    CancelledError,
    Client,
    Future,
    KilledWorker,
    Security,
    get_worker,
    rpc,
    wait,
)
from distributed.client import ClosedClientError
from distributed.comm.addressing import parse_address
from distributed.comm.registry import get_backend
from distributed.utils import LoopRunner

from compare.campaign.jobs import (
    AHEAD,
    LOST,
    Job,
    Numbered,
    Outcome,
    Outcomes,
    Scheduler,
    do,
    failed,
)
from experiment import SetupError, StratifyError
from experiment.archive.provenance import made_by

__all__ = ["cluster_at"]

PATIENCE = 10.0  # s, to reach the scheduler, and to see a worker
_made_by = cache(made_by)  # it reads files


def cluster_at(address: str) -> Scheduler:
    """What shares jobs among the workers of the cluster whose scheduler is at `address`.

    When it is closed, jobs that wait there are forgotten, those that a worker does are not heard.
    Raises :class:`SetupError` where no scheduler answers, there or later, or it has no workers, or
    one of them differs from this process.
    """
    with _client(address):
        return lambda jobs: _on_cluster(jobs, address)


def _on_cluster(jobs: Iterable[Job], address: str) -> Outcomes:
    suspects: list[Numbered] = []
    with _client(address) as client:
        yield from _as_they_come(client, address, iter(enumerate(jobs)), suspects)
        for suspect in suspects:
            guilty: list[Numbered] = []
            yield from _as_they_come(client, address, iter([suspect]), guilty)
            yield from ((number, failed(LOST)) for number, _ in guilty)


def _as_they_come(
    client: Client, address: str, waiting: Iterator[Numbered], given_up: list[Numbered]
) -> Outcomes:
    """Outcomes of the jobs that are `waiting`, but for those that are `given_up` by Dask."""
    under_way: dict[Future[Outcome], Numbered] = {}
    while True:
        room = AHEAD * max(1, sum(client.nthreads().values())) - len(under_way)
        new = list(islice(waiting, max(0, room)))
        jobs = [job for _, job in new]
        futures = client.map(_do, jobs, address=address, made_here=_made_by(), pure=False)
        under_way |= zip(futures, new, strict=True)
        if not under_way:
            return
        try:
            done = _done(client, under_way)
        except TimeoutError:
            _refuse_without_workers(client, address)
            continue
        for future, outcome in done.items():
            number, job = under_way.pop(future)
            try:
                yield number, outcome or future.result()
            except KilledWorker:
                given_up.append((number, job))


def _do(job: Job, address: str, made_here: str) -> Outcome:
    """What comes of `job`, by a worker that is like the process it comes from."""
    if _made_by() != made_here:
        raise SetupError(
            f"scheduler = {address}: its worker {get_worker().address} is {_made_by()}, "
            f"here is {made_here}; both should be the same"
        )
    return do(job)


def _done(client: Client, futures: Iterable[Future[Any]]) -> dict[Future[Any], Any]:
    """Those of the `futures` that are done, once some are, with what came of them or None.

    Raises :class:`TimeoutError` where that takes longer than PATIENCE.
    """
    with client.as_current():
        done, _ = wait(list(futures), PATIENCE, "FIRST_COMPLETED")
    numbered = dict(enumerate(done))
    ask = partial(client.gather, numbered, errors="skip", asynchronous=True)  # all on one way
    found = client.sync(ask, callback_timeout=PATIENCE)
    return {future: found[k] for k, future in numbered.items()}


@contextmanager
def _client(address: str) -> Iterator[Client]:
    """A connection to a cluster that has workers; what goes wrong with it is told in one line."""
    with _no_word_of(logging.getLogger("distributed.client")):
        try:
            LoopRunner().run_sync(_refuse_no_scheduler, address)  # no client is left half made
            client = Client(address, timeout=PATIENCE, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            raise SetupError(
                f"scheduler = {address}: no Dask scheduler answers there{_reason(error)}; "
                "it should be the address that `dask scheduler` says, as in tcp://10.0.0.1:8786"
            ) from None
        try:
            _refuse_without_workers(client, address)
            yield client
        except (CancelledError, ClosedClientError, OSError):
            raise StratifyError(f"scheduler = {address}: the connection to it was lost") from None
        except (ImportError, AttributeError, RuntimeError) as error:  # jobs tell theirs otherwise
            raise SetupError(
                f"scheduler = {address}: it and its workers should have this stratify installed"
                f"{_reason(error)}"
            ) from None
        finally:
            client.close()


@contextmanager
def _no_word_of(log: logging.Logger) -> Iterator[None]:
    before, log.disabled = log.disabled, True
    try:
        yield
    finally:
        log.disabled = before


def _reason(error: BaseException) -> str:
    """Why, in brackets, on one line, if there is a word of it."""
    told = " ".join(str(error.__cause__ or error).split())
    return f" ({told})" if told else ""


async def _refuse_no_scheduler(address: str) -> None:
    arguments = Security().get_connection_args("client")
    try:
        async with rpc(address, timeout=PATIENCE / 2, connection_args=arguments) as there:
            who = await asyncio.wait_for(there.identity(), PATIENCE)
    except OSError as error:
        if _reason(error):
            raise
        await _try_once(address, arguments)  # the last of the tries had no time to learn why
        raise
    if who["type"] != "Scheduler":
        raise ValueError(f"it is that of a {who['type']}")


async def _try_once(address: str, arguments: dict[str, Any]) -> None:
    """Connect and part again. Raises OSError with the reason where that cannot be."""
    scheme, place = parse_address(address)
    connected = get_backend(scheme).get_connector().connect(place, deserialize=True, **arguments)
    (await asyncio.wait_for(connected, PATIENCE)).abort()


def _refuse_without_workers(client: Client, address: str) -> None:
    try:
        client.wait_for_workers(1, PATIENCE)
    except TimeoutError:
        raise SetupError(
            f"scheduler = {address}: it has no workers; `dask worker {address}` starts one"
        ) from None
