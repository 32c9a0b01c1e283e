"""What `make run` costs: starting up, pouring each preset warm, and a lattice step's unit cost."""

import subprocess
import sys
from functools import partial

import ca_model
import continuum
from benchmarks.clock import seconds
from ca_model.lattice import lattice_of
from ca_model.reference import ReferencePile
from experiment import load

PRESETS = ("makse-stratification", "makse-segregation", "glass-sugar", "lattice-stratification")


def start_up() -> None:
    for packages in ("numpy", "ca_model, continuum, compare"):
        command = [sys.executable, "-c", f"import {packages}"]
        took = seconds(partial(subprocess.run, command, check=True))
        print(f"import {packages:30s} {took:6.2f} s")


def pours() -> None:
    total = 0.0
    for preset in PRESETS:
        experiment = load(preset)
        for model in (ca_model, continuum):
            if model is continuum and experiment.mixture.collision_rate is None:
                continue
            took = seconds(partial(model.pour, experiment))
            total += took
            print(f"{preset:24s} {model.__name__:10s} {took:6.2f} s")
    print(f"{'all pours on one core':35s} {total:6.2f} s")


def unit_costs() -> None:
    experiment = load("lattice-stratification", ["pour.records=1"])
    lattice = lattice_of(experiment)
    columns, steps = lattice.columns, round(experiment.pour.duration / lattice.step)
    kernel = seconds(lambda: ca_model.pour(experiment)) / (columns * steps)
    few = 300
    pile = ReferencePile(lattice.rule, lattice.ground)

    def reference() -> None:
        for _ in range(few):
            pile.step([[2, 1]])

    plain = seconds(reference, repeats=1) / (columns * few)
    print(f"lattice kernel        {kernel * 1e9:8.2f} ns a column and step")
    print(f"  plain Python costs  {plain / kernel:8.0f} times as much")


def main() -> None:
    start_up()
    pours()
    unit_costs()
