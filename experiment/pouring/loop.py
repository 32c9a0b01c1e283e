"""A pour under way: what both models offer, and the one loop that takes either to its end.

    for each record:  take the steps up to it, in blocks;  keep it

Between two blocks a pour can be put down and taken up again; the blocks are counted from the last
record, so that the same sums are made however often that happens.
"""

from collections.abc import Callable
from typing import Any, Protocol

import xarray as xr

from experiment.archive.layout import assemble
from experiment.arrays import Floats, Ints
from experiment.experiment import Experiment
from experiment.pouring.recorder import Recorder, edges_of_steps, record_steps
from experiment.pouring.slabs import Deposit, Slabs
from experiment.pouring.state import State

__all__ = [
    "Begin",
    "InMemory",
    "Keeper",
    "Pouring",
    "Progress",
    "Section",
    "Sliced",
    "pour_in_memory",
    "run_to_the_end",
]

Progress = Callable[[float], object]
Section = Callable[[int, int], Floats]  # its rows (z, x, species) from one bin up to another


class Sliced(Protocol):
    """An array in memory or in a file, of which parts are taken."""

    def __len__(self) -> int: ...
    def __getitem__(self, part: Any) -> Floats: ...


class Pouring(Protocol):
    """A pour under way, in either model."""

    model: str
    experiment: Experiment
    dt: float  # s, of a step
    columns: int
    whole_grains: bool  # whether all that is recorded is counted in grains
    pure_bins: bool  # whether a bin of the deposit is of one species
    block: int  # steps that take about a second at the most

    def advance(self, edges: Floats) -> None:
        """Take the steps between the times `edges` (step + 1,) [s]."""

    def record(self) -> dict[str, Floats]:
        """What there is now of every variable along `time`, but for the time itself."""

    def bury(self) -> None:
        """Hand on as a slab what nothing can dig up any more, where the model knows that."""

    def state(self) -> State:
        """All that the steps to come depend on, but for the set-up; :meth:`bury` goes before."""

    def restore(self, state: State) -> None:
        """Go on from a state. Raises LookupError or ValueError where it is not of this set-up."""

    def floor(self) -> Ints:
        """The bin (column,) in which begins what was not handed on; a drum's section has none."""

    def grid(self) -> dict[str, Floats]:
        """The archive's x (x,), z (z,) and base_height (x,) [cm], at the end of the pour."""

    def section(self, slabs: Slabs) -> Section:
        """The deposit_fraction of what lies at rest now."""

    def notes(self, height: Sliced) -> dict[str, object]:
        """The model's own attributes of the archive, of the recorded `height` (time, x) [cm]."""


Begin = Callable[[Experiment, Slabs], Pouring]


class Keeper(Protocol):
    """Where the records go, and how far the pour has got."""

    steps: int

    @property
    def records(self) -> int:
        """How many are kept."""

    def keep(self, **values: float | Floats) -> None:
        """Keep one record."""

    def pause(self, pouring: Pouring) -> None:
        """The pour may be put down here."""


class InMemory:
    """All records in arrays."""

    def __init__(self, records: int, columns: int, species: int) -> None:
        self.steps = 0
        self.recorder = Recorder(records, columns, species)

    @property
    def records(self) -> int:
        """How many are kept."""
        return self.recorder.kept

    def keep(self, **values: float | Floats) -> None:
        """Keep one record."""
        self.recorder.keep(**values)

    def pause(self, pouring: Pouring) -> None:
        """Nothing is to be done."""


def run_to_the_end(pouring: Pouring, keeper: Keeper, progress: Progress | None = None) -> None:
    """Pour on from where `keeper` says; `progress` is called with the share that is done."""
    schedule = record_steps(pouring.experiment.pour, pouring.dt)
    for step in schedule[keeper.records :]:
        for edges in edges_of_steps(keeper.steps, step, pouring.dt, pouring.block):
            pouring.advance(edges)
            keeper.steps += len(edges) - 1
            keeper.pause(pouring)
            if progress is not None:
                progress(keeper.steps / schedule[-1])
        keeper.keep(time=step * pouring.dt, **pouring.record())


def pour_in_memory(begin: Begin, experiment: Experiment, progress: Progress | None) -> xr.Dataset:
    """The archive of a whole pour as a Dataset."""
    deposit = Deposit()
    pouring = begin(experiment, deposit)
    records = len(record_steps(experiment.pour, pouring.dt))
    keeper = InMemory(records, pouring.columns, experiment.mixture.species)
    run_to_the_end(pouring, keeper, progress)
    arrays, grid = keeper.recorder.arrays, pouring.grid()
    section = pouring.section(deposit)(0, len(grid["z"]))
    told = pouring.notes(arrays["height"])
    return assemble(experiment, pouring.model, arrays | grid | {"deposit_fraction": section}, told)
