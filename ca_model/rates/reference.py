"""The rate rule in plain Python: short, and slow, and what the kernel must agree with.

It is the section of docs/lattice-rule.md on this rule as code; its steps bear the names there.
"""

import math
from collections.abc import Sequence

from ca_model.draws import RandomState, binomial, chance_within, pick
from ca_model.lattice import Ground, RateRule
from ca_model.rates.kernel import COURANT
from ca_model.reference import RIGHT, RollingGrains

__all__ = ["ReferenceRates"]


class ReferenceRates(RollingGrains):
    """A pile on the lattice.

    Stacks of what is `buried` (lowest first), and above each the surface `layer` [column][species],
    in grains.
    """

    def __init__(self, rule: RateRule, ground: Ground, random: RandomState) -> None:
        super().__init__(ground, len(rule.grain_height))
        self.rule, self.random = rule, random
        self.species = [int(a) for a in rule.smallest_first]
        self.grain_height = [int(height) for height in rule.grain_height]
        self.buried: list[list[int]] = [[] for _ in self.heights]
        self.layer = [[0] * len(self.species) for _ in self.heights]

    def step(self, arrivals: Sequence[Sequence[int]], source: int = 0) -> None:
        """Roll, feed, exchange; `arrivals` (side, species) enter beside the edge `source`."""
        self._roll()
        self._feed(arrivals, source)
        substeps = self._substeps()
        for k in range(substeps):
            for side in range(self.ground.sides):
                self._exchange(side, source, self.rule.step / substeps, substeps - k)

    def _substeps(self) -> int:
        rule, law = self.rule, self.rule.law
        busiest = 0.0
        for flow in self.rolling:
            for rolling in flow:
                touching, busy = self._touching(rolling), 0.0
                for a in self.species:
                    busy += max(law.collision_rate[a]) * self._thickness(touching[a], a)
                busiest = max(busiest, busy)
        climb = busiest * (1.0 + 2.0 * law.curvature_length / rule.width)
        return max(1, math.ceil(climb * rule.step / (COURANT * rule.width)))

    def _touching(self, rolling: Sequence[int]) -> list[int]:
        """The grains in contact: as many as there are contacts, smallest first."""
        touching, free = [0] * len(rolling), self.rule.contacts
        for a in self.species:
            touching[a] = min(rolling[a], free)
            free -= touching[a]
        return touching

    def _exchange(self, side: int, source: int, dt: float, left: int) -> None:
        before = list(self.heights)
        for i in range(self.columns) if side == RIGHT else reversed(range(self.columns)):
            if i == self._last(side) and self.ground.lips is None:
                self._fill_against_the_wall(side, i, left)
            elif any(self.rolling[side][i]):
                self._exchange_in_column(side, i, self._slope(side, i, source, before), dt)

    def _slope(self, side: int, i: int, source: int, before: Sequence[int]) -> float:
        """S = theta - l d2h/dx2; nothing bends where grains enter."""
        onward = 1 if side == RIGHT else -1
        edge = self.ground.lips[1 if side == RIGHT else 0] if self.ground.lips else 0
        theta = before[i] - (edge if i == self._last(side) else before[i + onward])
        if i in (self._first(side), source if side == RIGHT else source - 1):
            bend = 0
        else:
            bend = (before[i - onward] - before[i]) - theta
        curvature = self.rule.law.curvature_length / self.rule.width
        return (theta - curvature * bend) * (self.rule.unit / self.rule.width)

    def _fill_against_the_wall(self, side: int, i: int, left: int) -> None:
        for a in self.species:
            captured = self.rolling[side][i][a] // left
            self.rolling[side][i][a] -= captured
            self._lay(i, [captured if b == a else 0 for b in range(len(self.species))])

    def _exchange_in_column(self, side: int, i: int, slope: float, dt: float) -> None:
        rolling, layer = self.rolling[side][i], self.layer[i]
        phi, thickness = self.surface(i)
        theta = self._repose_slopes(phi)
        touching = self._touching(rolling)
        captured, loosened = [0] * len(rolling), [0] * len(rolling)
        for a in self.species:
            expected = self.rule.sharpness * self._capture_rate(a, theta, slope) * dt
            captured[a] = binomial(self.random, touching[a], chance_within(expected))
        for a in self.species:
            struck = self._amplification_rate(a, theta, slope, touching)
            expected = self.rule.amplification * struck * (dt / thickness)
            loosened[a] = binomial(self.random, layer[a], chance_within(expected))
        for a in self.species:
            layer[a] -= loosened[a]
            rolling[a] += loosened[a] - captured[a]
            self.heights[i] -= loosened[a] * self.grain_height[a]
        self._lay(i, captured)
        self._dig_up(i)

    def surface(self, i: int) -> tuple[list[float], float]:
        """Composition (species,) of the surface, and how thick its layer is [cm]."""
        layer, ground = self.layer[i], self.rule.rigid_fraction
        held = self._held(i)
        lacks = 0 if self.buried[i] else max(self.rule.depth - held, 0)
        phi = [
            (n * height + lacks * fraction) / (held + lacks)
            for n, height, fraction in zip(layer, self.grain_height, ground, strict=True)
        ]
        return phi, (held + lacks) * self.rule.unit

    def _repose_slopes(self, phi: Sequence[float]) -> list[float]:
        theta = [0.0] * len(phi)
        for a in self.species:
            for b in self.species:
                theta[a] += self.rule.law.repose_slope[a][b] * phi[b]
        return theta

    def _capture_rate(self, a: int, theta: Sequence[float], slope: float) -> float:
        return self.rule.law.collision_rate[a][a] * self._positive(theta[a] - slope)

    def _amplification_rate(
        self, a: int, theta: Sequence[float], slope: float, touching: Sequence[int]
    ) -> float:
        law, struck = self.rule.law, 0.0
        for b in self.species:
            push = law.collision_rate[b][a] * self._positive(slope - theta[b])
            struck += (law.cross_amplification[b][a] + push) * self._thickness(touching[b], b)
        return struck

    def _positive(self, z: float) -> float:
        width = self.rule.law.smoothing
        return max(z, 0.0) if width == 0 else 0.5 * (z + math.sqrt(z * z + width * width))

    def _thickness(self, grains: int, a: int) -> float:
        return grains * self.grain_height[a] * self.rule.unit

    def _held(self, i: int) -> int:
        return sum(n * height for n, height in zip(self.layer[i], self.grain_height, strict=True))

    def _lay(self, i: int, captured: Sequence[int]) -> None:
        """One by one, in any order; what there is no room for in the layer is buried first."""
        grains = [a for a in self.species for _ in range(captured[a])]
        while grains:
            a = grains.pop(pick(self.random, len(grains)) if len(set(grains)) > 1 else 0)
            while any(self.layer[i]) and (self._held(i) + self.grain_height[a] > self.rule.depth):
                self._bury(i)
            self.layer[i][a] += 1
            self.heights[i] += self.grain_height[a]

    def _bury(self, i: int) -> None:
        """One of the grains of the layer, whichever it is."""
        grains = [a for a in self.species for _ in range(self.layer[i][a])]
        b = grains[pick(self.random, len(grains))]
        self.layer[i][b] -= 1
        self.buried[i].append(b)

    def _dig_up(self, i: int) -> None:
        """While the layer has room for any grain, or holds none."""
        room = self.rule.depth - max(self.grain_height)
        while self.buried[i] and (not any(self.layer[i]) or self._held(i) <= room):
            self.layer[i][self.buried[i].pop()] += 1

    def _first(self, side: int) -> int:
        return 0 if side == RIGHT else self.columns - 1
