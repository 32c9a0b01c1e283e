"""The continuum's kernel beside the same step in C, and both beside the machine's floor.

Per cell and sub-step two species need 123 additions, multiplications and comparisons and 6
divisions; 72 bytes are read and 56 written. A pour of 200 cells keeps its 30 kB in the innermost
cache, so arithmetic is what costs; the floor counts all of it at the machine's rate of
multiplications and additions in vector lanes, measured here.

continuum.c is that step as fast as C goes. It is compiled twice: to multiply and add one after the
other, as the kernel does, so that both must give the same numbers; and free to contract them to
FMA. Kernel and C take turns in one process.
"""

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import repeat
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.clock import once, seconds_in_turn
from continuum import Law, Resolution, law_of
from continuum.kernel import advance
from continuum.slopes import slopes_of
from continuum.state import Flow, Grid
from experiment import load
from experiment.arrays import Floats

SOURCE = Path(__file__).with_name("continuum.c")
GCC = ["gcc", "-O3", "-march=native", "-shared", "-fPIC"]
CONTRACTIONS = ("off", "fast")
OPERATIONS, DIVISIONS, BYTES = 123, 6, 128  # per cell and sub-step, two species
WARM_UP = {200: 1000.0, 1000: 300.0}  # s: stratified, and many layers deep
STEPS = {200: 3000, 1000: 1500}
ENSEMBLE = 64
ROUNDS = 9


class Pour(NamedTuple):
    """What both are given."""

    flow: Flow
    law: Law
    grid: Grid
    velocity: Floats
    inflow: Floats  # (step, species)


Reals, Integers = ctypes.POINTER(ctypes.c_double), ctypes.POINTER(ctypes.c_int64)


class Job(ctypes.Structure):
    """The structure of that name in continuum.c."""

    _fields_ = (
        *((name, ctypes.c_int64) for name in ("species", "cells", "bins")),
        *((name, Reals) for name in ("height", "rolling", "surface", "filling", "deposit")),
        ("top", Integers),
        *((name, Reals) for name in ("rigid", "rigid_fraction")),
        *((name, Reals) for name in ("repose_slope", "collision_rate", "cross_amplification")),
        *(
            (name, ctypes.c_double)
            for name in ("smoothing", "surface_depth", "curvature_length", "dx", "dt", "dz")
        ),
        *((name, Reals) for name in ("velocity", "inflow")),
        *((name, ctypes.c_int64) for name in ("steps", "substeps")),
    )


def job_of(pour: Pour) -> Job:
    flow = pour.flow._asdict() | {"deposit": pour.flow.tape}
    species, cells, bins = pour.flow.tape.shape
    given = flow | pour.law._asdict() | pour.grid._asdict()
    given |= {"species": species, "cells": cells, "bins": bins, "steps": len(pour.inflow)}
    given |= {"velocity": pour.velocity, "inflow": pour.inflow}
    job = Job()
    job.kept = []  # arrays that only the job refers to
    for name, kind in Job._fields_:
        if name in given and kind in (Reals, Integers):
            array = np.ascontiguousarray(given[name])
            job.kept.append(array)
            setattr(job, name, array.ctypes.data_as(kind))
        elif name in given:
            setattr(job, name, given[name])
    return job


def stratified(cells: int, seed: int | None = None) -> Pour:
    """A pour that has gone on for a while; with a seed, one of an ensemble of laws and feeds."""
    experiment = load("makse-stratification", [f"continuum.cells={cells}"])
    grid = Resolution.parse(experiment.continuum, "continuum").grid(experiment)
    law, inflow = law_of(experiment.mixture), np.array(experiment.feed.inflow)
    if seed is not None:
        random = np.random.default_rng(seed)
        rates = np.array(law.collision_rate) * random.uniform(0.8, 1.2)
        law = law._replace(collision_rate=tuple(map(tuple, rates.tolist())))
        inflow = inflow * random.uniform(0.8, 1.2, len(inflow))
    flow = slopes_of(experiment, grid, cells, law)[0].flow
    flow = flow._replace(tape=np.zeros((*flow.rolling.shape, 2000)))
    velocity = np.array(experiment.mixture.drift_velocity)
    warm_up = np.tile(inflow, (round(WARM_UP[cells] / grid.dt), 1))
    advance(flow, law, grid, velocity, warm_up)
    return Pour(flow, law, grid, velocity, np.tile(inflow, (STEPS[cells], 1)))


def copied(pour: Pour) -> Pour:
    return pour._replace(flow=Flow(*(array.copy() for array in pour.flow)))


