"""A pile on the lattice, by species, over the kernel's arrays, which count by rank."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ca_model.deposit import Slab, count, slab_of
from ca_model.kernel import FRAME, LOGGED, RankedRule, State, advance, mark_all
from ca_model.lattice import Ground, Rule
from experiment.arrays import Ints

__all__ = ["Pile"]

LOG = 2**20  # grains
WALL = 2**62  # the level beyond a wall: every slope towards it captures


class Pile:
    """The state of a pour. What comes to rest is handed on in slabs, to `lay`."""

    def __init__(
        self, rule: Rule, ground: Ground, lay: Callable[[Slab], object], log: int = LOG
    ) -> None:
        self._species = rule.smallest_first  # (rank,)
        self._lay = lay
        self._laid = np.zeros(len(self._species), dtype=np.int64)
        self._rule = _ranked(rule)
        self._state = _still(rule, ground, log)
        mark_all(self._state, self._rule)

    def advance(self, arrivals: Ints, source: Ints) -> None:
        """Take a step for each row of `arrivals` (step, side, species).

        The grains of a step enter to the right and left of the edge before column `source` (step,).
        """
        ranked = np.ascontiguousarray(arrivals[:, :, self._species])
        columns = source.astype(np.uint64)
        while len(ranked):
            done = advance(self._state, self._rule, ranked, columns)
            ranked, columns = ranked[done:], columns[done:]
            if len(ranked):
                self.flush()
                if done == 0:
                    log = np.empty(2 * len(self._state.log), dtype=np.int32)
                    self._state = self._state._replace(log=log)

    def flush(self) -> None:
        """Hand on as a slab what came to rest since the last one."""
        self._laid = self.grains_at_rest
        self._lay(slab_of(self._log, self._state.top.size, self._species))
        self._state.counter[LOGGED] = 0

    @property
    def height(self) -> Ints:
        """Heights (column,) in u."""
        return self._state.height[1:-1]

    @property
    def surface(self) -> Ints:
        """Species (column,) of the topmost grains."""
        return self._species[self._state.top]

    @property
    def rolling(self) -> Ints:
        """Rolling grains (column, species), of both sides."""
        columns, ranks = self._state.top.size, len(self._species)
        frame = int(self._state.counter[FRAME])
        flows = self._state.rolling.reshape(-1, 2 * columns, ranks)[:, frame : frame + columns]
        return self._by_species(sum((flow[::-1] for flow in flows[1:]), flows[0]))

    @property
    def outflow(self) -> Ints:
        """Grains (species,) that fell off the ends."""
        return self._by_species(self._state.outflow)

    @property
    def grains_at_rest(self) -> Ints:
        """Grains (species,) in the stacks."""
        return self._laid + self._by_species(count(self._log, len(self._species)))

    @property
    def _log(self) -> NDArray[np.int32]:
        return self._state.log[: int(self._state.counter[LOGGED])]

    def _by_species(self, ranked: Ints) -> Ints:
        counts = np.empty_like(ranked)
        counts[..., self._species] = ranked
        return counts


def _ranked(rule: Rule) -> RankedRule:
    species = rule.smallest_first
    return RankedRule(
        ranks=tuple(range(len(species))),
        grain_height=rule.grain_height[species],
        threshold=np.ascontiguousarray(rule.threshold[np.ix_(species, species)].T).ravel(),
        contacts=rule.contacts,
        percolation=rule.percolation,
    )


def _still(rule: Rule, ground: Ground, log: int) -> State:
    """Nothing rolls, no grain is at rest."""
    columns, ranks, sides = len(ground.height), len(rule.smallest_first), ground.sides
    words, slot_words = -(-columns // 64), -(-2 * columns // 64) + 2
    beyond = (WALL, WALL) if ground.lips is None else ground.lips
    rank = int(np.flatnonzero(rule.smallest_first == ground.species)[0])

    def empty(size: int) -> NDArray[np.uint64]:
        return np.zeros((sides, size), dtype=np.uint64)

    return State(
        sides=tuple(range(sides)),
        wall=ground.lips is None,
        height=np.concatenate([beyond[:1], ground.height, beyond[1:]]).astype(np.int64),
        top=np.full(columns, rank, dtype=np.int8),
        rolling=np.zeros((sides, 2 * columns * ranks), dtype=np.int64),
        packets=empty(slot_words * ranks),
        packet_words=empty(-(-slot_words // 64) + 2),
        eligible=empty(words * ranks),
        eligible_words=empty(-(-words // 64)),
        outflow=np.zeros(ranks, dtype=np.int64),
        log=np.empty(log, dtype=np.int32),
        counter=np.array([columns, 0, 0], dtype=np.uint64),
    )
