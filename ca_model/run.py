"""A pour on the lattice: set-up, schedule of records, archive in cm and s."""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import xarray as xr

from ca_model.arrivals import Arrivals
from ca_model.deposit import Deposit, Slab, section
from ca_model.lattice import Lattice, TopplingRule, lattice_of
from ca_model.notes import notes
from ca_model.pile import LOG, Pile
from ca_model.toppling.kernel import random_state
from ca_model.toppling.pile import ToppledPile
from experiment import Experiment, SetupError
from experiment.archive import assemble
from experiment.arrays import Floats, Ints
from experiment.recorder import Recorder, edges_of_steps, record_steps

__all__ = ["bare_pile", "check", "pour", "pour_many", "recorded"]

MOST_VALUES = 3e8


def check(experiment: Experiment) -> None:
    """Raise what :func:`pour` would raise, without pouring."""
    _checked_lattice_of(experiment)


def pour(experiment: Experiment, progress: Callable[[float], object] | None = None) -> xr.Dataset:
    """Pour `experiment` on the lattice; the archive as a Dataset, in cm and s.

    `progress` is called with the share that is done. Raises :class:`SetupError` for a wrong
    `[ca_model]` table and :class:`NotApplicableError` for what its rule does not know.
    """
    lattice = _checked_lattice_of(experiment)
    deposit = Deposit()
    pile = bare_pile(experiment, lattice, deposit.lay)
    arrays = recorded(experiment, lattice, pile, progress)
    cells = max(2, int(pile.height.max()))
    grain_height, ground = lattice.rule.grain_height, lattice.ground
    arrays |= {
        "z": (np.arange(cells) + 0.5) * lattice.unit,
        "deposit_fraction": section(
            deposit, grain_height, ground, (cells, lattice.columns), units=1, wide=1
        ),
    }
    told = notes(experiment.mixture, lattice, arrays["height"])
    return assemble(experiment, "ca_model", arrays, told)


def _checked_lattice_of(experiment: Experiment) -> Lattice:
    """The lattice, where its steps can be waited for and its deposit fits into memory on a grid."""
    lattice = lattice_of(experiment)
    record_steps(experiment.pour, lattice.step)
    height = lattice.ground.height.max() + experiment.mean_growth / lattice.unit
    values = height * lattice.columns * experiment.mixture.species
    if values > MOST_VALUES:
        raise SetupError(
            f"ca_model.unit = {lattice.unit:g}: a deposit {height:.2g} units high makes a grid of "
            f"{values:.2g} values; at most {MOST_VALUES:.0e} are allowed (pour_to_disk needs none)"
        )
    return lattice


def bare_pile(
    experiment: Experiment, lattice: Lattice, lay: Callable[[Slab], object], log: int = LOG
) -> Pile | ToppledPile:
    """The pile before pouring, of the rule and below the source that the set-up asks for."""
    rule, ground, source = lattice.rule, lattice.ground, experiment.feed.source
    if isinstance(rule, TopplingRule):
        random = random_state(experiment.pour.seed, experiment.pour.pile)
        return ToppledPile(rule, ground, lay, random)
    at_rest = lattice.column_below_rest if source is None else None
    return Pile(rule, ground, lay, source=at_rest, log=log)


def recorded(
    experiment: Experiment,
    lattice: Lattice,
    pile: Pile | ToppledPile,
    progress: Callable[[float], object] | None,
) -> dict[str, Floats]:
    """Pour onto `pile`; what an archive tells of it but for the deposit, which the pile lays."""
    steps = record_steps(experiment.pour, lattice.step)
    recorder = Recorder(len(steps), lattice.columns, experiment.mixture.species)
    feeding = Feeding(experiment, lattice)
    for record, step in enumerate(steps):
        for arrivals, source in feeding.until(step):
            pile.advance(arrivals, source)
        _record(recorder, record, lattice, pile, feeding)
        if progress is not None:
            progress((record + 1) / len(steps))
    pile.flush()
    return recorder.arrays | {
        "x": lattice.x,
        "base_height": lattice.ground.height * lattice.unit,
    }


class Feeding:
    """The feed of a pour in grains, and what has been `poured` (species,) of it so far."""

    def __init__(self, experiment: Experiment, lattice: Lattice) -> None:
        self.feed = experiment.feed
        self.lattice = lattice
        self.steps = 0
        self.poured = np.zeros(experiment.mixture.species, dtype=np.int64)
        largest = self.feed.largest_inflow / lattice.grain_thickness
        self.arrivals = [
            Arrivals.start(
                lattice.arrivals,
                largest,
                seed=experiment.pour.seed,
                pile=experiment.pour.pile,
                side=side,
            )
            for side in range(lattice.ground.sides)
        ]

    def until(self, step: int) -> Iterator[tuple[Ints, Ints]]:
        """Grains (step, side, species) of the steps up to `step`, and their source (step,)."""
        for edges in edges_of_steps(self.steps, step, self.lattice.step):
            rates = self.feed.mean_thickness(edges) / self.lattice.grain_thickness
            grains = np.stack([side.take(rates) for side in self.arrivals], axis=1)
            self.poured += [grains[..., a].sum() for a in range(self.poured.size)]
            yield grains, self._source(edges)
        self.steps = step

    def _source(self, edges: Floats) -> Ints:
        """The column that begins where the feed falls, in the middle of each step."""
        if self.feed.source is None:
            return np.full(len(edges) - 1, self.lattice.column_below_rest)
        return self.lattice.column_after(self.feed.source.position((edges[:-1] + edges[1:]) / 2))


def _record(
    recorder: Recorder, record: int, lattice: Lattice, pile: Pile | ToppledPile, feeding: Feeding
) -> None:
    rolling = pile.rolling
    recorder.keep(
        record,
        time=feeding.steps * lattice.step,
        height=pile.height * lattice.unit,
        rolling_thickness=rolling * lattice.grain_thickness,
        surface_fraction=np.eye(rolling.shape[1])[pile.surface],
        poured_volume=feeding.poured * lattice.grain_volume,
        rolling_volume=rolling.sum(axis=0) * lattice.grain_volume,
        deposited_volume=pile.grains_at_rest * lattice.grain_volume,
        outflow_volume=pile.outflow * lattice.grain_volume,
    )


def pour_many(experiments: Sequence[Experiment], threads: int | None = None) -> list[xr.Dataset]:
    """Pour several set-ups on as many `threads` as given, by default one a core.

    The archives come in the order of the set-ups, and are what each pour alone gives. Raises what
    :func:`pour` raises.
    """
    with ThreadPoolExecutor(threads or os.cpu_count()) as pool:
        return list(pool.map(pour, experiments))
