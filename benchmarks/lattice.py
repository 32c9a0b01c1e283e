"""The lattice's kernel beside the same rule in C, and beside what a step must cost at least.

lattice.c follows the packets of grains that roll together, one after the other; it looks for the
next column that captures among bits, and so pays for captures, not for columns. What it must do
for a capture is a bit found, a slope and two thresholds compared, twice (the column and its uphill
neighbour), and four bytes of log written. The floor is the chain that no machine can shorten: the
next packet meets what this one left. On this rule's bit sets that is a vector addition and a
comparison, and the way of their bits from vector to scalar registers and back, measured here.

Everything is checked before it is timed: C against the reference, grain by grain, on small piles
of one to eight species, and against the kernel on the piles that are timed.
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
from ca_model.kernel import Pile, advance
from numpy.typing import NDArray

from benchmarks.clock import once, seconds_in_turn
from ca_model.lattice import MANY, Rule
from ca_model.reference import ReferencePile
from experiment.arrays import Ints

SOURCE = Path(__file__).with_name("lattice.c")
GCC = ["gcc", "-O3", "-march=native", "-shared", "-fPIC"]
HEIGHTS = np.array([1, 2])
THRESHOLD = np.array([[4, 8], [1, 5]])
GRAINS = (2, 1)  # a step, small and large
WARM_UP = 300  # steps a column: about a hundred layers
STEPS = {200: 200_000, 1000: 200_000, 10_000: 200_000, 100_000: 1_000_000}
KERNEL_COLUMN_STEPS = 20_000_000
ENSEMBLE = 64
ENSEMBLE_STEPS = {200: 40_000, 1000: 40_000, 10_000: 40_000}
CHUNK = 500_000
ROUNDS = 5


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


def stacked(library: ctypes.CDLL, pour: Pour, stacks: Pile) -> None:
    """Take the steps of `pour` in C and put its grains on `stacks`."""
    logged = in_c(library, pour)
    arrays = (pour.log, stacks.stack, stacks.grains)
    log, stack, grains = (ctypes.c_void_p(array.ctypes.data) for array in arrays)
    places = ctypes.c_int64(stacks.stack.shape[1])
    if library.split(log, ctypes.c_int64(logged), places, stack, grains):
        raise RuntimeError("a stack has too few places")


def kernel_pile(pour: Pour, places: int) -> Pile:
    """The same pile for the kernel; what is on top before pouring is each stack's first grain."""
    stack = np.zeros((len(pour.height), places), dtype=np.int8)
    stack[:, 0] = pour.top
    grains = np.ones(len(pour.height), dtype=np.int64)
    return Pile(pour.height.copy(), pour.rolling.copy(), stack, grains, base_species=0)


def in_numba(pour: Pour, pile: Pile, steps: int) -> None:
    taken = advance(pile, pour.rule, pour.arrivals[:steps])
    if taken != min(steps, len(pour.arrivals)):
        raise RuntimeError(f"the kernel took {taken} of {steps} steps")


def most_on_a_stack(library: ctypes.CDLL, pour: Pour) -> int:
    """The places that `pour` needs: its largest stack, and what may reach it in a step."""
    pour = fed(pour, pour.arrivals)
    columns = pour.log[: in_c(library, pour)] >> 3
    return int(np.bincount(columns).max() + pour.arrivals.sum(axis=1).max() * 2 + 64)


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
    reference = ReferencePile(rule, base, base_species=0)
    stacks: list[list[int]] = [[] for _ in base]
    for most in (20, 2, 2):  # grains a step, at times more than the surface captures
        steps = int(random.integers(1, 2 * columns))
        pour = fed(pour, random.poisson(random.uniform(0, most), (steps, species)))
        for grain in pour.log[: in_c(library, pour)]:
            stacks[grain >> 3].append(int(grain & 7))
        for arriving in pour.arrivals:
            reference.step(arriving)
        state = (pour.height.tolist(), pour.rolling.tolist(), stacks)
        if state != (reference.heights, reference.rolling, reference.stacks):
            return False
    return True


