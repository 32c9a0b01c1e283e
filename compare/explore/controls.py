"""What a visitor can turn, press and read, and where it lies on the page."""

from importlib.resources import files
from typing import Any

import panel as pn

from compare.explore import words
from compare.explore.clock import Clock
from compare.explore.desk import RATE, THRESHOLD
from compare.explore.knobs import KNOBS
from compare.explore.prediction import PATTERNS
from compare.explore.view import Pile

__all__ = ["EXPLORE", "PREDICT", "STYLE", "Controls"]

STYLE = files(__package__).joinpath("page.css").read_text(encoding="utf-8")
EXPLORE, PREDICT = "Explore", "Predict, then run"
RULES = {
    "threshold: stop where it is flat enough": THRESHOLD,
    "rate: by the chances of the continuum": RATE,
}
PACES = {"in 15 s": 15.0, "in 30 s": 30.0, "in 60 s": 60.0}


class Controls:
    """The widgets of one page, and the texts between them."""

    def __init__(self, presets: dict[str, str]) -> None:
        """Of `presets`, names by titles."""
        self.mode = pn.widgets.RadioButtonGroup(options=[EXPLORE, PREDICT], value=EXPLORE, **_wide)
        self.preset = pn.widgets.Select(label="preset", options=presets, **_wide)
        self.rule = pn.widgets.Select(label="rule of lattice grains", options=RULES, **_wide)
        self.knobs = {
            name: _slider(knob.label, name, format="0[.]0" if knob.step >= 0.5 else "0[.]000")
            for name, knob in KNOBS.items()
        }
        self.save = pn.widgets.FileDownload(
            filename="setup.toml", label="Save set-up (TOML)", **_wide
        )
        self.play = _button("▶ Play", 130, color="primary")
        self.again = _button("From the start", 155)
        # A share of the pour: a browser's keys do not learn of another range.
        self.time = _slider("", "time", show_value=False, step=0.001)
        self.pace = pn.widgets.Select(
            label="whole pour", options=PACES, value=Clock.lasts, width=110, **_styled
        )
        self.pattern = pn.widgets.RadioBoxGroup(
            options=list(PATTERNS), inline=True, width=300, **_styled
        )
        self.pattern.value = None  # for the visitor to choose
        self.wavelength = pn.widgets.FloatInput(
            label="wavelength (cm), a guess", start=0.0, step=0.1, value=None, width=185, **_styled
        )
        self.run = _button("Run", 90, color="primary")
        self.draw = _button("Another set-up", 155)
        self.delta, self.complaint, self.sizes, self.scores = (_text() for _ in range(4))
        self.clock, self.key = _text(words.NO_TIME), _text(words.NO_KEY)

    def lay_out(self, piles: dict[str, Pile]) -> pn.Row:
        """The whole page."""
        self.numbers = {model: _text(words.WAITING) for model in piles}
        self.prediction = pn.Row(
            pn.Column(_text("<b>What will be laid?</b>"), self.pattern, width=310),
            self.wavelength,
            self.run,
            self.draw,
            css_classes=["predict"],
            visible=False,
            **_wide,
        )
        pictures = [
            pn.Column(
                self.numbers[model],
                pn.pane.Bokeh(pile.figure, sizing_mode="stretch_both", min_height=150),
                sizing_mode="stretch_both",
            )
            for model, pile in piles.items()
        ]
        main = pn.Column(
            self.delta,
            self.complaint,
            self.prediction,
            pn.Row(*pictures, sizing_mode="stretch_both"),
            self.key,
            pn.Row(
                self.play, self.again, pn.Column(self.clock, self.time, **_wide), self.pace, **_wide
            ),
            sizing_mode="stretch_both",
            **_styled,
        )
        return pn.Row(self._desk(), main, sizing_mode="stretch_both", **_styled)

    def _desk(self) -> pn.Column:
        return pn.Column(
            _text("<h1>stratify <small>pour a mixture</small></h1>"),
            self.mode,
            self.preset,
            self.rule,
            *self.knobs.values(),
            self.sizes,
            self.save,
            self.scores,
            css_classes=["desk"],
            width=310,
            sizing_mode="stretch_height",
            scroll=True,
            **_styled,
        )


_styled: dict[str, Any] = {"stylesheets": [STYLE]}
_wide: dict[str, Any] = {"sizing_mode": "stretch_width"} | _styled


def _text(html: str = "") -> pn.pane.HTML:
    return pn.pane.HTML(html, **_wide)


def _button(label: str, width: int, **how: Any) -> pn.widgets.Button:
    return pn.widgets.Button(label=label, width=width, **how, **_styled)


def _slider(label: str, name: str, **how: Any) -> pn.widgets.FloatSlider:
    return pn.widgets.FloatSlider(label=label, tooltips=False, css_classes=[name], **how, **_wide)
