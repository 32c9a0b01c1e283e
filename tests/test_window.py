"""The window: long pours through it lay the same grains as the kernel that goes step by step."""

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ca_model.pile
from ca_model.kernel.packets import follow_packets
from ca_model.lattice import MANY, Ground, Rule
from ca_model.pile import Pile
from experiment.pouring.slabs import Deposit

STRATIFYING = (np.array([1, 2]), np.array([[4, 8], [1, 5]]), np.array([0, 1]))


class Setup(NamedTuple):
    """A long pour from a source at rest, in units of the lattice, and where it is cut in calls."""

    rule: Rule
    ground: Ground
    source: int
    arrivals: np.ndarray  # (step, side, species)
    cuts: list[int]


@st.composite
def set_ups(draw: st.DrawFn) -> Setup:
    """Thresholds up to what bytes hold and above, cliffs, feeds of all sizes, with gaps."""
    random = np.random.default_rng(draw(st.integers(0, 2**32)))
    species, steps = draw(st.integers(1, 3)), draw(st.sampled_from([300, 1000, 3000]))
    highest = draw(st.sampled_from([3, 9, 90]))
    steepest = draw(st.sampled_from([6, 12, 30, 60, 300]))
    heights = random.integers(1, highest + 1, species)
    rule = Rule(
        grain_height=heights,
        threshold=random.integers(0, steepest, (species, species)),
        smallest_first=np.argsort(heights, kind="stable"),
        contacts=draw(st.sampled_from([1, 2, 3, MANY])),
        percolation=True,
    )
    columns = draw(st.integers(62, 200))
    source = draw(st.sampled_from([0, columns // 2, max(0, columns - 66), columns]))
    inclined = draw(st.integers(0, 6)) * np.abs(np.arange(columns) - source).max()
    height = inclined - draw(st.integers(0, 6)) * np.abs(np.arange(columns) - source)
    height = height + random.integers(0, draw(st.integers(1, 12)), columns)
    height[random.integers(columns) :] -= draw(st.sampled_from([-200, -50, 0, 50]))
    lips = draw(st.none() | st.tuples(st.integers(-9, 9), st.integers(-9, 9)))
    rates = random.choice([0.3, 1, 3, 20], species, p=[0.3, 0.4, 0.2, 0.1])
    arrivals = random.poisson(rates, (steps, 2, species))
    arrivals[random.random(steps) < 0.3] = 0
    rare = random.random(steps) < 0.01
    arrivals[rare] = random.integers(0, 60, (rare.sum(), 2, species))
    cuts = sorted(draw(st.lists(st.integers(0, steps), max_size=4)))
    return Setup(rule, Ground(height, 0, lips, 2), source, arrivals, cuts)


def poured(setup: Setup, source: int | None) -> tuple[list[list[int]], ...]:
    """Stacks, heights, rolling grains and outflow; step by step where no source is given."""
    deposit = Deposit()
    pile = Pile(setup.rule, setup.ground, deposit.lay, source=source)
    for arrivals in np.split(setup.arrivals, setup.cuts):
        pile.advance(arrivals, np.full(len(arrivals), setup.source))
    pile.flush()
    stacks = [deposit.stack(i).tolist() for i in range(len(setup.ground.height))]
    return stacks, pile.height.tolist(), pile.rolling.tolist(), pile.outflow.tolist()


@settings(max_examples=500, deadline=None)
@given(set_ups())
def test_packets_and_steps_lay_the_same_grains_for_long(setup: Setup) -> None:
    assert poured(setup, setup.source) == poured(setup, None)


@pytest.mark.parametrize("contacts", [1, 2, MANY])
def test_most_packets_are_captured_in_windows(contacts, monkeypatch) -> None:
    captured = []
    monkeypatch.setattr(
        ca_model.pile, "follow_packets", lambda *args: captured.append(follow_packets(*args))
    )
    random = np.random.default_rng(0)
    steps, columns = 30_000, 150
    grains = random.multinomial(3, [2 / 3, 1 / 3], size=(steps, 2))
    ground = Ground(4 * (75 - np.abs(np.arange(columns) - 75)), 0, None, 2)
    rule = Rule(*STRATIFYING, contacts, percolation=True)
    setup = Setup(rule, ground, 75, grains, [100, 101, 10_000])
    assert poured(setup, 75) == poured(setup, None)
    assert sum(captured) > steps, "of two sides"


def silo(rule: Rule, height: np.ndarray, grains: np.ndarray) -> Setup:
    """These grains (step, species) arrive on the left of these columns."""
    arrivals = np.stack([grains, np.zeros_like(grains)], axis=1)
    return Setup(rule, Ground(height, 0, None, 2), 0, arrivals, [])


def test_slopes_that_grow_too_steep_for_bytes_leave_the_window() -> None:
    """The first column captures small grains, those behind it large ones, for many packets."""
    rule = Rule(np.array([1, 20]), np.full((2, 2), 20), np.array([0, 1]), 1, percolation=True)
    grains = np.zeros((300, 2), dtype=np.int64)
    grains[200:] = 1
    grains[200:260, 1] = np.repeat(np.arange(40, 20, -1), 3)
    setup = silo(rule, 40 * np.arange(100), grains)
    assert poured(setup, 0) == poured(setup, None)


def test_a_column_that_captures_more_than_bytes_hold_keeps_the_window_closed() -> None:
    """One packet fills a pit, whichever it is."""
    rule = Rule(np.array([1]), np.array([[5]]), np.array([0]), MANY, percolation=True)
    for packet in range(64):
        grains = np.full((250, 1), 3)
        grains[: 150 + packet] = 0
        grains[150 + packet] = 215
        setup = silo(rule, np.repeat([0, 200], [2, 98]), grains)
        assert poured(setup, 0) == poured(setup, None)
