"""The page: the desk's knobs, both piles, their numbers, the player and the predictions.

What is slow, pours and measurements, is done by WORKERS, of which all visitors share a few; their
results come back between two events of the visitor's own document.
"""

import math
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from importlib.resources import files
from io import StringIO
from random import Random
from time import monotonic
from typing import Any

import panel as pn
from bokeh.io import curdoc

from compare.campaign import POUR
from compare.explore import words
from compare.explore.desk import Desk, Stage
from compare.explore.knobs import KNOBS
from compare.explore.pours import Numbers, Pours
from compare.explore.prediction import PATTERNS, Guess
from compare.explore.view import Pile, Window
from experiment import StratifyError

__all__ = ["WORKERS", "Page"]

WORKERS = ThreadPoolExecutor(2, "pours")
PERIOD = 100  # ms, from picture to picture
PACES = {"in 15 s": 15.0, "in 30 s": 30.0, "in 60 s": 60.0}
STYLE = files(__package__).joinpath("page.css").read_text(encoding="utf-8")
EXPLORE, PREDICT = "Explore", "Predict, then run"


class Page:
    """One visitor's page."""

    def __init__(self) -> None:
        self.desk = Desk()
        self.window = Window()
        self.piles = {model: Pile(self.window, model) for model in POUR}
        self._random = Random()  # noqa: S311
        self._quiet = False  # while the page itself moves what the visitor could
        self._busy: dict[str, bool] = {"pour": False, "measure": False}
        self._last = monotonic()
        self._make_knobs()
        self._make_player()
        self._make_prediction()
        self.told = {model: _text(name=f"numbers-{model}") for model in POUR}
        self.delta, self.key, self.sizes, self.complaint = (_text() for _ in range(4))
        self.layout = self._lay_out()
        self._show_setup()
        self._document = curdoc()
        self._pour()
        pn.state.add_periodic_callback(self._tick, period=PERIOD)

    def _make_knobs(self) -> None:
        titles = {setup.title: name for name, setup in self.desk.presets.items()}
        self.preset = pn.widgets.Select(
            name="preset", options=titles, value=self.desk.preset, **_full()
        )
        self.preset.param.watch(self._heard(self._choose), "value")
        self.knobs = {
            name: pn.widgets.FloatSlider(
                name=knob.label, format="0[.]000", tooltips=False, css_classes=[name], **_full()
            )
            for name, knob in KNOBS.items()
        }
        for name, slider in self.knobs.items():
            slider.param.watch(self._heard(partial(self._turn, name)), "value")
        self.download = pn.widgets.FileDownload(
            callback=lambda: StringIO(self.desk.toml),
            filename="setup.toml",
            label="Save set-up (TOML)",
            **_full(),
        )

    def _make_player(self) -> None:
        self.play = pn.widgets.Button(name="▶ Play", button_type="primary", width=130, **_styled())
        self.again = pn.widgets.Button(name="From the start", width=130, **_styled())
        self.time = pn.widgets.FloatSlider(
            name="time (s)", format="0.0", tooltips=False, css_classes=["time"], **_full()
        )
        self.pace = pn.widgets.Select(
            name="whole pour", options=PACES, value=self.desk.clock.lasts, width=110, **_styled()
        )
        self.play.on_click(lambda _: self._play())
        self.again.on_click(lambda _: self._restart())
        self.time.param.watch(self._heard(self._scrub), "value")
        self.pace.param.watch(self._heard(self._set_pace), "value")

    def _make_prediction(self) -> None:
        self.mode = pn.widgets.RadioButtonGroup(
            name="mode", options=[EXPLORE, PREDICT], value=EXPLORE, **_full()
        )
        self.pattern = pn.widgets.RadioBoxGroup(
            name="What will be laid?", options=list(PATTERNS), inline=True, width=280, **_styled()
        )
        self.wavelength = pn.widgets.FloatInput(
            name="wavelength (cm), a guess", start=0.0, value=None, width=170, **_styled()
        )
        self.run = pn.widgets.Button(name="Run", button_type="primary", width=90, **_styled())
        self.draw = pn.widgets.Button(name="Draw a set-up", width=130, **_styled())
        self.verdict, self.scores = _text(), _text()
        self.mode.param.watch(self._heard(self._set_mode), "value")
        self.run.on_click(lambda _: self._run())
        self.draw.on_click(lambda _: self._draw())

    def _lay_out(self) -> pn.Row:
        asked = pn.Row(
            pn.Column(_text("<b>What will be laid?</b>"), self.pattern, width=290),
            self.wavelength,
            self.run,
            self.draw,
            self.verdict,
            css_classes=["predict"],
            sizing_mode="stretch_width",
            visible=False,
            **_styled(),
        )
        self.asked = asked
        desk = pn.Column(
            _text("<h1>stratify</h1>"),
            self.mode,
            self.preset,
            *self.knobs.values(),
            self.sizes,
            self.download,
            self.scores,
            css_classes=["desk"],
            width=310,
            sizing_mode="stretch_height",
            scroll=True,
            **_styled(),
        )
        piles = [
            pn.Column(
                self.told[model],
                pn.pane.Bokeh(pile.figure, sizing_mode="stretch_both", min_height=150),
                sizing_mode="stretch_both",
            )
            for model, pile in self.piles.items()
        ]
        player = pn.Row(
            self.play, self.again, self.time, self.pace, sizing_mode="stretch_width", **_styled()
        )
        main = pn.Column(
            self.delta,
            self.complaint,
            asked,
            pn.Row(*piles, sizing_mode="stretch_both"),
            self.key,
            player,
            css_classes=["main"],
            sizing_mode="stretch_both",
            **_styled(),
        )
        return pn.Row(desk, main, sizing_mode="stretch_both", css_classes=["page"], **_styled())

    # What the visitor does

    def _heard(self, act: Callable[[Any], None]) -> Callable[[Any], None]:
        """Does `act` with the new value, where it is the visitor who changed it."""

        def hear(event: Any) -> None:
            if not self._quiet:
                act(event.new)

        return hear

    def _choose(self, preset: str) -> None:
        self.desk.choose(preset)
        self._changed()

    def _turn(self, name: str, value: float) -> None:
        self.desk.turn(name, value)
        self._changed()

    def _draw(self) -> None:
        self.desk.draw(self._random)
        self._changed()

    def _changed(self) -> None:
        self._show_setup()
        self._show_moment()
        self._pour()

    def _play(self) -> None:
        clock = self.desk.clock
        if clock.playing:
            clock.pause()
        else:
            clock.play()
        self._show_moment()

    def _restart(self) -> None:
        self.desk.clock.turn(0.0)
        self.desk.clock.play()
        self._show_moment()

    def _scrub(self, seconds: float) -> None:
        if self.desk.pours is not None:
            self.desk.clock.turn(seconds / self.time.end)
            self._show_moment()

    def _set_pace(self, lasts: float) -> None:
        self.desk.clock.lasts = lasts

    def _set_mode(self, mode: str) -> None:
        self.desk.predict(on=mode == PREDICT)
        self._show_setup()
        self._show_moment()

    def _run(self) -> None:
        value = self.wavelength.value
        self.desk.run(Guess(self.pattern.value, math.nan if value is None else value))
        self._show_setup()
        self._show_moment()

    # What takes its time

    def _pour(self) -> None:
        setup = self.desk.wanted
        if setup is not None:
            self._work("pour", partial(Pours, setup), self._take)

    def _take(self, pours: Pours) -> None:
        self.desk.take(pours)
        piles = list(pours.of.values())
        self.window.fit(piles)
        for model, pile in pours.of.items():
            self.piles[model].show(pile)
        self._show_setup()
        self._show_moment()
        self._pour()

    def _measure(self) -> None:
        pours, share = self.desk.pours, self.desk.clock.share
        if pours is not None and self._numbers() is None:
            self._work("measure", partial(pours.measure, share), lambda _: self._show_moment())

    def _numbers(self) -> dict[str, Numbers] | None:
        """What is known of both piles as far as they have come."""
        if self.desk.pours is None:
            return None
        known = {m: p.known(self.desk.clock.share) for m, p in self.desk.pours.of.items()}
        told = {model: numbers for model, numbers in known.items() if numbers is not None}
        return told if len(told) == len(known) else None

    def _work(self, kind: str, work: Callable[[], Any], then: Callable[[Any], None]) -> None:
        """Have it done by a worker, unless one is at it; what comes of it is shown."""
        if self._busy[kind]:
            return
        self._busy[kind] = True

        def back(done: "Future[Any]") -> None:
            self._document.add_next_tick_callback(partial(self._back, kind, then, done))

        WORKERS.submit(work).add_done_callback(back)

    def _back(self, kind: str, then: Callable[[Any], None], done: "Future[Any]") -> None:
        self._busy[kind] = False
        try:
            result = done.result()
        except (StratifyError, MemoryError) as error:
            self.desk.refuse(str(error))
            self._show_setup()
            return
        then(result)

    # What is shown

    def _tick(self) -> None:
        now = monotonic()
        passed, self._last = now - self._last, now
        if self.desk.pours is None or not self.desk.clock.playing:
            return
        self.desk.clock.tick(passed)
        self._show_moment()

    def _show_setup(self) -> None:
        """Everything that a change of the set-up changes, but the piles."""
        desk = self.desk
        self._quiet = True
        for name, slider in self.knobs.items():
            low, high, step = KNOBS[name].range_of(desk.presets[desk.preset])
            slider.param.update(start=low, end=high, step=step, value=desk.knob(name))
        if desk.pours is not None:
            self.time.param.update(end=next(iter(desk.pours.of.values())).duration)
        self._quiet = False
        self.delta.object = words.delta_told(desk.setup)
        self.complaint.object = f'<p class="complaint" role="alert">{desk.complaint}</p>'
        self.complaint.visible = bool(desk.complaint)
        hidden = desk.stage is Stage.OPEN
        predicting = desk.stage is not Stage.NONE
        self.asked.visible = predicting
        self.run.disabled = not hidden
        self.play.disabled = self.again.disabled = self.time.disabled = hidden
        if desk.stage is not Stage.JUDGED:
            self.verdict.object = ""
        if desk.pours is not None:
            self.key.object = words.key_told(desk.setup, self.piles["ca_model"].exaggeration)
            self.sizes.object = words.sizes_told(desk.setup, desk.pours.of["ca_model"])

    def _show_moment(self) -> None:
        """The piles at the time of the clock, and what is measured so far."""
        desk, pours = self.desk, self.desk.pours
        self.play.name = "❚❚ Pause" if desk.clock.playing else "▶ Play"
        if pours is None:
            return
        share = desk.clock.share
        self._quiet = True
        self.time.value = min(share * self.time.end, self.time.end)
        self._quiet = False
        numbers, hidden = self._numbers(), desk.stage is Stage.OPEN
        for model, pile in pours.of.items():
            self.piles[model].show_at(pile, pile.at(share))
            if numbers is not None or hidden:
                found = None if numbers is None else numbers[model]
                self.told[model].object = words.numbers_told(
                    pile, found, hidden=hidden, over=share >= 1.0
                )
        self._measure()
        if numbers is not None and desk.due:
            verdict = desk.judge()
            if verdict is not None:
                self.verdict.object = words.verdict_told(verdict)
                self.scores.object = words.scores_told(desk.tries)


def _styled() -> dict[str, Any]:
    return {"stylesheets": [STYLE]}


def _full() -> dict[str, Any]:
    return {"sizing_mode": "stretch_width"} | _styled()


def _text(html: str = "", **how: Any) -> pn.pane.HTML:
    return pn.pane.HTML(html, sizing_mode="stretch_width", **how, **_styled())
