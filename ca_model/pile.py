"""A pile on the lattice, by species, over the arrays of a kernel, which counts by rank."""

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ca_model.deposit import count, pure, slab_of
from ca_model.kernel.bits import Word, word_count
from ca_model.kernel.log import Entries, Log, steps_that_fit
from ca_model.kernel.packets import follow_packets
from ca_model.kernel.slope import RankedRule, Slope, mark_all
from ca_model.kernel.steps import Heap, take_steps
from ca_model.lattice import Ground, Rule
from experiment.arrays import Floats, Ints
from experiment.pouring.slabs import Slab
from experiment.pouring.state import State, arrays_of, put_back

__all__ = ["LOG", "Pile", "ranked_rule", "slope_below"]

LOG = 2**20  # grains

Ranks = NDArray[np.int8]


class Body(Protocol):
    """What a kernel keeps of a pile, by columns and ranks."""

    @property
    def height(self) -> Ints:
        """Heights (column,) in u."""

    @property
    def top(self) -> Ranks:
        """Rank (column,) of the topmost grain."""

    @property
    def rolling(self) -> Ints:
        """Rolling grains (column, rank), of both sides."""

    @property
    def outflow(self) -> Ints:
        """Grains (rank,) that fell off the ends."""

    @property
    def arrays(self) -> State:
        """All that changes, as it is kept."""

    def advance(self, log: Log, arrivals: Ints, source: Ints) -> None:
        """Take the steps of `arrivals` (step, side, rank); the log has room for them."""


class Pile:
    """The state of a pour. What comes to rest is handed on in slabs, to `lay`.

    The source stays above the edge before column `source`, or moves where that is None.
    """

    def __init__(
        self,
        rule: Rule,
        ground: Ground,
        lay: Callable[[Slab], object],
        *,
        source: int | None = 0,
        log: int = LOG,
    ) -> None:
        self._species = rule.smallest_first  # (rank,)
        self._ranks = np.argsort(self._species)  # (species,)
        self._lay = lay
        self._counts = np.zeros(len(self._species), dtype=np.int64)  # of grains at rest, by rank
        self._counted = 0  # entries of the log that those include
        self._log = Log(np.empty(log, dtype=np.int32), np.zeros(1, dtype=np.uint64))
        self._body: Body = (
            BelowMovingSource(rule, ground) if source is None else BelowSource(rule, ground, source)
        )
        self._bottom = self.height.copy()  # (column,) of what is in the log

    def advance(self, arrivals: Ints, source: Ints) -> None:
        """Take a step for each row of `arrivals` (step, side, species).

        The grains of a step enter to the right and left of the edge before column `source` (step,).
        """
        ranked = arrivals.take(self._species, axis=2)
        while len(ranked):
            room = len(self._log.grains) - len(self._entries) - int(self._body.rolling.sum())
            steps = steps_that_fit(ranked, room)
            if steps:
                self._body.advance(self._log, ranked[:steps], source[:steps])
                ranked, source = ranked[steps:], source[steps:]
            elif len(self._entries):
                self.flush()
            else:
                self._log = self._log._replace(
                    grains=np.empty(2 * len(self._log.grains), dtype=np.int32)
                )

    def flush(self) -> None:
        """Hand on as a slab what came to rest since the last one."""
        if len(self._entries):
            self._count()
            self._lay(self.rest())
            self._clear_log()

    def rest(self) -> Slab:
        """What came to rest since the last slab."""
        return slab_of(self._entries, self._bottom, self.height.copy(), self._species)

    def state(self) -> State:
        """All that changes, but for what is in the log."""
        self._count()
        return {"grains_at_rest": self._counts, **self._body.arrays}

    def restore(self, state: State) -> None:
        """Go on from a state, with nothing in the log."""
        put_back(self.state(), state)
        self._clear_log()

    def _clear_log(self) -> None:
        self._log.length[0] = self._counted = 0
        self._bottom = self.height.copy()

    @property
    def height(self) -> Ints:
        """Heights (column,) in u."""
        return self._body.height

    @property
    def surface_fraction(self) -> Floats:
        """1 (column, species) for the species of the topmost grain, else 0."""
        return pure(self._species.take(self._body.top), len(self._species))

    @property
    def rolling(self) -> Ints:
        """Rolling grains (column, species), of both sides."""
        return self._by_species(self._body.rolling)

    @property
    def outflow(self) -> Ints:
        """Grains (species,) that fell off the ends."""
        return self._by_species(self._body.outflow)

    @property
    def grains_at_rest(self) -> Ints:
        """Grains (species,) in the stacks."""
        self._count()
        return self._by_species(self._counts)

    def _count(self) -> None:
        self._counts += count(self._entries[self._counted :], len(self._species))
        self._counted = len(self._entries)

    @property
    def _entries(self) -> Entries:
        return self._log.grains[: int(self._log.length[0])]

    def _by_species(self, ranked: Ints) -> Ints:
        return ranked.take(self._ranks, axis=-1)


