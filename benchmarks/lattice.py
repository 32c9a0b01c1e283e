"""The lattice's kernel beside the same rule in C, a plain loop, and what a step must cost at least.

Kernel and lattice.c follow the packets of grains that roll together, one after the other, through
a window in vector registers, and pay for captures, not for columns; they take the same steps and
both write the log of their grains. The plain loop is the rule as it is written: all columns in
every step; it takes fewer steps. The floor is the chain that no machine can shorten: the next
packet meets what this one left. On bit sets that is a vector addition and a comparison, and the way
of their bits from vector to scalar registers and back, measured here.

Everything is checked before it is timed: C against the reference, grain by grain, on small piles
of one to eight species, and against kernel and plain loop on the piles that are timed.
"""

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmarks.clock import once, seconds_in_turn
from ca_model.deposit import slab_of
from ca_model.kernel.log import Log
from ca_model.kernel.packets import follow_packets
from ca_model.kernel.slope import RankedRule, Slope, mark_all
from ca_model.lattice import MANY, Ground, Rule
from ca_model.pile import ranked_rule, slope_below
from ca_model.reference import ReferencePile
from experiment.arrays import Ints

SOURCE = Path(__file__).with_name("lattice.c")
GCC = ["gcc", "-O3", "-march=native", "-shared", "-fPIC"]
HEIGHTS = np.array([1, 2])
THRESHOLD = np.array([[4, 8], [1, 5]])
GRAINS = (2, 1)  # a step, small and large
WARM_UP = 300  # steps a column: about a hundred layers
STEPS = {200: 200_000, 1000: 200_000, 10_000: 200_000, 100_000: 1_000_000}
PLAIN_COLUMN_STEPS = 20_000_000
ENSEMBLE = 16
ENSEMBLE_STEPS = {200: 400_000, 1000: 400_000, 10_000: 400_000}
CHUNK = 500_000
ROUNDS = 5
STATE = ("height", "rolling", "top")
NAMES = ("plain", "kernel", "C", "kernel, split", "C, split")


class Pour(NamedTuple):
    """What all are given; arrays are changed in place."""

    rule: Rule
    height: Ints  # (column,)
    rolling: Ints  # (column, species)
    top: Ints  # (column,) species of the surface
    arrivals: Ints  # (step, species)
    log: NDArray[np.uint32]  # column << 3 | species of each grain, in the order of capture


class Job(ctypes.Structure):
    """The structure of that name in lattice.c."""

    _fields_ = (
        *((name, ctypes.c_int64) for name in ("columns", "species", "contacts", "steps")),
        *((name, ctypes.c_void_p) for name in ("grain_height", "threshold", "smallest_first")),
        *((name, ctypes.c_void_p) for name in ("height", "rolling", "top", "arrivals", "log")),
        ("logged", ctypes.c_int64),
    )


def compiled(folder: str) -> ctypes.CDLL:
    target = f"{folder}/lattice.so"
    subprocess.run([*GCC, str(SOURCE), "-o", target], check=True)
    library = ctypes.CDLL(target)
    library.chain.restype = ctypes.c_int64
    return library


def straight(rule: Rule, columns: int) -> Pour:
    """A straight slope of 4 a column, of the first species, before pouring."""
    species = len(rule.grain_height)
    return Pour(
        rule,
        height=4 * np.arange(columns, dtype=np.int64)[::-1].copy(),
        rolling=np.zeros((columns, species), dtype=np.int64),
        top=np.zeros(columns, dtype=np.int64),
        arrivals=np.zeros((0, species), dtype=np.int64),
        log=np.zeros(0, dtype=np.uint32),
    )


def fed(pour: Pour, arrivals: Ints) -> Pour:
    """A copy of `pour` that is given `arrivals`, with room for all grains in its log."""
    grains = int(arrivals.sum() + pour.rolling.sum())
    arrays = {name: getattr(pour, name).copy() for name in ("height", "rolling", "top")}
    log = np.full(grains, 0xFFFFFFFF, dtype=np.uint32)  # written, so that its pages are there
    return pour._replace(**arrays, arrivals=np.ascontiguousarray(arrivals), log=log)


