"""A pour on the lattice: set-up, schedule of records, archive in cm and s."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import chain

import numpy as np
import xarray as xr

from ca_model.deposit import Raster, section
from ca_model.draws import random_state
from ca_model.feeding import Feeding
from ca_model.lattice import Lattice, RateRule, TopplingRule, lattice_of
from ca_model.notes import notes
from ca_model.pile import LOG, Pile
from ca_model.rates.pile import RatePile
from ca_model.toppling.pile import ToppledPile
from experiment import Experiment, SetupError
from experiment.arrays import Floats, Ints
from experiment.pouring import Section, Sliced, pour_in_memory
from experiment.pouring.recorder import record_steps
from experiment.pouring.slabs import Slabs
from experiment.pouring.state import State

__all__ = ["LatticePouring", "begin", "check", "pour", "pour_many"]

MOST_VALUES = 3e8
BLOCK = 65_536  # steps
GRAINS_AT_ONCE = 2**22


def check(experiment: Experiment) -> None:
    """Raise what :func:`pour` would raise, without pouring."""
    lattice = lattice_of(experiment)
    record_steps(experiment.pour, lattice.step)
    height = lattice.ground.height.max() + experiment.mean_growth / lattice.unit
    values = height / lattice.row * lattice.columns * experiment.mixture.species
    if values > MOST_VALUES:
        raise SetupError(
            f"ca_model.unit = {lattice.unit:g}: a deposit {height:.2g} units high makes a grid of "
            f"{values:.2g} values; at most {MOST_VALUES:.0e} are allowed (pour_to_disk needs none)"
        )


def pour(experiment: Experiment, progress: Callable[[float], object] | None = None) -> xr.Dataset:
    """Pour `experiment` on the lattice; the archive as a Dataset, in cm and s.

    `progress` is called with the share that is done. Raises :class:`SetupError` for a wrong
    `[ca_model]` table and :class:`NotApplicableError` for what its rule does not know.
    """
    check(experiment)
    return pour_in_memory(begin, experiment, progress)


def begin(
    experiment: Experiment, slabs: Slabs, log: int = LOG, most_places: int | None = None
) -> "LatticePouring":
    """The pour before its first step; what comes to rest goes to `slabs`, `log` grains at a time.

    By the rate rule it goes there when a stack has more than `most_places` grains, by default as
    many as the steepest pile is high. Raises :class:`SetupError` and :class:`NotApplicableError`,
    as :func:`pour`.
    """
    return LatticePouring(experiment, slabs, log, most_places)


class LatticePouring:
    """A pour under way, as :class:`experiment.pouring.Pouring` tells."""

    model = "ca_model"
    whole_grains = True

    def __init__(
        self, experiment: Experiment, slabs: Slabs, log: int, most_places: int | None
    ) -> None:
        lattice = lattice_of(experiment)
        self.experiment, self.lattice = experiment, lattice
        self.dt, self.columns = lattice.step, lattice.columns
        self.block = max(1, min(BLOCK, int(GRAINS_AT_ONCE / (1 + lattice.grains_per_step.sum()))))
        self.feeding = Feeding(experiment, lattice)
        self.grain_thickness, self.grain_volume = lattice.grain_thickness, lattice.grain_volume
        self.pile = _bare_pile(experiment, lattice, slabs, log, most_places)
        self.pure_bins = lattice.row == 1

    def advance(self, edges: Floats) -> None:
        """Take the steps between the times `edges` (step + 1,) [s]."""
        self.pile.advance(*self.feeding.take(edges))

    def record(self) -> dict[str, Floats]:
        """What there is now, in cm."""
        pile, volume = self.pile, self.grain_volume
        rolling = pile.rolling
        return {
            "height": pile.height * self.lattice.unit,
            "rolling_thickness": rolling * self.grain_thickness,
            "surface_fraction": pile.surface_fraction,
            "poured_volume": self.feeding.poured * volume,
            "rolling_volume": rolling.sum(axis=0) * volume,
            "deposited_volume": pile.grains_at_rest * volume,
            "outflow_volume": pile.outflow * volume,
        }

    def bury(self) -> None:
        """Hand on what came to rest for good."""
        self.pile.flush()

    def floor(self) -> Ints:
        """The row (column,) from which on all was not handed on."""
        bottom, row = self.pile.rest().bottom, self.lattice.row
        handed_on = bottom > self.lattice.ground.height
        return np.where(handed_on, -(-bottom // row), bottom // row)

    def state(self) -> State:
        """All that the steps to come depend on."""
        return self.feeding.state() | self.pile.state()

    def restore(self, state: State) -> None:
        """Go on from a state. Raises LookupError or ValueError where it is not of this set-up."""
        self.feeding.restore(state)
        self.pile.restore(state)

    def grid(self) -> dict[str, Floats]:
        """x, z and the surface before pouring [cm]."""
        lattice = self.lattice
        rows = max(2, -(-int(self.pile.height.max()) // lattice.row))
        return {
            "x": lattice.x,
            "z": (np.arange(rows) + 0.5) * (lattice.row * lattice.unit),
            "base_height": lattice.ground.height * lattice.unit,
        }

    def section(self, slabs: Slabs) -> Section:
        """The deposit_fraction, by rows."""
        rest, units = self.pile.rest(), self.lattice.row
        grain_height = self.lattice.rule.grain_height

        def rows(low: int, high: int) -> Floats:
            whole = chain(slabs.reaching(low * units, high * units), [rest])
            return section(whole, grain_height, Raster(high - low, self.columns, low, units))

        return rows

    def notes(self, height: Sliced) -> dict[str, object]:
        """Attributes of the archive, of the recorded `height` (time, x) [cm]."""
        return notes(self.experiment.mixture, self.lattice, height)


def _bare_pile(
    experiment: Experiment, lattice: Lattice, slabs: Slabs, log: int, most_places: int | None
) -> Pile | RatePile | ToppledPile:
    """The pile before pouring, of the rule and below the source that the set-up asks for."""
    rule, ground, source = lattice.rule, lattice.ground, experiment.feed.source
    random = random_state(experiment.pour.seed, experiment.pour.pile)
    if isinstance(rule, RateRule):
        return RatePile(rule, ground, slabs, random, most_places=most_places)
    if isinstance(rule, TopplingRule):
        return ToppledPile(rule, ground, slabs.lay, random)
    at_rest = lattice.column_below_rest if source is None else None
    return Pile(rule, ground, slabs.lay, source=at_rest, log=log)


def pour_many(experiments: Sequence[Experiment], threads: int | None = None) -> list[xr.Dataset]:
    """Pour several set-ups on as many `threads` as given, by default one a core.

    The archives come in the order of the set-ups, and are what each pour alone gives. Raises what
    :func:`pour` raises.
    """
    with ThreadPoolExecutor(threads or os.cpu_count()) as pool:
        return list(pool.map(pour, experiments))
