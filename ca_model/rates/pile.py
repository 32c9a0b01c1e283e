"""A pile under the rate rule, by species, over the arrays of its kernel, which counts by rank.

Whatever was buried may be dug up again. Stacks grow in memory up to as many grains as the steepest
pile is high; from then on the lower half of what they hold is handed on as a slab whenever one is
full, and taken back if erosion comes near it.
"""

import math

import numpy as np

from ca_model.deposit import top_of
from ca_model.draws import RandomState
from ca_model.lattice import Ground, RateRule
from ca_model.rates.kernel import BARE, DONE, advance, composition
from ca_model.rates.state import Exchange, FlowingPile, bare_draws
from experiment.arrays import Floats, Ints
from experiment.pouring.slabs import Slab, Slabs
from experiment.pouring.state import State, arrays_of, put_back

__all__ = ["RatePile", "bare_pile", "ranked"]

FIRST_PLACES = 64


class RatePile:
    """The state of a pour. What lies deep is handed on to `slabs`, and may be taken back."""

    def __init__(
        self,
        rule: RateRule,
        ground: Ground,
        slabs: Slabs,
        random: RandomState,
        *,
        most_places: int | None = None,
    ) -> None:
        self._slabs = slabs
        self._species = rule.smallest_first  # (rank,)
        self._ranks = np.argsort(self._species)  # (species,)
        self._rule = ranked(rule)
        self._pile = bare_pile(self._rule, ground, random)
        self._draws = bare_draws(len(self._species), len(ground.height))
        self._bottom = ground.height.copy()  # (column,) u; of what is in memory
        self._most_places = np.array([most_places or _places_of_relief(rule, ground)])

    def advance(self, arrivals: Ints, source: Ints) -> None:
        """Take a step for each row of `arrivals` (step, side, species).

        The grains of a step enter to the right and left of the edge before column `source` (step,).
        """
        ranked = np.ascontiguousarray(arrivals.take(self._species, axis=2))
        while True:
            steps, why = advance(self._pile, self._rule, self._draws, ranked, source)
            ranked, source = ranked[steps:], source[steps:]
            if why == DONE:
                return
            if why == BARE:
                self._take_back()
            else:
                self._make_room()

    def _make_room(self) -> None:
        places = self._pile.stack.shape[1]
        if places < self._most_places[0] or self._pile.grains.max() <= places // 2:
            self._lengthen(2 * places)
        else:
            self._hand_on()

    def _lengthen(self, places: int) -> None:
        stack = np.zeros((len(self._pile.stack), places), dtype=np.int8)
        stack[:, : self._pile.stack.shape[1]] = self._pile.stack
        self._pile = self._pile._replace(stack=stack)

    def _hand_on(self) -> None:
        """Lay as a slab what every stack holds beyond half of its places."""
        pile, half = self._pile, self._pile.stack.shape[1] // 2
        counts = np.maximum(pile.grains - half, 0)
        slab = self._slab(self._lowest(counts), counts)
        for i, count in enumerate(counts):
            kept = pile.grains[i] - count
            pile.stack[i, :kept] = pile.stack[i, count : pile.grains[i]]
        pile.grains[:] -= counts
        pile.handed_on[:] += counts
        self._bottom = slab.top.copy()
        self._slabs.lay(slab)

    def _take_back(self) -> None:
        """Put the topmost slab back under the stacks, and keep twice as much from now on.

        For else it might be handed on and taken back by turns.
        """
        slab, pile = self._slabs.take_back(), self._pile
        counts = np.diff(slab.ends)
        places = int((pile.grains + counts).max())
        self._most_places[0] = max(self._most_places[0], 2 * self._pile.stack.shape[1])
        if places > pile.stack.shape[1]:
            self._lengthen(2 * places)
            pile = self._pile
        for i, count in enumerate(counts):
            kept = pile.grains[i]
            pile.stack[i, count : count + kept] = pile.stack[i, :kept].copy()
            pile.stack[i, :count] = self._ranks[slab.share(i)]
        pile.grains[:] += counts
        pile.handed_on[:] -= counts
        self._bottom = slab.bottom.copy()

    def flush(self) -> None:
        """Hand on nothing: whatever was laid down may be dug up again."""

    def rest(self) -> Slab:
        """What is in memory; of a surface layer, which has no order, the tallest grains first."""
        pile, layers = self._pile, self._pile.layer.sum(axis=0)
        stacks = [
            np.concatenate([stack[:count], np.repeat(np.arange(len(layer))[::-1], layer[::-1])])
            for stack, count, layer in zip(pile.stack, pile.grains, pile.layer.T, strict=True)
        ]
        return self._slab(np.concatenate(stacks), pile.grains + layers)

    def _lowest(self, counts: Ints) -> Ints:
        return np.concatenate(
            [stack[:count] for stack, count in zip(self._pile.stack, counts, strict=True)]
        )

    def _slab(self, ranks: Ints, counts: Ints) -> Slab:
        """The grains of `ranks`, column upon column, on top of what was handed on."""
        grains = self._species[ranks].astype(np.uint8)
        ends = np.concatenate([[0], np.cumsum(counts)])
        heights = np.array(self._rule.grain_height)[self._ranks]
        return Slab(self._bottom, top_of(self._bottom, ends, grains, heights), ends, grains)

    def state(self) -> State:
        """All that changes; of the stacks what they hold, and not what is left in free places."""
        held = self._lowest(self._pile.grains)
        return self._arrays() | {"stack": held, "places": np.array([self._pile.stack.shape[1]])}

    def _arrays(self) -> State:
        own = {"bottom": self._bottom, "most_places": self._most_places}
        return own | {n: a for n, a in arrays_of(self._pile).items() if n != "stack"}

    def restore(self, state: State) -> None:
        """Go on from a state. Raises ValueError where it is not of this set-up."""
        put_back(self._arrays(), state)
        pile, places = self._pile, int(state["places"][0])
        if state["stack"].shape != (pile.grains.sum(),):
            raise ValueError("its stack is not one of this set-up")
        self._pile = pile._replace(stack=np.zeros((len(pile.grains), places), dtype=np.int8))
        ends = np.cumsum(pile.grains)[:-1]
        for stack, held in zip(self._pile.stack, np.split(state["stack"], ends), strict=True):
            stack[: len(held)] = held

    @property
    def height(self) -> Ints:
        """Heights (column,) in u."""
        return self._pile.height[1:-1]

    @property
    def surface_fraction(self) -> Floats:
        """Composition (column, species) of the surface layer."""
        phi = np.empty(self._pile.layer.T.shape)
        composition(self._pile, self._rule, phi)
        return phi.take(self._ranks, axis=1)

    @property
    def rolling(self) -> Ints:
        """Rolling grains (column, species), of both sides."""
        rolling = self._pile.rolling[:, :, 1:-1].sum(axis=0)
        return np.asarray(rolling.take(self._ranks, axis=0).T)

    @property
    def outflow(self) -> Ints:
        """Grains (species,) that fell off the ends."""
        return self._pile.outflow.take(self._ranks)

    @property
    def grains_at_rest(self) -> Ints:
        """Grains (species,) in the surface layer and below."""
        return self._pile.at_rest.take(self._ranks)


