"""What was laid down for good, in slabs that lie one upon the other.

A model keeps in memory only what grains may still be dug from. What lies deeper it hands on, as a
slab that holds a share of every column; in each column one slab begins where the one below ends.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from experiment.arrays import Ints

__all__ = ["Deposit", "Slab", "Slabs"]


class Slab(NamedTuple):
    """What each column holds between two heights; heights are counted in bins from the floor."""

    bottom: Ints  # (column,) the bin in which the column's share begins
    top: Ints  # (column,) the bin before which it ends
    ends: Ints  # (column + 1,) where each column's share of the pieces begins and ends
    pieces: NDArray[Any]  # (piece, ...) column after column, in each from below

    def share(self, i: int) -> NDArray[Any]:
        """What column i holds, from below."""
        shared: NDArray[Any] = self.pieces[self.ends[i] : self.ends[i + 1]]
        return shared

    def columns(self, first: int, last: int) -> "Slab":
        """The part of it from column `first` up to `last`."""
        ends = self.ends[first : last + 1]
        pieces = self.pieces[ends[0] : ends[-1]]
        return Slab(self.bottom[first:last], self.top[first:last], ends - ends[0], pieces)


class Slabs(Protocol):
    """Where a pour lays what it need not keep."""

    def lay(self, slab: Slab) -> None:
        """Put a slab on top."""

    def take_back(self) -> Slab:
        """Take the topmost slab off again, for it is being dug up."""

    def reaching(self, low: int, high: int) -> Iterator[Slab]:
        """The slabs, lowest first, but for such as have nothing from bin `low` up to `high`."""


class Deposit:
    """Slabs in memory."""

    def __init__(self) -> None:
        self.slabs: list[Slab] = []

    def lay(self, slab: Slab) -> None:
        """Put a slab on top."""
        self.slabs.append(slab)

    def take_back(self) -> Slab:
        """Take the topmost slab off again."""
        return self.slabs.pop()

    def reaching(self, low: int, high: int) -> Iterator[Slab]:  # noqa: ARG002
        """All slabs, lowest first."""
        return iter(self.slabs)

    def __iter__(self) -> Iterator[Slab]:
        """The slabs, lowest first."""
        return iter(self.slabs)

    def stack(self, i: int) -> NDArray[Any]:
        """All of column i, lowest first."""
        shares = [slab.share(i) for slab in self.slabs]
        return np.concatenate(shares) if shares else np.zeros(0, dtype=np.uint8)
