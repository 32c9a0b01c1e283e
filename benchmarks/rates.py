"""The kernel of the rate rule beside the same rule in C, and what pours by it cost.

rates.c draws the same words and finds the same doubles, so it lays the very same grains: before
anything is timed heights, layers, stacks and the state of the random numbers are compared, here and
in set-ups altered so that every branch is taken. Kernel and C take turns in one process.
"""

import ctypes
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

import ca_model
from benchmarks.clock import once, seconds, seconds_in_turn
from ca_model.draws import random_state
from ca_model.feeding import Feeding
from ca_model.lattice import lattice_of
from ca_model.rates.kernel import DONE, advance
from ca_model.rates.pile import RatePile, bare_pile, ranked
from ca_model.rates.state import Exchange, FlowingPile, bare_draws
from experiment import Experiment, load
from experiment.arrays import Ints
from experiment.pouring.slabs import Deposit

SOURCE = Path(__file__).with_name("rates.c")
GCC = ["gcc", "-O3", "-march=native", "-ffp-contract=off", "-shared", "-fPIC"]
DIAMETER = 0.2 / 3  # cm; of the smaller grains of makse-stratification
FINER = ((1, 0.5), (4, 0.5), (16, 0.5), (64, 0.5), (64, 0.25), (64, 0.0625))  # times, cm
ALTERED = (
    "ca_model.contacts=1",
    "ca_model.contacts=7",
    "ca_model.sharpness=1e3",
    "ca_model.sharpness=1e9",
    "ca_model.amplification=0",
    "mixture.smoothing=0.02",
    "mixture.cross_amplification=[[0.0, 0.1], [0.2, 0.0]]",
    "mixture.collision_rate=[[30, 20], [20, 30]]",
    "cell.start_slope=0",
)
STEPS, FEW_STEPS = 6000, 1500
WIDTHS = (0.5, 0.25)  # cm; of whole pours of the finest grains
ROUNDS = 5

STATE = ("height", "rolling", "layer", "grains", "stack", "random")
MATRICES = ("repose_slope", "collision_rate", "cross_amplification")
NUMBERS = ("sharpness", "amplification", "unit", "width", "step")


class Job(ctypes.Structure):
    """The structure of that name in rates.c."""

    _fields_ = (
        *((name, ctypes.c_int64) for name in ("columns", "places", "steps")),
        *((name, ctypes.c_void_p) for name in (*STATE, "arrivals", "grain_height", *MATRICES)),
        *((name, ctypes.c_void_p) for name in ("rigid_fraction", "fastest")),
        *((name, ctypes.c_double) for name in ("smoothing", "curvature_length", *NUMBERS)),
        *((name, ctypes.c_int64) for name in ("contacts", "depth", "exchanges")),
    )


class Pour(NamedTuple):
    """A silo, and what is fed to it; the pile is changed in place."""

    pile: FlowingPile
    rule: Exchange
    arrivals: Ints  # (step, side, rank)


def setup(preset: str, *changes: str) -> Experiment:
    return load(preset, ["ca_model.rule=rate", *changes])


def finer(times: int, width: float) -> Experiment:
    """makse-stratification of grains that are so many times smaller."""
    small = DIAMETER / times
    return setup(
        "makse-stratification",
        f"ca_model.column_width={width}",
        f"ca_model.unit={small}",
        f"mixture.grain_diameter=[{small}, {2 * small}]",
    )


def first_steps(experiment: Experiment, steps: int) -> Pour:
    """The beginning of a pour, with places for all that comes to rest in it."""
    lattice = lattice_of(experiment)
    steps = min(steps, round(experiment.pour.duration / lattice.step))
    arrivals, source = Feeding(experiment, lattice).take(np.arange(steps + 1) * lattice.step)
    pile = RatePile(lattice.rule, lattice.ground, Deposit(), random_state(0), most_places=2**40)
    pile.advance(arrivals, source)
    rule = ranked(lattice.rule)
    bare = bare_pile(rule, lattice.ground, random_state(0))
    places = int(pile.state()["places"][0])
    return Pour(
        bare._replace(stack=np.zeros((lattice.columns, places), dtype=np.int8)),
        rule,
        np.ascontiguousarray(arrivals.take(lattice.rule.smallest_first, axis=2)),
    )


def copied(pour: Pour) -> Pour:
    """What changes is copied, and its pages are there."""
    arrays = {name: getattr(pour.pile, name).copy() for name in (*STATE, "at_rest")}
    return pour._replace(pile=pour.pile._replace(**arrays))


