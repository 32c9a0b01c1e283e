"""Jobs in processes of this machine, one a processor.

A pour and its measurement spend much of their time outside the kernels, and that holds the
interpreter: a second thread hardly helps, a second process gives 1.96 times the outcomes. So each
processor gets a process of its own, which takes some 1.7 s to start, and loads the kernels that
were compiled before.

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
from multiprocessing.synchronize import Event

from compare.campaign.jobs import AHEAD, LOST, Job, Numbered, Outcome, Outcomes, do, failed
from experiment import StratifyError

__all__ = ["in_processes"]

START = "spawn"  # forks copy the locks of threads that they do not have
UNGUARDED = (
    "no process could be started to pour in: "
    'a script does so below `if __name__ == "__main__"`, or with workers=1'
)

UnderWay = dict[Future[Outcome], Numbered]


def in_processes(jobs: Iterable[Job], workers: int) -> Outcomes:
    """The outcomes of `jobs` as they come; when this process ends or is stopped, so do the others.

    A script that calls this does so below `if __name__ == "__main__"`. Raises
    :class:`StratifyError` where no process can start.
    """
    waiting = iter(enumerate(jobs))
    suspects: deque[Numbered] = deque()
    under_way: UnderWay = {}
    while True:
        try:
            with _pool(workers) as pool:
                yield from _as_they_come(pool, waiting, under_way, suspects, AHEAD * workers)
        except BrokenProcessPool:
            pass
        else:
            return
        for future, (number, job) in under_way.items():
            if future.done() and future.exception() is None:
                yield number, future.result()
            else:
                suspects.append((number, job))
        under_way.clear()
        while suspects:
            yield from _one_by_one(suspects)


def _as_they_come(
    pool: ProcessPoolExecutor,
    waiting: Iterator[Numbered],
    under_way: UnderWay,
    suspects: deque[Numbered],
    room: int,
) -> Outcomes:
    """Outcomes of the jobs that are `waiting`, at most `room` of which are `under_way` at once."""
    with _interrupts_after():
        _submit(pool, waiting, under_way, suspects, room)
    while under_way:
        done, _ = wait(under_way, return_when=FIRST_COMPLETED)
        for future in done:
            number, outcome = under_way[future][0], future.result()
            del under_way[future]
            yield number, outcome
        _submit(pool, waiting, under_way, suspects, room)


def _submit(
    pool: ProcessPoolExecutor,
    waiting: Iterator[Numbered],
    under_way: UnderWay,
    suspects: deque[Numbered],
    room: int,
) -> None:
    """Fill the room; a job that a broken pool does not take is a suspect, so as not to be lost."""
    for number, job in islice(waiting, room - len(under_way)):
        try:
            under_way[pool.submit(do, job)] = number, job
        except BrokenProcessPool:
            suspects.append((number, job))
            raise


def _one_by_one(suspects: deque[Numbered]) -> Outcomes:
    """Outcomes of the jobs that are first in `suspects`, up to the first that ends its process."""
    with _pool(1) as pool:
        while suspects:
            number, job = suspects[0]
            try:
                with _interrupts_after():
                    future = pool.submit(do, job)
            except BrokenProcessPool:  # it was ended while it had nothing to do
                return
            suspects.popleft()
            try:
                outcome = future.result()
            except BrokenProcessPool:
                yield number, failed(LOST)
                return
            yield number, outcome


@contextmanager
def _pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """So many workers. Raises :class:`StratifyError` where it breaks before one of them starts."""
    context = multiprocessing.get_context(START)
    started = context.Event()
    pool = ProcessPoolExecutor(workers, context, initializer=_start, initargs=(started,))
    try:
        yield pool
    except BrokenProcessPool:
        if not started.is_set():
            raise StratifyError(UNGUARDED) from None
        raise
    finally:
        pool.shutdown(cancel_futures=True)


@contextmanager
def _interrupts_after() -> Iterator[None]:
    """What is pressed within is heard after it, here and by the processes that start within."""
    pressed: list[int] = []
    in_main_thread = threading.current_thread() is threading.main_thread()
    heard = in_main_thread and signal.getsignal(signal.SIGINT) is not signal.SIG_IGN
    if heard:  # other threads may take the signal, and it would be raised in this one
        handler = signal.signal(signal.SIGINT, lambda number, _: pressed.append(number))
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # processes inherit it
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        if heard:
            signal.signal(signal.SIGINT, handler)
        if pressed:
            signal.raise_signal(signal.SIGINT)


def _start(started: Event) -> None:
    """Make a worker end with its parent, and without a word when stopped from the keyboard."""
    started.set()
    threading.Thread(target=_end_with_parent, daemon=True).start()
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
