"""The page: what a visitor does goes to the desk, and what is on the desk is shown.

Panel calls back without the lock of the document, which pictures need: so callbacks change the
desk only, and the next tick, which has the lock, shows it. What is slow, pours and measurements, is
done by WORKERS, of which all visitors share a few.
"""

import logging
import math
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from io import StringIO
from random import Random
from time import monotonic
from typing import Any

import panel as pn
from bokeh.io import curdoc

from compare.campaign import POUR
from compare.explore import words
from compare.explore.controls import PREDICT, Controls
from compare.explore.desk import Desk, Stage
from compare.explore.knobs import KNOBS
from compare.explore.pours import Numbers, Pours
from compare.explore.prediction import Guess
from compare.explore.view import Pile, Window
from experiment import StratifyError

__all__ = ["WORKERS", "Page"]

WORKERS = ThreadPoolExecutor(2, "pours")
PERIOD = 80  # ms, from picture to picture


class Page:
    """One visitor's page."""

    def __init__(self) -> None:
        self.desk = Desk()
        self.window = Window()
        self.piles = {model: Pile(self.window, model) for model in POUR}
        self.controls = Controls({setup.title: name for name, setup in self.desk.presets.items()})
        self.layout: pn.Row = self.controls.lay_out(self.piles)
        self._random = Random()  # noqa: S311
        self._quiet = False  # while the page itself moves what the visitor could
        self._changed = self._moved = True  # the set-up, the clock: since it was shown
        self._at_work: dict[str, Future[Any]] = {}
        self._last = monotonic()
        self._listen()
        self._show_setup()
        curdoc().add_periodic_callback(self.tick, PERIOD)

    # What the visitor does

    def _listen(self) -> None:
        desk, controls = self.desk, self.controls
        self._heed(controls.preset, desk.choose)
        self._heed(controls.rule, desk.follow)
        for name, slider in controls.knobs.items():
            self._heed(slider, partial(desk.turn, name))
        self._heed(controls.mode, lambda mode: desk.predict(on=mode == PREDICT))
        self._heed(controls.pattern, lambda _: None)
        self._heed(controls.time, desk.clock.turn)
        self._heed(controls.pace, lambda lasts: setattr(desk.clock, "lasts", lasts))
        self._press(controls.play, desk.clock.toggle)
        self._press(controls.again, desk.clock.restart)
        self._press(controls.run, lambda: desk.run(self._guess()))
        self._press(controls.draw, lambda: desk.draw(self._random))
        controls.save.callback = lambda: StringIO(desk.toml)

    def _heed(self, widget: pn.widgets.Widget, act: Callable[[Any], object]) -> None:
        """Do `act` with each new value that the visitor gives."""

        def hear(event: Any) -> None:
            if not self._quiet:
                act(event.new)
                self._changed = True

        widget.param.watch(hear, "value")

    def _press(self, button: pn.widgets.Button, act: Callable[[], object]) -> None:
        def hear(_: object) -> None:
            act()
            self._changed = True

        button.on_click(hear)

    def _guess(self) -> Guess:
        wavelength = self.controls.wavelength.value
        return Guess(self.controls.pattern.value, math.nan if wavelength is None else wavelength)

    # What takes its time

    def _work(self, kind: str, work: Callable[[], Any]) -> Future[Any] | None:
        """`work`, once it is done by a worker, of each kind one at a time; None before."""
        if kind not in self._at_work:
            self._at_work[kind] = WORKERS.submit(work)
        return self._at_work.pop(kind) if self._at_work[kind].done() else None

    def _pour(self) -> None:
        """Have poured what is wanted, and take it."""
        if "pour" not in self._at_work:
            if self.desk.wanted is None:
                return
            self._asked = self.desk.setup
        done = self._work("pour", partial(Pours, self._asked))
        if done is None:
            return
        self._changed = True
        if (error := done.exception()) is not None:
            self.desk.refuse(self._asked, str(error) or type(error).__name__)
            if not isinstance(error, StratifyError):
                logging.getLogger(__name__).error("a pour failed", exc_info=error)
            return
        pours = done.result()
        self.desk.take(pours)
        self.window.fit(list(pours.of.values()))
        for model, pile in pours.of.items():
            self.piles[model].show(pile)

    def _numbers(self) -> dict[str, Numbers] | None:
        """What is measured of both piles as far as they have come; None until it is."""
        pours, share = self.desk.pours, self.desk.clock.share
        if pours is None:
            return None
        if pours.known(share) is None:
            done = self._work("measure", partial(pours.measure, share))
            if done is not None:
                done.result()
        return pours.known(share)

    # What is shown

    def tick(self) -> None:
        """Go on with what is at work, and show what has changed."""
        now = monotonic()
        passed, self._last = now - self._last, now
        self._pour()
        if self._changed:
            self._show_setup()
            self._changed, self._moved = False, True
        if self.desk.pours is None:
            return
        self._moved |= self.desk.clock.tick(passed)
        if self._moved and all(pile.ready(now) for pile in self.piles.values()):
            self._show_piles()
            self._moved = False
        self._show_numbers()

    def _show_setup(self) -> None:
        desk, controls = self.desk, self.controls
        hidden = desk.stage is Stage.OPEN
        self._show_knobs()
        controls.delta.object = words.delta_told(desk.setup, hidden=hidden)
        controls.complaint.object = words.complaint_told(desk.complaint)
        controls.complaint.visible = bool(desk.complaint)
        controls.prediction.visible = desk.stage is not Stage.NONE
        controls.run.disabled = (
            not hidden or desk.wanted is not None or controls.pattern.value is None
        )
        controls.play.disabled = controls.again.disabled = hidden
        if desk.pours is not None:
            controls.key.object = words.key_told(desk.setup, self.piles["ca_model"].exaggeration)
            controls.sizes.object = words.sizes_told(desk.setup, desk.pours.of["ca_model"])

    def _show_knobs(self) -> None:
        desk, controls = self.desk, self.controls
        self._quiet = True
        controls.preset.value = desk.preset
        for name, slider in controls.knobs.items():
            low, high, step = KNOBS[name].range_of(desk.presets[desk.preset])
            slider.param.update(start=low, end=high, step=step, value=desk.knob(name))
        self._quiet = False

    def _show_piles(self) -> None:
        desk, controls = self.desk, self.controls
        if desk.pours is None:
            return
        controls.play.label = "❚❚ Pause" if desk.clock.playing else "▶ Play"
        controls.clock.object = words.time_told(desk.clock.share, desk.pours.duration)
        self._quiet = True
        controls.time.value = desk.clock.share
        self._quiet = False
        # Panel drops what a visitor does to a slider while the page moves it.
        controls.time.disabled = desk.clock.playing or desk.stage is Stage.OPEN
        for model, pile in desk.pours.of.items():
            self.piles[model].show_at(pile, pile.at(desk.clock.share), self._last)

    def _show_numbers(self) -> None:
        """Those of what is asked for: of what was poured for other settings, none are told."""
        desk, numbers = self.desk, self._numbers()
        if desk.pours is None:
            return
        unseen = words.POURING if desk.wanted else words.HIDDEN if desk.stage is Stage.OPEN else ""
        if not unseen and numbers is None:
            return  # what was told of an earlier share, or that it is being poured, stays
        if desk.due:
            self.controls.scores.object = words.scores_told(desk.judge())
        verdicts = desk.tries[-1].verdicts if desk.stage is Stage.JUDGED else {}
        for model, pile in desk.pours.of.items():
            found = unseen if unseen or numbers is None else numbers[model]
            told = words.numbers_told(pile, found, verdicts.get(model))
            if self.controls.numbers[model].object != told:
                self.controls.numbers[model].object = told
