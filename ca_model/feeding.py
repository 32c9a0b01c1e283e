"""The feed of a pour in grains: what arrives in each step on each side, and where."""

import numpy as np

from ca_model.arrivals import Arrivals
from ca_model.lattice import Lattice
from experiment import Experiment
from experiment.arrays import Floats, Ints
from experiment.pouring.state import State, put_back

__all__ = ["Feeding"]


class Feeding:
    """The feed, and what has been `poured` (species,) of it so far, in grains."""

    def __init__(self, experiment: Experiment, lattice: Lattice) -> None:
        self.feed = experiment.feed
        self.lattice = lattice
        self.grain_thickness = lattice.grain_thickness
        self.below_rest = lattice.column_below_rest
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

    def take(self, edges: Floats) -> tuple[Ints, Ints]:
        """Grains (step, side, species) of the steps between `edges`, and their source (step,)."""
        rates = self.feed.mean_thickness(edges) / self.grain_thickness
        grains = np.stack([side.take(rates) for side in self.arrivals], axis=1)
        self.poured += grains.sum(axis=(0, 1))
        return grains, self._source(edges)

    def _source(self, edges: Floats) -> Ints:
        """The column that begins where the feed falls, in the middle of each step."""
        if self.feed.source is None:
            return np.full(len(edges) - 1, self.below_rest)
        return self.lattice.column_after(self.feed.source.position((edges[:-1] + edges[1:]) / 2))

    def state(self) -> State:
        """What is due and drawn so far."""
        state: State = {"poured": self.poured}
        for k, side in enumerate(self.arrivals):
            state |= {f"side_{k}_{name}": array for name, array in side.state().items()}
        return state

    def restore(self, state: State) -> None:
        """Go on from a state."""
        put_back({"poured": self.poured}, state)
        for k, side in enumerate(self.arrivals):
            side.restore({name: state[f"side_{k}_{name}"] for name in side.state()})
