"""The lattice rule in plain Python: short, and slow, and what the kernel must agree with.

It is docs/lattice-rule.md as code; its steps bear the names of that page.
"""

from collections.abc import Sequence

from ca_model.lattice import Ground, Rule

__all__ = ["RIGHT", "ReferencePile", "RollingGrains"]

RIGHT, LEFT = 0, 1


class RollingGrains:
    """What rolls on columns, by whatever rule it comes to rest.

    `heights`, and counts of grains: `rolling` [side][column][species], and the `outflow` [species]
    of those that fell off the ends.
    """

    def __init__(self, ground: Ground, species: int) -> None:
        self.ground = ground
        self.heights = [int(h) for h in ground.height]
        self.columns = len(self.heights)
        self.rolling = [[[0] * species for _ in self.heights] for _ in range(ground.sides)]
        self.outflow = [0] * species

    def _roll(self) -> None:
        nothing = [0] * len(self.outflow)
        for side, flow in enumerate(self.rolling):
            leaving = flow[self._last(side)]
            self.outflow = [n + k for n, k in zip(self.outflow, leaving, strict=True)]
            moved = [nothing, *flow[:-1]] if side == RIGHT else [*flow[1:], nothing]
            self.rolling[side] = [list(counts) for counts in moved]

    def _feed(self, arrivals: Sequence[Sequence[int]], source: int) -> None:
        for side, grains in enumerate(arrivals):
            into, column = side, source if side == RIGHT else source - 1
            if column == self.columns:
                into, column = LEFT, column - 1
            elif column == -1:
                into, column = RIGHT, 0
            for a, count in enumerate(grains):
                self.rolling[into][column][a] += int(count)

    def _last(self, side: int) -> int:
        return self.columns - 1 if side == RIGHT else 0


class ReferencePile(RollingGrains):
    """A pile on the lattice, and its `stacks` (lowest grain first)."""

    def __init__(self, rule: Rule, ground: Ground) -> None:
        super().__init__(ground, len(rule.grain_height))
        self.rule = rule
        self.stacks: list[list[int]] = [[] for _ in self.heights]

    def step(self, arrivals: Sequence[Sequence[int]], source: int = 0) -> None:
        """Roll, feed, touch; `arrivals` (side, species) enter beside the edge before `source`."""
        self._roll()
        self._feed(arrivals, source)
        for side in range(self.ground.sides):
            self._touch(side)

    def _touch(self, side: int) -> None:
        before = list(self.heights)
        for i in range(self.columns):
            if i != self._last(side):
                self._touch_column(side, i, before[i + 1 if side == RIGHT else i - 1])
            elif self.ground.lips is not None:
                self._touch_column(side, i, self.ground.lips[1 if side == RIGHT else 0])
            else:
                self._fill_against_the_wall(side, i)

    def _touch_column(self, side: int, i: int, downhill: int) -> None:
        rolling = self.rolling[side][i]
        touching = [a for a in self.rule.smallest_first if rolling[a]]
        for _ in range(min(self.rule.contacts, sum(rolling))):
            for a in touching[:1] if self.rule.percolation else list(touching):
                if not self._is_captured(a, i, self.heights[i] - downhill):
                    if self.rule.percolation:
                        return
                    touching.remove(a)
                    continue
                self._capture(side, i, a)
                if not rolling[a]:
                    touching.remove(a)

    def _fill_against_the_wall(self, side: int, i: int) -> None:
        for a in self.rule.smallest_first:
            while self.rolling[side][i][a]:
                self._capture(side, i, a)

    def _is_captured(self, a: int, i: int, slope: int) -> bool:
        surface = self.stacks[i][-1] if self.stacks[i] else self.ground.species
        return slope < int(self.rule.threshold[a, surface])

    def _capture(self, side: int, i: int, a: int) -> None:
        self.rolling[side][i][a] -= 1
        self.stacks[i].append(int(a))
        self.heights[i] += int(self.rule.grain_height[a])