def ranked(rule: RateRule) -> Exchange:
    """The rule as the kernel takes it."""
    species = [int(a) for a in rule.smallest_first]

    def in_order(matrix: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
        return tuple(tuple(matrix[a][b] for b in species) for a in species)

    law = rule.law._replace(
        repose_slope=in_order(rule.law.repose_slope),
        collision_rate=in_order(rule.law.collision_rate),
        cross_amplification=in_order(rule.law.cross_amplification),
    )
    return Exchange(
        law=law,
        grain_height=tuple(int(rule.grain_height[a]) for a in species),
        fastest=tuple(max(rates) for rates in law.collision_rate),
        rigid_fraction=tuple(rule.rigid_fraction[a] for a in species),
        contacts=rule.contacts,
        sharpness=rule.sharpness,
        amplification=rule.amplification,
        depth=rule.depth,
        tallest=int(rule.grain_height.max()),
        unit=rule.unit,
        width=rule.width,
        step=rule.step,
    )


def bare_pile(rule: Exchange, ground: Ground, random: RandomState) -> FlowingPile:
    """The ground before pouring: nothing rolls, no grain rests."""
    columns, ranks = len(ground.height), len(rule.grain_height)
    lips = (0, 0) if ground.lips is None else ground.lips
    return FlowingPile(
        wall=ground.lips is None,
        height=np.concatenate([lips[:1], ground.height, lips[1:]]).astype(np.int64),
        rolling=np.zeros((ground.sides, ranks, 1 + columns + 1), dtype=np.int64),
        layer=np.zeros((ranks, columns), dtype=np.int64),
        stack=np.zeros((columns, FIRST_PLACES), dtype=np.int8),
        grains=np.zeros(columns, dtype=np.int64),
        handed_on=np.zeros(columns, dtype=np.int64),
        at_rest=np.zeros(ranks, dtype=np.int64),
        outflow=np.zeros(ranks, dtype=np.int64),
        random=random,
    )


def _places_of_relief(rule: RateRule, ground: Ground) -> int:
    """Grains in the height of the steepest pile: what a change of the feed may dig up of it."""
    steepest = max(map(max, rule.law.repose_slope)) * rule.width / rule.unit
    return math.ceil(steepest * len(ground.height) / ground.sides / int(rule.grain_height.min()))