class BelowSource:
    """Below a source at rest: a slope on its right, one on its left, or both; they do not meet."""

    def __init__(self, rule: Rule, ground: Ground, source: int) -> None:
        self._rule = ranked_rule(rule)
        columns = np.arange(len(ground.height))
        self._right = slope_below(rule, self._rule, ground, columns[source:], 1)
        self._left = slope_below(rule, self._rule, ground, columns[:source][::-1], -1)

    @property
    def height(self) -> Ints:
        """Heights (column,) in u."""
        return self._across(lambda slope: slope.level + slope.slope[::-1].cumsum()[::-1])

    @property
    def top(self) -> Ranks:
        """Rank (column,) of the topmost grain."""
        return self._across(lambda slope: slope.top)

    @property
    def rolling(self) -> Ints:
        """Rolling grains (column, rank)."""
        return self._across(lambda slope: slope.rolling)

    @property
    def outflow(self) -> Ints:
        """Grains (rank,) that fell off the ends."""
        return self._right.outflow + self._left.outflow

    @property
    def arrays(self) -> State:
        """All that changes, as it is kept."""
        return arrays_of(self._right, "right_") | arrays_of(self._left, "left_")

    def advance(self, log: Log, arrivals: Ints, source: Ints) -> None:  # noqa: ARG002
        """Take the steps of `arrivals` (step, side, rank); the log has room for them."""
        slopes = [slope for slope in (self._right, self._left) if slope.slope.size]
        sides = np.split(arrivals, [1], axis=1) if len(slopes) == 2 else [arrivals]
        for slope, grains in zip(slopes, sides, strict=True):
            follow_packets(slope, self._rule, log, np.ascontiguousarray(grains.sum(axis=1)))

    def _across(self, values: Callable[[Slope], NDArray[Any]]) -> NDArray[Any]:
        """Something of each place, in the order of columns."""
        sides = ((self._left, -1), (self._right, 1))
        return np.concatenate([values(slope)[::way] for slope, way in sides if slope.slope.size])


class BelowMovingSource:
    """Below a source that moves: grains roll to both sides everywhere."""

    def __init__(self, rule: Rule, ground: Ground) -> None:
        self._rule = ranked_rule(rule)
        columns, ranks = len(ground.height), len(self._rule.ranks)
        lips = (0, 0) if ground.lips is None else ground.lips
        self._heap = Heap(
            wall=ground.lips is None,
            height=np.concatenate([lips[:1], ground.height, lips[1:]]).astype(np.int64),
            top=np.full(columns, _rank(rule, ground.species), dtype=np.int8),
            rolling=np.zeros((2, 1 + columns + 1, ranks), dtype=np.int64),
            outflow=np.zeros(ranks, dtype=np.int64),
        )

    @property
    def height(self) -> Ints:
        """Heights (column,) in u."""
        return self._heap.height[1:-1]

    @property
    def top(self) -> Ranks:
        """Rank (column,) of the topmost grain."""
        return self._heap.top

    @property
    def rolling(self) -> Ints:
        """Rolling grains (column, rank)."""
        return np.asarray(self._heap.rolling[:, 1:-1].sum(axis=0))

    @property
    def outflow(self) -> Ints:
        """Grains (rank,) that fell off the ends."""
        return self._heap.outflow

    @property
    def arrays(self) -> State:
        """All that changes, as it is kept."""
        return arrays_of(self._heap)

    def advance(self, log: Log, arrivals: Ints, source: Ints) -> None:
        """Take the steps of `arrivals` (step, side, rank); the log has room for them."""
        take_steps(self._heap, self._rule, log, np.ascontiguousarray(arrivals), source)


def _rank(rule: Rule, species: int) -> int:
    return int(np.flatnonzero(rule.smallest_first == species)[0])


def ranked_rule(rule: Rule) -> RankedRule:
    """The rule as kernels take it."""
    species = rule.smallest_first
    return RankedRule(
        ranks=tuple(range(len(species))),
        grain_height=rule.grain_height[species],
        threshold=np.ascontiguousarray(rule.threshold[np.ix_(species, species)].T).ravel(),
        contacts=rule.contacts,
        percolation=rule.percolation,
    )


def slope_below(
    rule: Rule, ranked: RankedRule, ground: Ground, columns: Ints, downhill: int
) -> Slope:
    """The bare ground of `columns`, downhill from the source; nothing rolls, no grain rests."""
    places, ranks = len(columns), len(ranked.ranks)
    level = 0 if ground.lips is None else ground.lips[1 if downhill > 0 else 0]
    words = word_count(places + 1)
    slope = Slope(
        first=Word(columns[0]) if places else Word(0),
        downhill=Word(downhill % 2**64),
        wall=ground.lips is None,
        level=level,
        slope=-np.diff(ground.height[columns], append=level),
        top=np.full(places, _rank(rule, ground.species), dtype=np.int8),
        rolling=np.zeros((places, ranks), dtype=np.int64),
        packet=np.zeros(ranks, dtype=np.int64),
        outflow=np.zeros(ranks, dtype=np.int64),
        eligible=np.zeros(words * ranks, dtype=np.uint64),
        eligible_words=np.zeros(word_count(words) * ranks, dtype=np.uint64),
    )
    if places:
        mark_all(slope, ranked)
    return slope
