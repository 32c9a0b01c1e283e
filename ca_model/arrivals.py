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

    fixed     as many as keep up with the rate: floor of the sum up to here, less those before
    poisson   each species' number is a Poisson variate of its rate
    drawn     the total is fixed; the species of each grain is drawn in proportion to the rates
    """

    kind: Literal["fixed", "poisson", "drawn"]
    generator: np.random.Generator
    fed: Floats  # (species,) sum of all rates so far

    def take(self, rates: Floats) -> Ints:
        """The next grains (step, species), one row for each row of `rates`."""
        before = self.fed
        fed = before + np.cumsum(rates, axis=0)
        self.fed = fed[-1]
        if self.kind == "poisson":
            return self.generator.poisson(rates)
        if self.kind == "drawn":
            total = _whole(fed.sum(axis=1), before.sum())
            shares = rates / np.maximum(rates.sum(axis=1, keepdims=True), np.finfo(float).tiny)
            return self.generator.multinomial(total, _add_up_to_one(shares))
        return np.stack([_whole(fed[:, a], before[a]) for a in range(rates.shape[1])], axis=1)


def _whole(fed: Floats, before: float) -> Ints:
    """How many whole grains each step adds to a growing sum."""
    counts = np.floor(np.concatenate([[before], fed]) + ROUND_OFF).astype(np.int64)
    return np.diff(counts)


def _add_up_to_one(shares: Floats) -> Floats:
    shares[:, -1] = np.maximum(1.0 - shares[:, :-1].sum(axis=1), 0.0)
    return shares
