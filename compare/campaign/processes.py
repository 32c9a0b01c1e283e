"""Jobs in processes of this machine, one a processor.

A pour spends much of its time outside the kernels, and that holds the interpreter: on two
processors, 24 pours of glass-sugar on the lattice took 2.6 s on one thread, 2.5 s on two, and 1.5
to 2 s in two processes, once these had started (1.7 s). So each processor gets a process of its
own, which loads the kernels that were compiled before.

A worker that is ended from outside, perhaps for want of memory, takes with it whatever was under
way. These jobs are then done one by one, and the one that ends its process again is told as failed.
"""

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import islice

from compare.campaign.jobs import Job, Numbered, Outcome, Outcomes, do, failed

__all__ = ["in_processes"]

START = "spawn"  # forks copy the locks of threads that they do not have
AHEAD = 3  # jobs a worker, of which one is done and the others wait
ENDED = "its process was ended from outside, twice, perhaps for want of memory"


def in_processes(jobs: Iterable[Job], workers: int) -> Outcomes:
    """The outcomes of `jobs` as they come; when this process ends or is stopped, so do the others.

    A script that calls this does so below `if __name__ == "__main__"`.
    """
    waiting = iter(enumerate(jobs))
    under_way: dict[Future[Outcome], Numbered] = {}
    while True:
        with _pool(workers) as pool:
            try:
                yield from _as_they_come(pool, waiting, under_way, AHEAD * workers)
            except BrokenProcessPool:
                pass
            else:
                return
        suspects = deque(under_way.values())
        under_way.clear()
        while suspects:
            yield from _one_by_one(suspects)


def _as_they_come(
    pool: ProcessPoolExecutor,
    waiting: Iterator[Numbered],
    under_way: dict[Future[Outcome], Numbered],
    room: int,
) -> Outcomes:
    """Outcomes of the jobs that are `waiting`, at most `room` of which are `under_way` at once."""
    with _interrupts_after():
        _submit(pool, islice(waiting, room), under_way)
    while under_way:
        done, _ = wait(under_way, return_when=FIRST_COMPLETED)
        for future in done:
            outcome = future.result()
            number, _job = under_way.pop(future)
            _submit(pool, islice(waiting, 1), under_way)
            yield number, outcome


def _submit(
    pool: ProcessPoolExecutor, jobs: Iterable[Numbered], under_way: dict[Future[Outcome], Numbered]
) -> None:
    for number, job in jobs:
        under_way[pool.submit(do, job)] = number, job


def _one_by_one(suspects: deque[Numbered]) -> Outcomes:
    """Outcomes of the jobs that are first in `suspects`, up to the first that ends its process."""
    with _pool(1) as pool:
        while suspects:
            number, job = suspects.popleft()
            try:
                with _interrupts_after():
                    future = pool.submit(do, job)
                yield number, future.result()
            except BrokenProcessPool:
                yield number, failed(ENDED)
                return


@contextmanager
def _pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    context = multiprocessing.get_context(START)
    pool = ProcessPoolExecutor(workers, context, initializer=_start)
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


@contextmanager
def _interrupts_after() -> Iterator[None]:
    """What is pressed within is heard after it, here and by the processes that start within."""
    pressed: list[int] = []
    in_main_thread = threading.current_thread() is threading.main_thread()
    if in_main_thread:  # other threads may take the signal, and it would be raised in this one
        handler = signal.signal(signal.SIGINT, lambda number, _: pressed.append(number))
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # processes inherit it
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        if in_main_thread:
            signal.signal(signal.SIGINT, handler)
        if pressed:
            signal.raise_signal(signal.SIGINT)


def _start() -> None:
    """Make a worker end with its parent, and without a word when stopped from the keyboard."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
