"""Which grains arrive in each step: a fixed number, or a random one from a stream of its own.

    fixed     the whole grains of what was fed since the start; what is left over is due later
    poisson   each species' number is a Poisson variate of its rate
    drawn     the total is fixed; the species of each grain is drawn in proportion to the rates

The random numbers of pile k of a seed are those of the counter-based generator Philox 4x64-10 with
the key (seed, 2 k), and of its flow to the left (seed, 2 k + 1). All that is made of them is
sums, products and comparisons, of rates that are whole shares of a grain, so that a seed gives the
same grains on any machine.
"""

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray

from experiment.arrays import Floats, Ints
from experiment.pouring.state import State, put_back

__all__ = ["ArrivalKind", "Arrivals"]

ArrivalKind = Literal["fixed", "poisson", "drawn"]

SHARES = 2**40  # a grain is counted in so many shares, so that sums are exact
ROUND_OFF = 2**24  # shares; a grain that lacks no more than this is whole
MOST_AT_ONCE = 16.0  # grains; variates of larger rates are sums of several
NEGLIGIBLE = 1e-20  # probability
MOST_WORDS = 2**22


@dataclass
class Arrivals:
    """Grains of each species, step by step, for rates (step, species) given in grains per step."""

    kind: ArrivalKind
    stream: np.random.Philox
    parts: int  # variates that a Poisson variate is the sum of
    block: int  # steps whose random numbers are in memory together
    due: Ints  # (species,) shares that were fed but make no whole grain yet

    @classmethod
    def start(
        cls, kind: ArrivalKind, largest: Floats, *, seed: int = 0, pile: int = 0, side: int = 0
    ) -> "Arrivals":
        """Before the first step; `largest` (species,) are the highest rates that will come."""
        stream = np.random.Philox(key=np.array([seed, 2 * pile + side], dtype=np.uint64))
        parts = max(1, math.ceil(float(np.max(largest)) / MOST_AT_ONCE))
        words = 1 + int(np.sum(largest)) + len(largest) * parts
        due = np.zeros(len(largest), dtype=np.int64)
        return cls(kind, stream, parts, max(1, MOST_WORDS // words), due)

    def state(self) -> State:
        """What is due, and how far the random numbers were drawn."""
        stream: Any = self.stream.state
        drawn = stream["state"]["counter"], stream["buffer"], [stream["buffer_pos"]]
        return {"due": self.due, "stream": np.concatenate(drawn).astype(np.uint64)}

    def restore(self, state: State) -> None:
        """Go on from a state."""
        put_back(self.state(), state)
        stream: Any = self.stream.state
        stream["state"]["counter"], stream["buffer"] = np.split(state["stream"][:-1], 2)
        stream["buffer_pos"] = int(state["stream"][-1])
        self.stream.state = stream

    def take(self, rates: Floats) -> Ints:
        """The next grains (step, species), one row for each row of `rates`."""
        blocks = [rates[k : k + self.block] for k in range(0, len(rates), self.block)]
        return np.concatenate([self._take(np.rint(block * SHARES)) for block in blocks])

    def _take(self, shares: Floats) -> Ints:
        whole_shares = shares.astype(np.int64)
        if self.kind == "fixed":
            return _whole(whole_shares, self.due)
        rates = shares / SHARES
        if self.kind == "poisson":
            words = self.stream.random_raw((*rates.shape, self.parts))
            return _poisson(rates / self.parts, words)
        total = _whole(whole_shares.sum(axis=1, keepdims=True), self.due)[:, 0]
        return _drawn(rates, total, self.stream.random_raw(int(total.sum())))


@njit(cache=True, nogil=True)
def _whole(shares: Ints, due: Ints) -> Ints:
    """Whole grains of each step (step, kind) for the shares fed in it; the rest stays due."""
    whole = np.empty_like(shares)
    for step in range(shares.shape[0]):
        for a in range(shares.shape[1]):
            due[a] += shares[step, a]
            whole[step, a] = (due[a] + ROUND_OFF) // SHARES
            due[a] -= whole[step, a] * SHARES
    return whole


@njit(cache=True, nogil=True)
def _drawn(rates: Floats, total: Ints, words: NDArray[np.uint64]) -> Ints:
    """Draw the species of `total` (step,) grains, each by the next of the random `words`."""
    grains = np.zeros(rates.shape, dtype=np.int64)
    drawn = 0
    for step in range(rates.shape[0]):
        fed, last = 0.0, 0
        for a in range(rates.shape[1]):
            if rates[step, a] > 0:
                fed += rates[step, a]
                last = a
        for _ in range(total[step]):
            left = _fraction(words[drawn]) * fed
            drawn += 1
            a = 0
            while a < last and left >= rates[step, a]:
                left -= rates[step, a]
                a += 1
            grains[step, a] += 1
    return grains


@njit(cache=True, nogil=True)
def _poisson(rates: Floats, words: NDArray[np.uint64]) -> Ints:
    """Poisson variates (step, species), each a sum over random `words` (step, species, part).

    By inversion: p_k = (r^k / k!) / (sum of all r^k / k!), as far as they matter.
    """
    grains = np.zeros(rates.shape, dtype=np.int64)
    for a in range(rates.shape[1]):
        rate, all_weights, most = -1.0, 1.0, 0
        for step in range(rates.shape[0]):
            if rates[step, a] != rate:
                rate = rates[step, a]
                all_weights, most = _sum_of_weights(rate)
            for word in words[step, a]:
                target = _fraction(word) * all_weights
                k, weight = 0, 1.0
                up_to_k = weight
                while up_to_k <= target and k < most:
                    k += 1
                    weight *= rate / k
                    up_to_k += weight
                grains[step, a] += k
    return grains


@njit(cache=True)
def _sum_of_weights(rate: float) -> tuple[float, int]:
    """The sum of r^k / k! and the largest k that counts."""
    k, weight, total = 0, 1.0, 1.0
    while k < rate or weight > NEGLIGIBLE * total:
        k += 1
        weight *= rate / k
        total += weight
    return total, k


@njit(inline="always")
def _fraction(word: np.uint64) -> float:
    """A random number from 0 to below 1 of 53 random bits."""
    return (word >> np.uint64(11)) * 2.0**-53
