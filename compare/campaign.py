"""Many pours, each measured as it is poured: a campaign.

A pour takes a fraction of a second, most of it outside the kernels, and that holds the interpreter:
on two processors, 24 pours of glass-sugar on the lattice took 2.6 s on one thread, 2.5 s on two,
and 1.5 to 2 s in two processes, once these had started (1.7 s). So each processor gets a process of
its own. The numbers are the same for any number of them.
"""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from typing import NamedTuple

import numpy as np
import xarray as xr

import ca_model
import continuum
from compare.measurement import measure
from compare.quantities import collision_rate, named, total_inflow, velocity
from experiment import Experiment, StratifyError
from experiment.pouring import Begin

__all__ = ["BEGIN", "CHECK", "POUR", "campaign", "with_chance"]

POUR: dict[str, Callable[..., xr.Dataset]] = {
    "ca_model": ca_model.pour,
    "continuum": continuum.pour,
}
BEGIN: dict[str, Begin] = {"ca_model": ca_model.begin, "continuum": continuum.begin}
CHECK = {"ca_model": ca_model.check, "continuum": continuum.check}
START = "spawn"  # forks copy the locks of threads that they do not have


class Outcome(NamedTuple):
    """What came of one pour: its numbers, or why there are none."""

    measured: xr.Dataset | None
    failure: str


Jobs = Sequence[tuple[str, Experiment]]  # model, set-up
Outcomes = Generator[tuple[int, Outcome], None, None]  # with the number of each job


def campaign(
    experiments: Sequence[Experiment],
    models: Sequence[str] = tuple(POUR),
    *,
    workers: int | None = None,
    progress: Callable[[float], object] | None = None,
) -> xr.Dataset:
    """What :func:`measure` finds in each of `experiments`, poured by each of `models`.

    A Dataset over `model` and `pour`, with the scales of each pour beside it: total_inflow R0 [cm],
    drift_velocity v [cm/s] and collision_rate gamma [1/s]. Where a pour fails, `failure` says why,
    numbers are NaN and the regime is empty; the others go on. Pours are shared among as many
    processes as `workers`, by default one a processor; with one, all is done in this process.
    A script that calls this with more does so below `if __name__ == "__main__"`. `progress` is
    called with the share that is done. Raises :class:`StratifyError` where every pour fails.
    """
    jobs = [(model, experiment) for model in models for experiment in experiments]
    outcomes: dict[int, Outcome] = {}
    workers = min(workers or os.cpu_count() or 1, len(jobs))
    finished = _in_turn(jobs) if workers <= 1 else _at_once(jobs, workers)
    with closing(finished):
        for job, outcome in finished:
            outcomes[job] = outcome
            if progress is not None:
                progress(len(outcomes) / len(jobs))
    return _table([outcomes[job] for job in range(len(jobs))], models, len(experiments))


def with_chance(experiment: Experiment, model: str) -> bool:
    """Whether pours that differ in `pour.pile` only are different in `model`."""
    if model != "ca_model":
        return False
    settings = ca_model.Settings.parse(experiment.ca_model, "ca_model")
    toppling_at_random = settings.rule == "toppling" and settings.threshold_spread > 0
    return toppling_at_random or settings.arrivals != "fixed"


def _in_turn(jobs: Jobs) -> Outcomes:
    return ((number, _outcome(*job)) for number, job in enumerate(jobs))


def _at_once(jobs: Jobs, workers: int) -> Outcomes:
    """The outcomes as they come; when this process ends or is stopped, so are the others."""
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context(START), initializer=_start)
    try:
        with _interrupts_after():
            numbers: dict[Future[Outcome], int] = {
                pool.submit(_outcome, *job): number for number, job in enumerate(jobs)
            }
        for future in as_completed(numbers):
            yield numbers[future], future.result()
    except BrokenProcessPool:
        raise StratifyError(
            "a process that poured was ended from outside, perhaps for want of memory: "
            "fewer workers need less"
        ) from None
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


def _outcome(model: str, experiment: Experiment) -> Outcome:
    try:
        archive = POUR[model](experiment)
        return Outcome(measure(archive).assign(_scales(archive)), "")
    except StratifyError as error:
        return Outcome(None, str(error))
    except Exception as error:  # one pour of many: it is told, and the others go on
        return Outcome(None, f"{type(error).__name__}: {error}")


def _scales(archive: xr.Dataset) -> dict[str, xr.Variable]:
    r0, v, gamma = total_inflow(archive), velocity(archive), collision_rate(archive)
    return {
        "total_inflow": xr.Variable((), r0, named("thickness R0 of what is poured", "cm")),
        "drift_velocity": xr.Variable((), v, named("velocity v of what is poured", "cm s-1")),
        "collision_rate": xr.Variable((), gamma, named("rate gamma of what is poured", "s-1")),
    }


def _table(outcomes: list[Outcome], models: Sequence[str], pours: int) -> xr.Dataset:
    """All outcomes over `model` and `pour`."""
    known = next((o.measured for o in outcomes if o.measured is not None), None)
    if known is None:
        reason = outcomes[0].failure if outcomes else "there is none"
        raise StratifyError(f"no pour could be measured: {reason}")
    dims, shape = ("model", "pour"), (len(models), pours)
    variables = {}
    for name, told in known.data_vars.items():
        kind, missing = (str, "") if told.dtype.kind == "U" else (float, np.nan)
        values = [missing if o.measured is None else o.measured[name].item() for o in outcomes]
        variables[str(name)] = (dims, np.array(values, dtype=kind).reshape(shape), told.attrs)
    failures = np.array([outcome.failure for outcome in outcomes]).reshape(shape)
    variables["failure"] = (dims, failures, {"long_name": "why a pour has no numbers"})
    names = {"model_name": ("model", list(models))}
    return xr.Dataset(variables).assign_coords(names).set_xindex("model_name")