def in_kernel(pour: Pour) -> None:
    ranks, columns = pour.pile.layer.shape
    still = np.zeros(len(pour.arrivals), dtype=np.int64)
    draws = bare_draws(ranks, columns)
    steps, why = advance(pour.pile, pour.rule, draws, pour.arrivals, still)
    if why != DONE:
        raise RuntimeError(f"the kernel took {steps} of {len(pour.arrivals)} steps")


def in_c(library: ctypes.CDLL, pour: Pour) -> int:
    """Take the steps in C; returns in how many columns grains exchanged, over all sub-steps."""
    pile, rule, law = pour.pile, pour.rule, pour.rule.law
    job = Job(pile.grains.size, pile.stack.shape[1], len(pour.arrivals))
    given = {name: getattr(pile, name) for name in STATE}
    given |= {name: np.array(getattr(law, name)) for name in MATRICES}
    given |= {name: np.array(getattr(rule, name)) for name in ("rigid_fraction", "fastest")}
    given |= {"grain_height": np.array(rule.grain_height), "arrivals": pour.arrivals}
    for name, array in given.items():
        setattr(job, name, array.ctypes.data)
    for name in ("smoothing", "curvature_length"):
        setattr(job, name, getattr(law, name))
    for name in (*NUMBERS, "contacts", "depth"):
        setattr(job, name, getattr(rule, name))
    if library.advance_rates(ctypes.byref(job)):
        raise MemoryError
    return int(job.exchanges)


def differing(library: ctypes.CDLL, pour: Pour) -> list[str]:
    """Of which arrays kernel and C do not leave the same bytes behind."""
    ours, theirs = copied(pour), copied(pour)
    in_kernel(ours)
    in_c(library, theirs)
    for pile in (ours.pile, theirs.pile):  # what was dug up is left in a stack's free places
        pile.stack[np.arange(pile.stack.shape[1]) >= pile.grains[:, np.newaxis]] = 0
    pairs = ((name, getattr(ours.pile, name), getattr(theirs.pile, name)) for name in STATE)
    return [name for name, a, b in pairs if not np.array_equal(a, b)]


def check(title: str, library: ctypes.CDLL, pour: Pour) -> None:
    if names := differing(library, pour):
        raise SystemExit(f"{title}: kernel and C differ in {', '.join(names)}")


def compare(title: str, library: ctypes.CDLL, pour: Pour) -> None:
    check(title, library, pour)
    exchanges = in_c(library, copied(pour))
    actions = {"kernel": in_kernel, "C": lambda on: in_c(library, on)}
    took = seconds_in_turn(lambda: copied(pour), actions, ROUNDS)
    ns = {name: time / exchanges * 1e9 for name, time in took.items()}
    ratio = ns["kernel"] / ns["C"]
    print(f"{title:40s}{ns['kernel']:8.1f}{ns['C']:8.1f}{ratio:8.2f}", flush=True)


def in_turn_with_c() -> None:
    if shutil.which("gcc") is None:
        print("gcc is missing: the kernel is not compared with C")
        return
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([*GCC, str(SOURCE), "-o", f"{folder}/rates.so", "-lm"], check=True)
        library = ctypes.CDLL(f"{folder}/rates.so")
        for change in ALTERED:
            for preset in ("makse-stratification", "glass-sugar"):
                check(change, library, first_steps(setup(preset, change), FEW_STEPS))
        print(f"{'ns a column with a flow, and sub-step':40s}{'kernel':>8s}{'C':>8s}{'k / C':>8s}")
        compare("glass-sugar", library, first_steps(setup("glass-sugar"), STEPS))
        for times, width in FINER:
            title = f"makse, diameters / {times}, columns {width:g} cm"
            compare(title, library, first_steps(finer(times, width), STEPS))


def whole_pours() -> None:
    """Archive in memory included."""
    took = seconds(lambda: ca_model.pour(setup("glass-sugar")))
    print(f"{'glass-sugar, a whole pour':40s}{took:8.2f} s")
    for width in WIDTHS:
        took = once(lambda w=width: ca_model.pour(finer(64, w)))
        print(f"{f'makse, diameters / 64, columns {width:g} cm':40s}{took:8.2f} s", flush=True)


def main() -> None:
    in_turn_with_c()
    whole_pours()
