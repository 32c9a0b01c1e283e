"""The toppling rule in plain Python: short, and slow, and what the kernel must agree with.

Grains are added to column 0 one by one, and the pile comes to rest after each: a slow drive. The
topmost grain of column i, of species a upon b, is at rest while

    s = h_i - h_{i+1} < s_ab + k_i,        k_i one of 0 ... spread, all alike.

While some columns are not at rest one of them, each with the same chance, topples: its topmost
grain goes to column i+1, or from the last column over the lip, and k_i and k_{i+1} are drawn anew.
Behind a wall nothing topples from the last column. Bare base never topples.

- Franks et al., Proc. R. Soc. B 286, 20190365 (2019): grains 1 and 2 high, a topples from b where
  s > 2 H_b - H_a + (2 or 3); that is s_ab = [[4, 6], [3, 5]] and spread 1. Their program visits
  the columns in shuffled sweeps, in which each topples once at most, and compares column 0 with
  the threshold from before the grains added since it last toppled. Here s_ab is always that of
  the two topmost grains.
- Oslo rice pile (Christensen et al., Phys. Rev. Lett. 77, 107 (1996)): one species, H = 1, s = 2,
  spread 1. There k_{i+1} stays as it is, which comes to the same: k decides at slope 2 only, and
  a column at rest there topples after one more grain whatever its k.
"""

from collections.abc import Sequence

from ca_model.draws import RandomState, pick
from ca_model.lattice import TopplingRule

__all__ = ["ReferenceToppling"]


class ReferenceToppling:
    """A pile: `heights`, `stacks` (lowest grain first), draws `k`, and `outflow` over the lip."""

    def __init__(
        self,
        rule: TopplingRule,
        base: Sequence[int],
        random: RandomState,
        *,
        base_species: int,
        lip: int,
    ) -> None:
        self.rule, self.random, self.base_species = rule, random, base_species
        self.heights = [*(int(h) for h in base), lip]
        self.stacks: list[list[int]] = [[] for _ in base]
        self.k = [self._draw() for _ in base]
        self.outflow: list[int] = []
        self._restless: list[int] = []

    def step(self, arrivals: Sequence[int]) -> None:
        """Add the grains of `arrivals` (species,) to column 0, in random order."""
        due = [a for a, count in enumerate(arrivals) for _ in range(count)]
        while due:
            self._lay(0, due.pop(pick(self.random, len(due))))
            self._review(0)
            while self._restless:
                self._topple(self._restless[pick(self.random, len(self._restless))])

    def is_at_rest(self, i: int) -> bool:
        """Whether the topmost grain of column i is."""
        if not self.stacks[i]:
            return True
        below, top = ([self.base_species] + self.stacks[i])[-2:]
        slope = self.heights[i] - self.heights[i + 1]
        return bool(slope < self.rule.threshold[top, below] + self.k[i])

    def _topple(self, i: int) -> None:
        a = self.stacks[i].pop()
        self.heights[i] -= int(self.rule.grain_height[a])
        self.k[i] = self._draw()
        if i + 1 == len(self.stacks):
            self.outflow.append(a)
        else:
            self._lay(i + 1, a)
            self.k[i + 1] = self._draw()
        for j in range(max(i - 1, 0), min(i + 2, len(self.stacks))):
            self._review(j)

    def _lay(self, i: int, a: int) -> None:
        self.stacks[i].append(a)
        self.heights[i] += int(self.rule.grain_height[a])

    def _draw(self) -> int:
        return pick(self.random, self.rule.spread + 1)

    def _review(self, i: int) -> None:
        """Keep the list of restless columns; the last one takes the place of one that leaves."""
        if self.is_at_rest(i) and i in self._restless:
            self._restless[self._restless.index(i)] = self._restless[-1]
            self._restless.pop()
        elif not self.is_at_rest(i) and i not in self._restless:
            self._restless.append(i)
