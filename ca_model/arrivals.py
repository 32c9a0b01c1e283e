"""Which grains enter column 0 in each step: a fixed number, or a random one from a generator."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from experiment.arrays import Floats, Ints

__all__ = ["Arrivals"]

ROUND_OFF = 1e-6


@dataclass
class Arrivals:
    """Grains of each species, step by step, for rates (step, species) given in grains per step.

    fixed     the whole part of what was fed; what is left over is due later
    poisson   each species' number is a Poisson variate of its rate
    drawn     the total is fixed; the species of each grain is drawn in proportion to the rates
    """

    kind: Literal["fixed", "poisson", "drawn"]
    generator: np.random.Generator
    due: Floats  # (species,) what was fed but makes no whole grain yet

    def take(self, rates: Floats) -> Ints:
        """The next grains (step, species), one row for each row of `rates`."""
        if self.kind == "poisson":
            return np.asarray(self.generator.poisson(rates), dtype=np.int64)
        fed = self.due + np.cumsum(rates, axis=0)
        if self.kind == "fixed":
            whole: Ints = np.floor(fed + ROUND_OFF).astype(np.int64)
            self.due = fed[-1] - whole[-1]
            return np.asarray(np.diff(whole, axis=0, prepend=0))
        total = np.floor(fed.sum(axis=1) + ROUND_OFF).astype(np.int64)
        self.due = np.append(np.zeros(len(self.due) - 1), fed[-1].sum() - total[-1])
        shares = rates / np.maximum(rates.sum(axis=1, keepdims=True), np.finfo(float).tiny)
        shares[:, -1] = np.maximum(1.0 - shares[:, :-1].sum(axis=1), 0.0)
        return np.asarray(self.generator.multinomial(np.diff(total, prepend=0), shares))