def agrees_with_kernel(library: ctypes.CDLL, pour: Pour, steps: int) -> bool:
    ours = fed(pour, pour.arrivals[:steps])
    places = most_on_a_stack(library, ours)
    theirs, stacks = kernel_pile(ours, places), kernel_pile(ours, places)
    in_numba(ours, theirs, steps)
    stacked(library, ours, stacks)
    return all(
        np.array_equal(a, b)
        for a, b in (
            (ours.height, theirs.height),
            (ours.rolling, theirs.rolling),
            (stacks.stack, theirs.stack),
            (stacks.grains, theirs.grains),
        )
    )


def each(pours: Sequence[Pour], action: Callable[[int], object], threads: int) -> None:
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(action, range(len(pours))))


def compare(title: str, pours: Sequence[Pour], library: ctypes.CDLL, threads: int = 1) -> None:
    """Time C and the kernel in turn on copies of `pours`; the latter takes fewer steps."""
    columns, steps = len(pours[0].height), len(pours[0].arrivals)
    fewer = min(steps, max(1, KERNEL_COLUMN_STEPS // columns // len(pours)))
    places = max(most_on_a_stack(library, pour) for pour in pours)

    def prepare() -> tuple[list[Pour], list[Pile]]:
        copies = [fed(pour, pour.arrivals) for pour in pours]
        return copies, [kernel_pile(pour, places) for pour in copies]

    def in_all(action: Callable[[Pour, Pile], object]) -> Callable[..., object]:
        return lambda on: each(pours, lambda n: action(on[0][n], on[1][n]), threads)

    actions = {
        "kernel": in_all(lambda pour, pile: in_numba(pour, pile, fewer)),
        "C": in_all(lambda pour, _: in_c(library, pour)),
        "split": in_all(lambda pour, pile: stacked(library, pour, pile)),
    }
    took = seconds_in_turn(prepare, actions, ROUNDS)
    updates = {name: len(pours) * columns * steps for name in actions}
    updates["kernel"] = len(pours) * columns * fewer
    ns = {name: time / updates[name] * 1e9 for name, time in took.items()}
    print(
        f"{title:44s} {ns['kernel']:8.3f} {ns['C']:9.5f} {ns['split']:9.5f} "
        f"{ns['C'] * columns:9.1f} {ns['kernel'] / ns['C']:8.0f}"
    )


def floor(library: ctypes.CDLL) -> float:
    """Nanoseconds of the chain from one packet to the next."""
    links = 1_000_000
    return min(once(lambda: library.chain(ctypes.c_int64(links))) for _ in range(10)) / links * 1e9


def main() -> None:
    if shutil.which("gcc") is None or "avx512_vbmi" not in Path("/proc/cpuinfo").read_text():
        print("gcc or AVX-512 (VBMI) is missing: the kernel is not compared with C")
        return
    with tempfile.TemporaryDirectory() as folder:
        library = compiled(folder)
        wrong = [seed for seed in range(96) if not agrees_with_reference(library, seed)]
        print(f"C differs from the reference on {len(wrong)} of 96 small piles {wrong or ''}")
        print(f"floor: the chain from packet to packet takes {floor(library):.1f} ns a step")
        print(
            f"{'ns a column-step':44s} {'kernel':>8s} {'C':>9s} {'and split':>9s} "
            f"{'C, a step':>9s} {'k / C':>8s}"
        )
        feeds = {"fixed": fixed, "drawn": drawn(np.random.default_rng(0))}
        for kind, feed in feeds.items():
            for contacts in (1, MANY):
                touches = "all contacts" if contacts == MANY else f"{contacts} contact"
                for columns, steps in STEPS.items():
                    pour = stratified(library, columns, contacts, feed)
                    pour = pour._replace(arrivals=feed(steps))
                    title = f"{columns} columns, {touches}, {kind}"
                    if not agrees_with_kernel(library, pour, KERNEL_COLUMN_STEPS // columns):
                        print(f"{title}: C differs from the kernel")
                    compare(title, [pour], library)
        for columns, steps in ENSEMBLE_STEPS.items():
            feeds = [drawn(np.random.default_rng(seed)) for seed in range(ENSEMBLE)]
            pours = [stratified(library, columns, 1, feed) for feed in feeds]
            pours = [p._replace(arrivals=f(steps)) for p, f in zip(pours, feeds, strict=True)]
            for threads in (1, 2):
                title = f"{ENSEMBLE} piles, {columns} columns, {threads} thread"
                compare(title + "s" * (threads > 1), pours, library, threads)
