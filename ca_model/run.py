"""A pour on the lattice: set-up, schedule of records, archive in cm and s."""

from collections.abc import Callable

import numpy as np
import xarray as xr

from ca_model.arrivals import Arrivals
from ca_model.kernel import Pile, advance, grains_at_rest
from ca_model.lattice import Lattice, lattice_of
from experiment import Experiment
from experiment.archive import assemble
from experiment.arrays import Floats, Ints
from experiment.recorder import Recorder, edges_of_steps, record_steps

__all__ = ["check", "pour"]

FIRST_PLACES = 64


def check(experiment: Experiment) -> None:
    """Raise what :func:`pour` would raise, without pouring."""
    record_steps(experiment.pour, lattice_of(experiment).step)


def pour(experiment: Experiment, progress: Callable[[float], object] | None = None) -> xr.Dataset:
    """Pour `experiment` on the lattice; the archive as a Dataset, in cm and s.

    `progress` is called with the share that is done. Raises :class:`SetupError` for a wrong
    `[ca_model]` table and :class:`NotApplicableError` for what its rule does not know.
    """
    lattice = lattice_of(experiment)
    generator = np.random.Generator(np.random.PCG64(experiment.pour.seed))
    species = experiment.mixture.species
    arrivals = Arrivals(lattice.arrivals, generator, np.zeros(species, dtype=np.int64))
    pile = _still(lattice, species)
    steps = record_steps(experiment.pour, lattice.step)
    recorder = Recorder(len(steps), len(lattice.base), species)
    poured = np.zeros(species, dtype=np.int64)
    done = 0
    for record, step in enumerate(steps):
        for edges in edges_of_steps(done, step, lattice.step):
            grains = arrivals.take(experiment.feed.mean_thickness(edges) / lattice.grain_thickness)
            pile = _advance_all(pile, lattice, grains)
            poured += grains.sum(axis=0)
        done = step
        _record(recorder, record, lattice, pile, step, poured)
        if progress is not None:
            progress((record + 1) / len(steps))
    z, deposit_fraction = _deposit_fraction(pile, lattice)
    arrays = recorder.arrays | {
        "x": lattice.x,
        "z": z,
        "base_height": lattice.base * lattice.unit,
        "deposit_fraction": deposit_fraction,
    }
    return assemble(experiment, "ca_model", arrays, _notes(lattice, pile))


def _still(lattice: Lattice, species: int) -> Pile:
    """The surface before pouring: nothing rolls, no grain is at rest."""
    columns = len(lattice.base)
    return Pile(
        height=lattice.base.copy(),
        rolling=np.zeros((columns, species), dtype=np.int64),
        stack=np.zeros((columns, FIRST_PLACES), dtype=np.int8),
        grains=np.zeros(columns, dtype=np.int64),
        base_species=lattice.base_species,
    )


def _advance_all(pile: Pile, lattice: Lattice, grains: Ints) -> Pile:
    """Take all steps of `grains` (step, species), adding places to the stacks as they fill."""
    while True:
        grains = grains[advance(pile, lattice.rule, grains) :]
        if not len(grains):
            return pile
        pile = pile._replace(stack=np.concatenate([pile.stack, np.zeros_like(pile.stack)], axis=1))


def _record(
    recorder: Recorder,
    record: int,
    lattice: Lattice,
    pile: Pile,
    step: int,
    poured: Ints,
) -> None:
    topmost = pile.stack[np.arange(len(pile.grains)), pile.grains - 1]
    tops = np.where(pile.grains > 0, topmost, pile.base_species)
    recorder.keep(
        record,
        time=step * lattice.step,
        height=pile.height * lattice.unit,
        rolling_thickness=pile.rolling * lattice.grain_thickness,
        surface_fraction=np.eye(len(poured))[tops],
        poured_volume=poured * lattice.grain_volume,
        rolling_volume=pile.rolling.sum(axis=0) * lattice.grain_volume,
        deposited_volume=grains_at_rest(pile) * lattice.grain_volume,
        outflow_volume=np.zeros(len(poured)),
    )


def _deposit_fraction(pile: Pile, lattice: Lattice) -> tuple[Floats, Floats]:
    """Composition of what was poured, (z, x, species), one cell for each unit of height."""
    columns, species = pile.rolling.shape
    fraction = np.full((max(2, int(pile.height.max())), columns, species), np.nan)
    one_of = np.eye(species)
    for i in range(columns):
        grains = pile.stack[i, : pile.grains[i]]
        laid = np.repeat(one_of[grains], lattice.rule.grain_height[grains], axis=0)
        fraction[lattice.base[i] : pile.height[i], i] = laid
    return (np.arange(len(fraction)) + 0.5) * lattice.unit, fraction


def _notes(lattice: Lattice, pile: Pile) -> dict[str, object]:
    """What the lattice made of the set-up, in lattice units and in cm."""
    rule, unit = lattice.rule, lattice.unit
    notes: dict[str, object] = {
        "unit_cm": unit,
        "column_width_cm": lattice.column_width,
        "time_step_s": lattice.step,
        "grain_height": rule.grain_height,
        "effective_threshold": rule.threshold.ravel(),
        "effective_repose_slope": rule.threshold.ravel() * unit / lattice.column_width,
        "grains_per_step": lattice.grains_per_step,
    }
    outgrowth = int(pile.height[-1] - pile.height[-2])
    if outgrowth > rule.threshold.max():
        notes["comment"] = (
            f"the wall column outgrew the pile by {outgrowth * unit:.3g} cm: the feed exceeds what "
            f"the surface can capture with ca_model.contacts = {rule.contacts}"
        )
    return notes
