"""What lies at rest below the slopes: tapes in memory, and what they hand on.

A tape grows with its pile up to as many bins as the pile is high from toe to top; from then on the
lower half of what is sealed is handed on as a slab whenever the tape is full, and taken back if
erosion comes near it. So memory holds as much however long it is poured, and nothing is lost.
"""

import numpy as np

from continuum.kernel import BARE, DONE
from continuum.section import rest_of, slab_of
from continuum.slopes import Slope, across
from continuum.tape import (
    lowest_bins,
    put_lowest_bins,
    sealed_bins,
    with_more_bins,
    with_sealed_bins,
)
from experiment.arrays import Floats, Ints
from experiment.pouring.slabs import Slab, Slabs
from experiment.pouring.state import State, arrays_of, put_back

__all__ = ["Body"]


class Body:
    """The slopes of a pile and what lies below them, down to the floor."""

    def __init__(self, slopes: list[Slope], slabs: Slabs, most_bins: int) -> None:
        self.slopes = slopes
        self._slabs = slabs
        self._most_bins = np.array([most_bins])

    def advance(self, slope: Slope, velocity: Floats, inflow: Floats) -> int:
        """Take a step per row of `inflow` (step, species) [cm]; the most sub-steps one needed."""
        most = 0
        while True:
            steps, substeps, why = slope.advance(velocity, inflow)
            inflow, most = inflow[steps:], max(most, substeps)
            if why == DONE:
                return most
            if why == BARE:
                self._take_back()
            else:
                self._make_room(slope)

    @property
    def volume(self) -> Floats:
        """Volume (species,) [cm2] of what lies still, but for the rigid surface."""
        return np.asarray(sum(slope.volume_at_rest for slope in self.slopes))

    @property
    def floor(self) -> Ints:
        """The lowest bin (column,) above the floor that is in memory; 0 in a drum."""
        if self.slopes[0].grid.turning_rate > 0.0:
            return np.zeros(len(self.slopes[0].x), dtype=np.int64)
        return across(self.slopes, lambda slope: slope.first_bin + slope.flow.buried)

    def rest(self) -> list[Slab]:
        """All that is in memory."""
        return rest_of(self.slopes)

    def _make_room(self, slope: Slope) -> None:
        bins, turns = slope.flow.tape.shape[2], slope.grid.turning_rate > 0.0
        if bins < self._most_bins[0] or turns or (slope.flow.sealed <= bins // 2).all():
            slope.flow = with_more_bins(slope.flow)
        else:
            self._hand_on()

    def _hand_on(self) -> None:
        """Lay as a slab what every tape holds beyond half of its places."""
        bottom, taken = self.floor, []
        for slope in self.slopes:
            flow, cells = slope.flow, slope.cells
            counts = np.maximum(flow.sealed - flow.tape.shape[2] // 2, 0)
            taken.append((counts[cells], lowest_bins(flow, cells, counts[cells])))
            flow.sealed[:] -= counts
            flow.buried[:] += counts
        self._slabs.lay(slab_of(bottom, *map(np.concatenate, zip(*taken, strict=True))))

    def _take_back(self) -> None:
        """Put the topmost slab back under what the tapes hold, and keep twice as much from now on.

        For else it might be handed on and taken back by turns.
        """
        slab, column = self._slabs.take_back(), 0
        longest = max(slope.flow.tape.shape[2] for slope in self.slopes)
        self._most_bins[0] = max(self._most_bins[0], 2 * longest)
        for slope in self.slopes:
            share, cells = slab.columns(column, column + len(slope.cells)), slope.cells
            counts = np.diff(share.ends)
            while (slope.flow.sealed[cells] + counts).max() >= slope.flow.tape.shape[2]:
                slope.flow = with_more_bins(slope.flow)
            slope.flow.sealed[cells] += counts
            slope.flow.buried[cells] -= counts
            put_lowest_bins(slope.flow, cells, counts, share.pieces)
            column += len(cells)

    def state(self) -> State:
        """All that changes; of the tapes, what is sealed."""
        state: State = {"most_bins": self._most_bins}
        for k, slope in enumerate(self.slopes):
            flow = arrays_of(slope.flow, f"slope_{k}_")
            flow[f"slope_{k}_tape"] = sealed_bins(slope.flow)
            state |= flow | {f"slope_{k}_bins": np.array([slope.flow.tape.shape[2]])}
        return state

    def restore(self, state: State) -> None:
        """Go on from a state."""
        put_back({"most_bins": self._most_bins}, state)
        for k, slope in enumerate(self.slopes):
            tape = f"slope_{k}_tape"
            arrays = arrays_of(slope.flow, f"slope_{k}_")
            put_back({name: array for name, array in arrays.items() if name != tape}, state)
            bins = int(state[f"slope_{k}_bins"][0])
            slope.flow = with_sealed_bins(slope.flow, bins, state[tape])
