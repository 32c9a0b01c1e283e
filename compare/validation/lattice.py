"""The lattice rule: its kernels against the plain reference, its grains counted, its patterns."""

import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr

import ca_model
import continuum
from ca_model.lattice import MANY, Ground, Rule
from ca_model.pile import Pile
from ca_model.reference import ReferencePile
from compare.balances import volume_residual
from compare.kymograph import kinks
from compare.measurement import measure
from compare.validation.check import ROUND_OFF, Check, Checks, Poured
from compare.validation.layers import BALANCE
from experiment import Experiment, StoppedError, load
from experiment.archive import read
from experiment.arrays import Ints
from experiment.pouring import Begin, pour_to_file
from experiment.pouring.slabs import Deposit

__all__ = [
    "HEAP",
    "SILO",
    "LatticeSetup",
    "agrees",
    "checkpoints",
    "grains_missing",
    "kernels",
    "kernels_agree",
    "patterns",
    "poured_by_reference",
    "poured_on",
    "still_pile",
]

SILO, HEAP = 1, 2
SET_UPS = 200
PILES = 8
REFERENCE = "docs/lattice-rule.md, in plain Python (ca_model.reference)"
RULE = "Makse, Cizeau and Stanley's rule"
STOPPABLE: dict[
    str, tuple[Begin, str, tuple[str, ...]]
] = {  # model: how a pour begins, preset, settings
    "ca_model": (
        ca_model.begin,
        "lattice-stratification",
        ("pour.duration=2000.0", "ca_model.arrivals=drawn"),
    ),
    "continuum": (continuum.begin, "makse-stratification", ("pour.duration=300.0",)),
}


class LatticeSetup(NamedTuple):
    """What is poured in units of the lattice."""

    rule: Rule
    ground: Ground
    arrivals: Ints  # (step, side, species)
    source: Ints  # (step,)


def kernels(poured: Poured) -> Checks:  # noqa: ARG001
    """Grain by grain on set-ups drawn at random: any species, sizes, ground, feed and variant."""
    setups = [drawn_setup(np.random.default_rng(seed)) for seed in range(SET_UPS)]
    unlike = sum(not kernels_agree(setup) for setup in setups)
    yield Check(
        f"random set-ups of {SET_UPS} in which a kernel lays another grain",
        REFERENCE,
        0.0,
        float(unlike),
    )
    yield Check(
        f"grains lost or made in any step of {SET_UPS} random set-ups",
        "conservation of grains",
        0.0,
        float(sum(grains_missing(setup) for setup in setups)),
    )


def drawn_setup(random: np.random.Generator) -> LatticeSetup:
    """A set-up drawn at random: silos and heaps, walls and lips, sources that leap."""
    species = int(random.choice([1, 2, 2, 3, 5]))
    rule = Rule(
        grain_height=random.integers(1, 5, species),
        threshold=random.integers(0, 13, (species, species)),
        smallest_first=random.permutation(species),
        contacts=int(random.choice([1, 2, 5, MANY])),
        percolation=bool(random.integers(2)),
    )
    columns = int(random.choice([*range(2, 10), *range(60, 71)]))
    sides, steps = int(random.choice([SILO, HEAP])), int(random.integers(1, 26))
    straight = int(random.integers(7)) * np.arange(columns - 1, -1, -1)
    left, right = map(int, random.integers(-3, 10, 2))
    ground = Ground(
        height=random.integers(0, 20, columns) if random.integers(2) else straight,
        species=int(random.integers(species)),
        lips=(left, right) if random.integers(2) else None,
        sides=sides,
    )
    arrivals = random.integers(0, random.integers(2, 7), (steps, sides, species))
    leaps = random.integers(0, columns + 1, steps)
    moves = sides == HEAP and random.integers(2)
    still = np.full(steps, leaps[0] if sides == HEAP else 0)
    return LatticeSetup(rule, ground, arrivals, leaps if moves else still)


def kernels_agree(setup: LatticeSetup) -> bool:
    """Whether the kernel that the run chooses, and in a heap the other, too, lay the same."""
    reference = poured_by_reference(setup)
    deposit = Deposit()
    if not agrees(*poured_on(setup, still_pile(setup, deposit), deposit), reference):
        return False
    if setup.ground.sides == SILO:
        return True
    deposit = Deposit()
    step_by_step = Pile(setup.rule, setup.ground, deposit.lay, source=None, log=50)
    return agrees(*poured_on(setup, step_by_step, deposit), reference)


def still_pile(setup: LatticeSetup, deposit: Deposit, log: int = 50) -> Pile:
    """The pile before pouring, for the kernel that the run chooses for such a source."""
    moves = (setup.source != setup.source[0]).any()
    source = None if moves else int(setup.source[0])
    return Pile(setup.rule, setup.ground, deposit.lay, source=source, log=log)


def poured_on(setup: LatticeSetup, pile: Pile, deposit: Deposit) -> tuple[Pile, list[list[int]]]:
    """The pile after all arrivals, and its stacks."""
    pile.advance(setup.arrivals, setup.source)
    pile.flush()
    return pile, [deposit.stack(i).tolist() for i in range(len(setup.ground.height))]


