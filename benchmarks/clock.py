"""How long something takes on a machine that does other things as well."""

import time
from collections.abc import Callable, Mapping
from typing import Any

__all__ = ["once", "seconds", "seconds_in_turn"]


def once(action: Callable[[], object]) -> float:
    start = time.perf_counter()
    action()
    return time.perf_counter() - start


def seconds(action: Callable[[], object], repeats: int = 3) -> float:
    """The shortest of several runs, after one that may compile."""
    action()
    return min(once(action) for _ in range(repeats))


def seconds_in_turn(
    prepare: Callable[[], Any], actions: Mapping[str, Callable[[Any], object]], rounds: int
) -> dict[str, float]:
    """The shortest run of each of `actions`, taken in turn, each on what `prepare` returns."""
    best = dict.fromkeys(actions, float("inf"))
    for _ in range(rounds):
        for name, action in actions.items():
            state = prepare()
            best[name] = min(best[name], once(lambda act=action, on=state: act(on)))
    return best
