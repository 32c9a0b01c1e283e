"""Which grains enter column 0 in each step: a fixed number, or a random one from a generator."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from experiment.arrays import Floats, Ints

__all__ = ["ArrivalKind", "Arrivals"]

ArrivalKind = Literal["fixed", "poisson", "drawn"]

SHARES = 2**40  # a grain is counted in so many shares, so that sums are exact
ROUND_OFF = 2**24  # shares; a grain that lacks no more than this is whole


@dataclass
class Arrivals:
    """Grains of each species, step by step, for rates (step, species) given in grains per step.

    fixed     the whole part of what was fed; what is left over is due later
    poisson   each species' number is a Poisson variate of its rate
    drawn     the total is fixed; the species of each grain is drawn in proportion to the rates
    """

    kind: ArrivalKind
    generator: np.random.Generator
    due: Ints  # (species,) shares that were fed but make no whole grain yet

    def take(self, rates: Floats) -> Ints:
        """The next grains (step, species), one row for each row of `rates`."""
        if self.kind == "poisson":
            return np.asarray(self.generator.poisson(rates), dtype=np.int64)
        shares = np.rint(rates * SHARES).astype(np.int64)
        if self.kind == "fixed":
            return self._whole(shares)
        total = self._whole(shares.sum(axis=1, keepdims=True))[:, 0]
        chance = rates / np.maximum(rates.sum(axis=1, keepdims=True), np.finfo(float).tiny)
        chance[:, -1] = np.maximum(1.0 - chance[:, :-1].sum(axis=1), 0.0)
        return np.asarray(self.generator.multinomial(total, chance), dtype=np.int64)

    def _whole(self, shares: Ints) -> Ints:
        """Whole grains of each step (step, kind) for the shares fed in it; the rest stays due."""
        whole, rest = np.divmod(shares, SHARES)
        fed = self.due[: shares.shape[1]] + np.cumsum(rest, axis=0)
        completed = (fed + ROUND_OFF) // SHARES
        self.due[: shares.shape[1]] = fed[-1] - completed[-1] * SHARES
        return np.asarray(whole + np.diff(completed, axis=0, prepend=0))
