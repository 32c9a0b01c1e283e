"""The desk of one visitor: a preset, its knobs and rule, its pours, and a clock.

Every change of a knob asks for both pours anew, from the first grain; the clock goes on from the
share of the pour where it stands. What cannot be poured is said in a line, and the last good pours
stay.
"""

from enum import Enum
from functools import cache
from math import isclose
from random import Random

from compare.campaign import CHECK
from compare.explore.clock import Clock
from compare.explore.knobs import KNOBS, turned
from compare.explore.pours import Pours
from compare.explore.prediction import Guess, Try, judge
from experiment import Experiment, NotApplicableError, SetupError, load, preset_names

__all__ = ["RATE", "THRESHOLD", "Desk", "Stage", "presets"]

THRESHOLD, RATE = "threshold", "rate"
RESOLUTION = {"continuum.cells": 200, "pour.records": 400}
FIRST = "glass-sugar"
ROUND_OFF = 1e-6  # of what a browser gives back


@cache
def presets() -> dict[str, Experiment]:
    """What can be explored: presets of two species, steadily fed, that both models pour in a silo.

    By name, as finely resolved as what is poured many times over has to be. Of those that tell a
    rule of the lattice none, for it is the visitor's choice.
    """
    return {name: setup for name in preset_names() if (setup := _explorable(name)) is not None}


def _explorable(name: str) -> Experiment | None:
    setup = load(name).with_values(RESOLUTION)
    steady = setup.feed.schedule.kind == "constant" and setup.feed.source is None
    if setup.mixture.species != 2 or setup.cell.shape != "silo" or not steady:
        return None
    if "rule" in setup.ca_model:
        return None
    try:
        for check in CHECK.values():
            check(setup)
    except NotApplicableError:
        return None
    return setup


class Stage(Enum):
    """Where a prediction stands."""

    NONE = "none"  # everything may be seen
    OPEN = "open"  # the piles are hidden until something is said
    RUNNING = "running"
    JUDGED = "judged"


class Desk:
    """What one visitor does; nothing here knows of a browser."""

    def __init__(self, first: str = FIRST) -> None:
        self.presets = presets()
        self.rule = THRESHOLD
        self.clock = Clock()
        self.pours: Pours | None = None
        self.complaint = ""
        self._refused: Experiment | None = None
        self.stage = Stage.NONE
        self.tries: list[Try] = []
        self._guess: Guess | None = None
        self.choose(first)

    def choose(self, preset: str) -> None:
        """Begin with a preset, from the first grain."""
        self.preset = preset
        self.values: dict[str, float] = {}
        self._set_up()
        self.clock.turn(0.0)

    def turn(self, knob: str, value: float) -> None:
        """Turn a knob, as far as there is something to pour there; else `complaint` says why."""
        if isclose(value, KNOBS[knob].read(self.presets[self.preset]), rel_tol=ROUND_OFF):
            self.values.pop(knob, None)
        else:
            self.values[knob] = value
        self._set_up()

    def follow(self, rule: str) -> None:
        """Have the lattice follow another rule, as far as there is something to pour by it."""
        self.rule = rule
        self._set_up()

    def _set_up(self) -> None:
        """The set-up that is asked for, if both models can pour it; else `complaint` says why."""
        try:
            setup = turned(self.presets[self.preset], self.values)
            if self.rule != THRESHOLD:
                setup = setup.with_values({"ca_model.rule": self.rule})
            for check in CHECK.values():
                check(setup)
        except SetupError as error:
            self.complaint = str(error)
            return
        self.complaint = ""
        self.setup = setup
        self._hide_again()

    def draw(self, random: Random) -> None:
        """Turn the angles and the flux to where chance has it, until it can be poured."""
        preset = self.presets[self.preset]
        self.choose(self.preset)
        steep = KNOBS["angle_1"].read(preset)
        self.turn("angle_2", round(random.uniform(max(5.0, steep - 15.0), min(60.0, steep + 15.0))))
        low, high, step = KNOBS["total_inflow"].range_of(preset)
        self.turn("total_inflow", low + step * random.randint(0, round((high / 2 - low) / step)))

    def knob(self, name: str) -> float:
        """Where a knob stands."""
        return self.values.get(name, KNOBS[name].read(self.presets[self.preset]))

    @property
    def wanted(self) -> Experiment | None:
        """The set-up that should be poured; None where the pours are there, or cannot be."""
        there = self.pours is not None and self.pours.setup == self.setup
        return None if there or self.setup == self._refused else self.setup

    def take(self, pours: Pours) -> None:
        """Have these pours before one."""
        self.pours = pours

    def refuse(self, setup: Experiment, complaint: str) -> None:
        """Stay with the pours that are there, for this set-up cannot be poured.

        Who has gone on to another set-up need not hear of it.
        """
        if setup != self.setup:
            return
        self.complaint = complaint
        self._refused = setup
        if self.pours is not None:
            self.setup = self.pours.setup

    @property
    def toml(self) -> str:
        """The set-up, as `stratify pour` takes it."""
        return self.setup.to_toml()

    def predict(self, *, on: bool) -> None:
        """Hide the piles, to predict what will be laid; or show them again."""
        self.stage = Stage.OPEN if on else Stage.NONE
        self.clock.pause()
        self.clock.turn(0.0 if on else self.clock.share)

    def run(self, guess: Guess) -> None:
        """Say what is expected, and see it poured."""
        self._guess = guess
        self.stage = Stage.RUNNING
        self.clock.restart()

    @property
    def due(self) -> bool:
        """Whether a prediction runs, and its pour is over."""
        return self.stage is Stage.RUNNING and self.clock.share >= 1.0 and self.wanted is None

    def judge(self) -> list[Try]:
        """All tries, with the one that is due."""
        if self.due and self.pours is not None and self._guess is not None:
            verdicts = judge(self._guess, self.pours.measure(1.0))
            self.tries.append(Try(self.setup.mixture.delta, self._guess, verdicts))
            self.stage = Stage.JUDGED
        return self.tries

    def _hide_again(self) -> None:
        """Another set-up is another riddle."""
        if self.stage is not Stage.NONE:
            self.predict(on=True)