def in_c(library: ctypes.CDLL, pour: Pour) -> int:
    """Take the steps of `pour` in C; returns how many grains came to rest."""
    job = Job(len(pour.height), pour.rolling.shape[1], pour.rule.contacts, len(pour.arrivals))
    rule = [
        np.ascontiguousarray(getattr(pour.rule, name), dtype=np.int64)
        for name in ("grain_height", "threshold", "smallest_first")
    ]
    job.grain_height, job.threshold, job.smallest_first = (array.ctypes.data for array in rule)
    for name in ("height", "rolling", "top", "arrivals", "log"):
        setattr(job, name, getattr(pour, name).ctypes.data)
    if library.advance_pile(ctypes.byref(job)):
        raise MemoryError
    return int(job.logged)


def stratified(
    library: ctypes.CDLL, columns: int, contacts: int, feed: Callable[[int], Ints]
) -> Pour:
    """A pile with many layers, and its next steps."""
    rule = Rule(HEIGHTS, THRESHOLD, np.array([0, 1]), contacts, percolation=True)
    pour = straight(rule, columns)
    for _ in range(-(-WARM_UP * columns // CHUNK)):
        pour = fed(pour, feed(min(CHUNK, WARM_UP * columns)))
        in_c(library, pour)
    return pour


def fixed(steps: int) -> Ints:
    return np.tile(np.array(GRAINS, dtype=np.int64), (steps, 1))


def drawn(random: np.random.Generator) -> Callable[[int], Ints]:
    """Each grain's species is drawn."""
    share = np.array(GRAINS) / sum(GRAINS)
    return lambda steps: random.multinomial(sum(GRAINS), share, size=steps).astype(np.int64)


def agrees_with_reference(library: ctypes.CDLL, seed: int) -> bool:
    """Whether C lays every grain of a small random pile where the reference does."""
    random = np.random.default_rng(seed)
    species, columns = int(random.integers(1, 9)), int(random.integers(3, (40, 300)[seed % 2]))
    heights = random.integers(1, 5, species)
    rule = Rule(
        heights.astype(np.int64),
        random.integers(-1, 12, (species, species)) * (1, 1, 1, 9)[seed % 4],
        np.argsort(heights, kind="stable"),
        (1, int(random.integers(2, 5)), MANY)[seed % 3],
        percolation=True,
    )
    base = random.integers(0, 4) * np.arange(columns)[::-1]
    base = base + random.integers(0, random.integers(1, 12), columns)
    pour = straight(rule, columns)._replace(height=base)
    reference = ReferencePile(rule, Ground(base, species=0))
    stacks: list[list[int]] = [[] for _ in base]
    for most in (20, 2, 2):  # grains a step, at times more than the surface captures
        steps = int(random.integers(1, 2 * columns))
        pour = fed(pour, random.poisson(random.uniform(0, most), (steps, species)))
        for grain in pour.log[: in_c(library, pour)]:
            stacks[grain >> 3].append(int(grain & 7))
        for arriving in pour.arrivals:
            reference.step(arriving[np.newaxis], 0)
        rolling = np.sum(reference.rolling, axis=0).tolist()
        state = (pour.height.tolist(), pour.rolling.tolist(), stacks)
        if state != (reference.heights, rolling, reference.stacks):
            return False
    return True


class Poured(NamedTuple):
    """The same pile for the kernel."""

    slope: Slope
    rule: RankedRule
    log: Log
    arrivals: Ints


def for_kernel(pour: Pour) -> Poured:
    rule = ranked_rule(pour.rule)
    slope = slope_below(pour.rule, rule, Ground(pour.height, 0), np.arange(len(pour.height)), 1)
    slope.top[:], slope.rolling[:] = pour.top, pour.rolling
    mark_all(slope, rule)
    log = Log(pour.log.view(np.int32).copy(), np.zeros(1, dtype=np.uint64))
    return Poured(slope, rule, log, pour.arrivals.copy())


def in_kernel(pile: Poured) -> NDArray[np.int32]:
    """Take the steps in the kernel; returns its log."""
    follow_packets(*pile)
    return pile.log.grains[: int(pile.log.length[0])]


def split_by_kernel(pile: Poured) -> None:
    slab_of(in_kernel(pile), len(pile.slope.slope), np.array(pile.rule.ranks))


def split_in_c(library: ctypes.CDLL, pour: Pour, stacks: NDArray[np.int8]) -> None:
    """Take the steps in C and put the grains on `stacks` (column, grain)."""
    logged, grains = in_c(library, pour), np.zeros(len(stacks), dtype=np.int64)
    pointers = (ctypes.c_void_p(array.ctypes.data) for array in (stacks, grains))
    log, places = ctypes.c_void_p(pour.log.ctypes.data), ctypes.c_int64(stacks.shape[1])
    if library.split(log, ctypes.c_int64(logged), places, *pointers):
        raise RuntimeError("a stack has too few places")


def plainly(pour: Pour) -> int:
    """Take the steps of `pour` as the rule is written; returns how many grains came to rest."""
    return int(plain_loop(*pour.rule[:2], pour.rule.contacts, *pour[1:]))


@njit(nogil=True)
def plain_loop(grain_height, threshold, contacts, height, rolling, top, arrivals, log) -> int:
    columns, species = rolling.shape
    length = 0
    for step in range(len(arrivals)):
        for i in range(columns - 1, 0, -1):
            for a in range(species):
                rolling[i, a] = rolling[i - 1, a]
        for a in range(species):
            rolling[0, a] = arrivals[step, a]
        for i in range(columns):
            a, touches = 0, 0
            while a < species and touches < contacts:
                if rolling[i, a] == 0:
                    a += 1
                elif i == columns - 1 or height[i] - height[i + 1] < threshold[a, top[i]]:
                    rolling[i, a] -= 1
                    height[i] += grain_height[a]
                    top[i] = a
                    log[length] = i << 3 | a
                    length += 1
                    touches += i < columns - 1
                else:
                    break
    return length


def agree(library: ctypes.CDLL, pour: Pour) -> bool:
    """Whether C and kernel lay the same grains in the same order, and the plain loop as many."""
    ours = fed(pour, pour.arrivals)
    theirs = for_kernel(ours)
    few = fed(pour, pour.arrivals[: PLAIN_COLUMN_STEPS // len(pour.height)])
    plain = few._replace(**{name: getattr(few, name).copy() for name in STATE})
    grains, of_c = in_kernel(theirs), ours.log[: in_c(library, ours)]
    in_c(library, few)
    plainly(plain)
    return (
        np.array_equal(grains >> 6 << 3 | grains & 63, of_c)
        and np.array_equal(theirs.slope.rolling, ours.rolling)
        and all(np.array_equal(getattr(few, name), getattr(plain, name)) for name in STATE)
    )


def each(piles: Sequence[object], action: Callable[[int], object], threads: int) -> None:
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(action, range(len(piles))))


def times(library: ctypes.CDLL, pours: Sequence[Pour]) -> dict[str, float]:
    """Nanoseconds a step of all, in turn on copies of `pours`."""
    steps, few = len(pours[0].arrivals), max(1, PLAIN_COLUMN_STEPS // len(pours[0].height))
    few = min(steps, few // len(pours))
    most = max(
        int(np.bincount(copy.log[: in_c(library, copy)] >> 3).max())
        for copy in (fed(pour, pour.arrivals) for pour in pours)
    )

    def prepare() -> list[tuple[Pour, Pour, Poured, NDArray[np.int8]]]:
        return [
            (
                fed(pour, pour.arrivals),
                fed(pour, pour.arrivals[:few]),
                for_kernel(fed(pour, pour.arrivals)),
                np.ones((len(pour.height), most), dtype=np.int8),
            )
            for pour in pours
        ]

    actions = {
        "plain": lambda on: each(on, lambda n: plainly(on[n][1]), 1),
        "kernel": lambda on: each(on, lambda n: in_kernel(on[n][2]), 1),
        "C": lambda on: each(on, lambda n: in_c(library, on[n][0]), 1),
        "kernel, split": lambda on: each(on, lambda n: split_by_kernel(on[n][2]), 1),
        "C, split": lambda on: each(on, lambda n: split_in_c(library, on[n][0], on[n][3]), 1),
    }
    took = seconds_in_turn(prepare, actions, ROUNDS)
    return {
        name: time / len(pours) / (few if name == "plain" else steps) * 1e9
        for name, time in took.items()
    }


def show(title: str, ns: dict[str, float]) -> None:
    print(
        f"{title:36s}"
        + "".join(f"{ns[name]:14.1f}" for name in NAMES)
        + f"{ns['kernel'] / ns['C']:8.2f}{ns['plain'] / ns['kernel']:9.0f}",
        flush=True,
    )


def floor(library: ctypes.CDLL) -> float:
    """Nanoseconds of the chain from one packet to the next."""
    links = 1_000_000
    return min(once(lambda: library.chain(ctypes.c_int64(links))) for _ in range(10)) / links * 1e9


def single_piles(library: ctypes.CDLL) -> None:
    for kind, feed in {"fixed": fixed, "drawn": drawn(np.random.default_rng(0))}.items():
        for contacts in (1, MANY):
            touches = "all contacts" if contacts == MANY else f"{contacts} contact"
            for columns, steps in STEPS.items():
                pour = stratified(library, columns, contacts, feed)
                pour = pour._replace(arrivals=feed(steps))
                title = f"{columns} columns, {touches}, {kind}"
                if not agree(library, pour):
                    print(f"{title}: C, kernel and plain loop differ")
                show(title, times(library, [pour]))


def ensembles(library: ctypes.CDLL) -> None:
    """Piles that begin alike, each with its own drawn feed."""
    for columns, steps in ENSEMBLE_STEPS.items():
        pour = stratified(library, columns, 1, fixed)
        feeds = [drawn(np.random.default_rng(seed)) for seed in range(ENSEMBLE)]
        pours = [pour._replace(arrivals=feed(steps)) for feed in feeds]
        show(f"{ENSEMBLE} piles, {columns} columns", times(library, pours))
        gain = f"kernel {gain_of_kernel(pours):.2f}, C {gain_of_c(library, pours):.2f}"
        print(f"    times faster on two threads: {gain}", flush=True)


def with_room(pours: Sequence[Pour]) -> list[Pour]:
    """With logs that hold what rolls from one go to the next, too."""
    return [
        fed(pour, pour.arrivals)._replace(log=np.ones(2 * pour.arrivals.sum(), dtype=np.uint32))
        for pour in pours
    ]


def gain_of_kernel(pours: Sequence[Pour]) -> float:
    piles = [for_kernel(pour) for pour in with_room(pours)]

    def go_on(n: int) -> None:
        np.copyto(piles[n].arrivals, pours[n].arrivals)  # which the kernel uses up
        piles[n].log.length[0] = 0
        in_kernel(piles[n])

    return gain_on_two_threads(piles, go_on)


def gain_of_c(library: ctypes.CDLL, pours: Sequence[Pour]) -> float:
    piles = with_room(pours)
    return gain_on_two_threads(piles, lambda n: in_c(library, piles[n]))


def gain_on_two_threads(piles: Sequence[object], go_on: Callable[[int], object]) -> float:
    """How many times faster piles go on for a while, in memory that all have used before."""
    best = {1: float("inf"), 2: float("inf")}

    def go_on_for_a_while(n: int) -> None:
        for _ in range(ROUNDS):
            go_on(n)

    each(piles, go_on, 1)
    for _ in range(ROUNDS):
        for threads in best:
            took = once(lambda t=threads: each(piles, go_on_for_a_while, t))
            best[threads] = min(best[threads], took)
    return best[1] / best[2]


def main() -> None:
    if shutil.which("gcc") is None or "avx512_vbmi" not in Path("/proc/cpuinfo").read_text():
        print("gcc or AVX-512 (VBMI) is missing: the kernel is not compared with C")
        return
    with tempfile.TemporaryDirectory() as folder:
        library = compiled(folder)
        wrong = [seed for seed in range(96) if not agrees_with_reference(library, seed)]
        print(f"C differs from the reference on {len(wrong)} of 96 small piles {wrong or ''}")
        print(f"floor: the chain from packet to packet takes {floor(library):.1f} ns a step")
        names = "".join(f"{name:>14s}" for name in NAMES)
        print(f"{'ns a step':36s}{names}{'k / C':>8s}{'plain/k':>9s}")
        single_piles(library)
        ensembles(library)
