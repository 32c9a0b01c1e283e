"""The lattice rule in plain Python: short, and slow, and what the kernel must agree with.

A column is a stack of grains; s = h_i - h_{i+1} is its slope. In one step

1. Roll: every rolling grain moves to the next column, and the arriving grains enter column 0.
2. Touch: every column but the last lets its flow touch the pile, up to `contacts` times. The grain
   in contact is one of the smallest species present; without percolation each species present has
   its turn, smallest first. A grain of species a above a grain of species b is captured if
   s < s_ab: it tops the stack. If it is not, its species is done for this step - and with
   percolation the column is, for the smaller grains lie below the larger. h_i counts the column's
   own captures of this step; h_{i+1} is that of before the step, so all columns act at once.
3. Wall: the last column captures whatever reaches it, smallest first.
"""

from collections.abc import Sequence

from ca_model.lattice import Rule

__all__ = ["ReferencePile"]


class ReferencePile:
    """A pile on the lattice: `heights`, `stacks` (lowest grain first) and `rolling` counts."""

    def __init__(self, rule: Rule, base: Sequence[int], base_species: int) -> None:
        self.rule = rule
        self.base_species = base_species
        self.heights = [int(h) for h in base]
        self.stacks: list[list[int]] = [[] for _ in base]
        self.rolling = [[0] * len(rule.grain_height) for _ in base]

    def step(self, arrivals: Sequence[int]) -> None:
        """Roll, touch, wall; `arrivals` (species,) enter column 0."""
        self.rolling = [[int(n) for n in arrivals], *self.rolling[:-1]]
        before = list(self.heights)
        for i in range(len(before) - 1):
            self._touch(i, before[i + 1])
        for a in self.rule.smallest_first:
            while self.rolling[-1][a]:
                self._capture(len(before) - 1, a)

    def _touch(self, i: int, downhill: int) -> None:
        touching = [a for a in self.rule.smallest_first if self.rolling[i][a]]
        for _ in range(min(self.rule.contacts, sum(self.rolling[i]))):
            for a in touching[:1] if self.rule.percolation else list(touching):
                if not self._is_captured(a, i, self.heights[i] - downhill):
                    if self.rule.percolation:
                        return
                    touching.remove(a)
                    continue
                self._capture(i, a)
                if not self.rolling[i][a]:
                    touching.remove(a)

    def _is_captured(self, a: int, i: int, slope: int) -> bool:
        surface = self.stacks[i][-1] if self.stacks[i] else self.base_species
        return slope < int(self.rule.threshold[a, surface])

    def _capture(self, i: int, a: int) -> None:
        self.rolling[i][a] -= 1
        self.stacks[i].append(int(a))
        self.heights[i] += int(self.rule.grain_height[a])