def compiled(folder: str) -> dict[str, ctypes.CDLL]:
    """The C of each contraction."""
    libraries = {}
    for contraction in CONTRACTIONS:
        target = f"{folder}/{contraction}.so"
        flags = [f"-ffp-contract={contraction}", str(SOURCE), "-o", target, "-lm"]
        subprocess.run([*GCC, *flags], check=True)
        library = ctypes.CDLL(target)
        library.advance_flow.restype = ctypes.c_int64
        library.multiply_and_add.restype = ctypes.c_double
        libraries[contraction] = library
    return libraries


def in_c(pour: Pour, library: ctypes.CDLL) -> int:
    """Take the steps of `pour` in C; returns how many sub-steps that took."""
    job = job_of(pour)
    taken = library.advance_flow(ctypes.byref(job))
    if taken != len(pour.inflow):
        raise RuntimeError(f"C took {taken} of {len(pour.inflow)} steps")
    return int(job.substeps)


def in_numba(pour: Pour) -> None:
    taken = advance(*pour).steps
    if taken != len(pour.inflow):
        raise RuntimeError(f"the kernel took {taken} of {len(pour.inflow)} steps")


def disagreement(pour: Pour, library: ctypes.CDLL) -> float:
    """The largest difference between kernel and C, relative to each array's largest value."""
    ours, theirs = copied(pour), copied(pour)
    in_numba(ours)
    in_c(theirs, library)
    return max(
        float(np.abs(a - b).max() / max(np.abs(a).max(), 1e-300))
        for name, a, b in zip(Flow._fields, ours.flow, theirs.flow, strict=True)
        if name not in ("sealed", "buried", "held", "outflow")  # C, into a silo, needs none
    )


def floor(library: ctypes.CDLL) -> float:
    """Seconds that the arithmetic of a cell and sub-step takes at the machine's best."""
    repeats, operations = 100_000, 100_000 * 12 * 8 * 2
    best = min(once(lambda: library.multiply_and_add(ctypes.c_int64(repeats))) for _ in range(20))
    rate = operations / best
    print(f"the machine multiplies and adds {rate / 1e9:.0f} times in a ns, in lanes, on one core")
    return (OPERATIONS + DIVISIONS) / rate


def each(pours: Sequence[Pour], action: Callable[..., object], *more: object, threads: int) -> None:
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(action, pours, *(repeat(argument) for argument in more)))


def compare(title: str, pours: Sequence[Pour], libraries: dict[str, ctypes.CDLL], threads: int):
    """Time kernel and C in turn on copies of `pours`; (title, ns of each, their ratio)."""
    substeps = sum(in_c(copied(pour), libraries["off"]) for pour in pours)
    updates = substeps * pours[0].flow.height.size
    actions = {"kernel": lambda on: each(on, in_numba, threads=threads)} | {
        name: lambda on, library=library: each(on, in_c, library, threads=threads)
        for name, library in libraries.items()
    }
    took = seconds_in_turn(lambda: [copied(pour) for pour in pours], actions, ROUNDS)
    ns = {name: time / updates * 1e9 for name, time in took.items()}
    gigabytes = BYTES / ns["kernel"]
    print(
        f"{title:32s} {ns['kernel']:8.2f} {ns['off']:8.2f} {ns['fast']:8.2f} "
        f"{ns['kernel'] / ns['off']:8.2f} {ns['kernel'] / ns['fast']:8.2f} {gigabytes:8.0f}"
    )


def main() -> None:
    if shutil.which("gcc") is None:
        print("gcc is missing: the kernel is not compared with C")
        return
    with tempfile.TemporaryDirectory() as folder:
        libraries = compiled(folder)
        single = {cells: stratified(cells) for cells in WARM_UP}
        least = floor(libraries["off"])
        print(
            f"floor: {OPERATIONS} operations, {DIVISIONS} divisions, {BYTES} bytes a cell and "
            f"sub-step: {least * 1e9:.2f} ns\n"
            f"C without FMA differs from the kernel by "
            f"{max(disagreement(pour, libraries['off']) for pour in single.values()):.1e}, "
            f"with FMA by {max(disagreement(p, libraries['fast']) for p in single.values()):.1e}"
        )
        print(
            f"{'ns a cell and sub-step':32s} {'kernel':>8s} {'C':>8s} {'C, FMA':>8s} "
            f"{'k / C':>8s} {'k / FMA':>8s} {'GB/s':>8s}"
        )
        for cells, pour in single.items():
            compare(f"one pour, {cells} cells", [pour], libraries, 1)
        ensemble = [
            pour._replace(inflow=pour.inflow[:150])
            for pour in (stratified(200, seed) for seed in range(ENSEMBLE))
        ]
        for threads in (1, 2):
            title = f"{ENSEMBLE} pours, 200 cells, {threads} thread{'s' * (threads > 1)}"
            compare(title, ensemble, libraries, threads)
