"""A pile of toppling grains, as a run asks for it: nothing in it ever rolls on."""

from collections.abc import Callable

import numpy as np

from ca_model.deposit import Slab
from ca_model.lattice import Ground, TopplingRule
from ca_model.toppling.kernel import (
    WALL,
    RandomState,
    TopplingPile,
    advance_toppling,
    bare_pile,
)
from experiment.arrays import Ints

__all__ = ["ToppledPile"]


class ToppledPile:
    """The state of a pour. What lies at the end is handed on as one slab, to `lay`."""

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
                stack = self._pile.stack
                self._pile = self._pile._replace(
                    stack=np.concatenate([stack, np.zeros_like(stack)], axis=1)
                )

    def flush(self) -> None:
        """Hand on what lies there, once, at the end: before that it may topple on."""
        stacks = [
            stack[:count] for stack, count in zip(self._pile.stack, self._pile.grains, strict=True)
        ]
        ends = np.concatenate([[0], np.cumsum(self._pile.grains)])
        self._lay(Slab(ends, np.concatenate(stacks).astype(np.uint8)))

    @property
    def height(self) -> Ints:
        """Heights (column,) in u."""
        return self._pile.height

    @property
    def surface(self) -> Ints:
        """Species (column,) of the topmost grains."""
        stack, count = self._pile.stack, self._pile.grains
        topmost = stack[np.arange(len(count)), count - 1]
        return np.where(count > 0, topmost, self._pile.base_species)

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
        return np.bincount(there, minlength=len(self._rule.grain_height))