def poured_by_reference(setup: LatticeSetup) -> ReferencePile:
    """The same by the reference."""
    pile = ReferencePile(setup.rule, setup.ground)
    for arrivals, source in zip(setup.arrivals, setup.source, strict=True):
        pile.step(arrivals, int(source))
    return pile


def agrees(pile: Pile, stacks: list[list[int]], reference: ReferencePile) -> bool:
    """Grain by grain: stacks, heights, what rolls, and what fell off."""
    return bool(
        stacks == reference.stacks
        and pile.height.tolist() == reference.heights
        and pile.rolling.tolist() == np.sum(reference.rolling, axis=0).tolist()
        and pile.outflow.tolist() == reference.outflow
    )


def grains_missing(setup: LatticeSetup) -> int:
    """Grains of all species by which what is there differs from what was fed, over all steps."""
    deposit = Deposit()
    pile = still_pile(setup, deposit)
    fed = np.zeros(len(setup.rule.grain_height), dtype=np.int64)
    missing = 0
    for k in range(len(setup.arrivals)):
        pile.advance(setup.arrivals[k : k + 1], setup.source[k : k + 1])
        fed += setup.arrivals[k].sum(axis=0)
        there = pile.grains_at_rest + pile.rolling.sum(axis=0) + pile.outflow
        grown = (pile.height - setup.ground.height).sum()
        missing += int(np.abs(there - fed).sum())
        missing += int(abs(grown - pile.grains_at_rest @ setup.rule.grain_height))
    pile.flush()
    counted = sum(np.bincount(slab.pieces, minlength=len(fed)) for slab in deposit)
    return missing + int(np.abs(counted - pile.grains_at_rest).sum())


def checkpoints(poured: Poured) -> Checks:  # noqa: ARG001
    """A pour that is stopped and goes on from its checkpoint on disk."""
    for model, (begin, preset, settings) in STOPPABLE.items():
        experiment = load(preset, ["pour.records=20", *settings])
        yield Check(
            f"{model}: variables that differ after a pour was stopped and went on",
            "the same pour in one go, bit for bit",
            0.0,
            float(variables_unlike(begin, experiment)),
        )


def variables_unlike(begin: Begin, experiment: Experiment) -> int:
    """How many variables of an archive depend on whether its pour was stopped half-way."""
    with tempfile.TemporaryDirectory() as folder:
        whole, parts = Path(folder, "whole.nc"), Path(folder, "parts.nc")
        pour_to_file(begin, experiment, whole)
        try:
            pour_to_file(begin, experiment, parts, stop=_half_way(experiment))
        except StoppedError:
            pour_to_file(begin, experiment, parts, resume=True)
        one, other = read(whole), read(parts)
        names = {*one.variables, *other.variables}
        return sum(
            not (name in one and name in other and one[name].identical(other[name]))
            for name in names
        )


def _half_way(experiment: Experiment) -> Callable[[], bool]:
    """What says "stop" at the pause after half the records, and ever after."""
    left: Iterator[bool] = iter([False] * (experiment.pour.records // 2))
    return lambda: next(left, True)


def patterns(poured: Poured) -> Checks:
    """The lattice stratifies and segregates, and its volume is accounted for."""
    layered = poured("ca_model", "lattice-stratification")
    parted = poured("ca_model", "lattice-segregation")
    for name, archive, sign, expected in (
        ("lattice-stratification", layered, "+1", "stratified"),
        ("lattice-segregation", parted, "-1", "segregated"),
    ):
        found = measure(archive)["regime"].item()
        yield Check(f"{name}: regime", f"{RULE}: s_22 - s_11 = {sign}", expected, str(found))
    yield Check("lattice-segregation: kinks", RULE, 0.0, float(kinks(parted).sizes["event"]))
    yield Check(
        "largest part of a species unaccounted for",
        "conservation of each species",
        0.0,
        max(map(volume_residual, (layered, parted))),
        ROUND_OFF,
        "round-off of cm; grains are counted above",
    )
    yield from mean_balance(random_piles())


def random_piles() -> list[xr.Dataset]:
    """The numbers of independent piles of lattice-stratification, thin flow, each grain drawn."""
    settings = [
        "cell.length=100.0",
        "pour.duration=11750.0",
        "pour.records=750",
        "ca_model.contacts='all'",
        "ca_model.arrivals=drawn",
    ]
    piles = [load("lattice-stratification", [*settings, f"pour.pile={k}"]) for k in range(PILES)]
    return [measure(archive) for archive in ca_model.pour_many(piles)]


def mean_balance(found: list[xr.Dataset]) -> Checks:
    """Lambda = R0 v T / L in the mean over piles, to four standard errors of the difference."""
    wavelength, expected = (
        np.array([float(one[name]) for one in found])
        for name in ("wavelength", "wavelength_of_period")
    )
    error = np.std(wavelength - expected, ddof=1) / np.sqrt(len(found))
    yield Check(
        f"lattice-stratification, mean of {len(found)} random piles: lambda = R0 v T / L",
        BALANCE,
        float(expected.mean()),
        float(wavelength.mean()),
        4 * float(error),
        "four standard errors of the difference",
        "cm",
    )
