"""A pile of toppling grains, as a run asks for it: nothing in it ever rolls on.

What lies deep enough will never topple. A column sheds a grain only while it stands s >= min s_ab
above the next one, so no column ever falls below

    low_i = min(h_i, low_{i+1} + min s_ab - max H_a),    low = h at a wall, or the lip

and as columns by a wall only grow, what lies below that now is at rest for good.
"""

from collections.abc import Callable

import numpy as np

from ca_model.deposit import pure, top_of
from ca_model.draws import RandomState
from ca_model.lattice import Ground, TopplingRule
from ca_model.toppling.kernel import (
    WALL,
    TopplingPile,
    advance_toppling,
    bare_pile,
)
from experiment.arrays import Floats, Ints
from experiment.pouring.slabs import Slab
from experiment.pouring.state import State, arrays_of, put_back

__all__ = ["ToppledPile"]

KEPT = 2  # grains of a column that stay above what is buried: the topmost and what it lies on


class ToppledPile:
    """The state of a pour. What will never topple is handed on in slabs, to `lay`."""

    def __init__(
        self,
        rule: TopplingRule,
        ground: Ground,
        lay: Callable[[Slab], object],
        random: RandomState,
    ) -> None:
        self._rule = rule
        self._lay = lay
        self._random = random
        self._buried = np.zeros(len(rule.grain_height), dtype=np.int64)  # grains (species,)
        self._pile: TopplingPile = bare_pile(
            rule,
            ground.height,
            random,
            base_species=ground.species,
            lip=WALL if ground.lips is None else ground.lips[1],
        )

    def advance(self, arrivals: Ints, source: Ints) -> None:  # noqa: ARG002
        """Take a step for each row of `arrivals` (step, side, species); there is one side."""
        due = arrivals[:, 0].copy()
        while len(due):
            due = due[advance_toppling(self._pile, self._rule, due, self._random) :]
            if len(due):
                self._make_room()

    def _make_room(self) -> None:
        """Bury what can be; where that is no more than half of the highest stack, stacks grow."""
        stack, highest = self._pile.stack, self._pile.grains.max()
        self.flush()
        if 2 * self._pile.grains.max() >= highest:
            self._pile = self._pile._replace(
                stack=np.concatenate([self._pile.stack, np.zeros_like(stack)], axis=1)
            )

    def flush(self) -> None:
        """Hand on as a slab what will never topple."""
        pile = self._pile
        deep = np.array([self._buriable(i, low) for i, low in enumerate(self._lowest())])
        slab = self._slab(deep)
        if not len(slab.pieces):
            return
        self._lay(slab)
        self._buried += np.bincount(slab.pieces, minlength=len(self._buried))
        for i, count in enumerate(deep):
            pile.base[i] += self._rule.grain_height[pile.stack[i, :count]].sum()
            pile.stack[i, : pile.grains[i] - count] = pile.stack[i, count : pile.grains[i]]
            pile.grains[i] -= count

    def _lowest(self) -> Ints:
        """Heights (column,) in u that no column will ever fall below."""
        height = self._pile.height
        drop = int(self._rule.threshold.min() - self._rule.grain_height.max())
        lowest = np.empty_like(height)
        below = self._pile.lip if self._pile.lip != WALL else int(height[-1]) - drop
        for i in range(len(height) - 1, -1, -1):
            below = lowest[i] = min(int(height[i]), below + drop)
        return lowest

    def _buriable(self, i: int, lowest: int) -> int:
        """How many grains of column i lie below `lowest`, but for a few."""
        count = int(self._pile.grains[i])
        tops = self._pile.base[i] + np.cumsum(self._rule.grain_height[self._pile.stack[i, :count]])
        return max(0, min(int(np.searchsorted(tops, lowest, side="right")), count) - KEPT)

    def rest(self) -> Slab:
        """What lies on top of what was buried."""
        return self._slab(self._pile.grains)

    def _slab(self, counts: Ints) -> Slab:
        """The lowest `counts` (column,) grains of the stacks."""
        stacks = [stack[:count] for stack, count in zip(self._pile.stack, counts, strict=True)]
        grains = np.concatenate(stacks).astype(np.uint8)
        bottom, ends = self._pile.base.copy(), np.concatenate([[0], np.cumsum(counts)])
        return Slab(bottom, top_of(bottom, ends, grains, self._rule.grain_height), ends, grains)

    def state(self) -> State:
        """All that changes; of the stacks what they hold, and not what is left in free places."""
        count = self._pile.grains[:, None]
        places = np.arange(max(1, int(count.max())))
        stack = np.where(places < count, self._pile.stack[:, : len(places)], np.int8(0))
        return self._arrays() | {"stack": stack}

    def _arrays(self) -> State:
        return {"random": self._random, "buried": self._buried, **arrays_of(self._pile)}

    def restore(self, state: State) -> None:
        """Go on from a state."""
        columns = len(self._pile.stack)
        if state["stack"].ndim != 2 or state["stack"].shape[0] != columns:
            raise ValueError(f"its stack is not one of {columns} columns")
        self._pile = self._pile._replace(stack=np.zeros(state["stack"].shape, dtype=np.int8))
        put_back(self._arrays(), state)

    @property
    def height(self) -> Ints:
        """Heights (column,) in u."""
        return self._pile.height

    @property
    def surface_fraction(self) -> Floats:
        """1 (column, species) for the species of the topmost grain, else 0."""
        stack, count = self._pile.stack, self._pile.grains
        topmost = stack[np.arange(len(count)), count - 1]
        surface = np.where(count > 0, topmost, self._pile.base_species)
        return pure(surface, len(self._rule.grain_height))

    @property
    def rolling(self) -> Ints:
        """Rolling grains (column, species): none."""
        return np.zeros((len(self._pile.height), len(self._rule.grain_height)), dtype=np.int64)

    @property
    def outflow(self) -> Ints:
        """Grains (species,) that toppled over the lip."""
        return self._pile.outflow

    @property
    def grains_at_rest(self) -> Ints:
        """Grains (species,) in the stacks."""
        stack, count = self._pile.stack, self._pile.grains
        there = stack[np.arange(stack.shape[1]) < count[:, None]]
        return self._buried + np.bincount(there, minlength=len(self._rule.grain_height))
