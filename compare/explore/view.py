"""The picture of one pile while it is poured, for a browser.

The deposit is sent once a pour, as an image; at each instant what is not yet laid is covered, and
on the cover lies what rolls, a band a species, drawn `exaggeration` times as thick as it is.
"""

import math

import numpy as np
from bokeh.models import ColumnDataSource, CustomJS, Image, LinearColorMapper, Range1d
from bokeh.palettes import cividis
from bokeh.plotting import figure
from numpy.typing import NDArray

from compare.deposit.picture import averaged
from compare.explore.pours import Poured
from compare.pictures.moment import Moment
from compare.pictures.style import FRONT, KINK, edges
from compare.quantities import coarseness, total_inflow, values_of
from experiment.arrays import Floats

__all__ = ["LARGE", "SMALL", "Pile", "Window"]

ROWS = 600  # of the image at the most
SHADES = 255
NOTHING = 255
AIR, GROUND = "#eef1f5", "#c4c8ce"
PALETTE = cividis(SHADES)
SMALL, LARGE = PALETTE[0], PALETTE[-1]
BAND = 0.05  # of the window's height that the feed should seem to be thick
WALL = 0.015  # of the window's width
NICE = (1, 2, 5, 10, 20, 50, 100)
PAINTED = "requestAnimationFrame(() => requestAnimationFrame(() => { told.tags = cb_obj.tags }))"
PATIENCE = 1.0  # s


class Window:
    """The x and z [cm] that both pictures show."""

    def __init__(self) -> None:
        self.x, self.z = Range1d(start=0.0, end=1.0), Range1d(start=0.0, end=1.0)
        self.wall = self.height = 1.0

    def fit(self, piles: list[Poured]) -> None:
        """As wide and as high as the larger of these piles."""
        self.wall = max(edges(pile.course.x)[1] for pile in piles)
        self.x.end = (1.0 + WALL) * self.wall
        self.height = 1.12 * max(float(pile.archive["height"].max()) for pile in piles)
        self.z.end = self.height

    def exaggeration(self, pile: Poured) -> int:
        """How many times as thick as it is what rolls is drawn."""
        wanted = BAND * self.height / total_inflow(pile.archive)
        return max((factor for factor in NICE if factor <= wanted), default=1)


class Pile:
    """The picture of one model's pile."""

    def __init__(self, window: Window, name: str) -> None:
        self.window = window
        self.figure = figure(
            x_range=window.x,
            y_range=window.z,
            sizing_mode="stretch_both",
            tools="",
            toolbar_location=None,
            x_axis_label="x (cm)",
            y_axis_label="z (cm)",
            background_fill_color=AIR,
            name=name,
        )
        self._image = ColumnDataSource({"image": [], "dw": [], "dh": []})
        self._flow = ColumnDataSource({name: [] for name in ("x", "top", "air", "small", "all")})
        self._base = ColumnDataSource({"x": [], "z": []})
        self._wall = ColumnDataSource({"x": [], "z": []})
        self._kinks, self._fronts = (ColumnDataSource({"x": [], "z": []}) for _ in range(2))
        self._draw()
        self._sent = -math.inf
        told = CustomJS(args={"told": self.figure.y_scale}, code=PAINTED)
        self.figure.x_scale.js_on_change("tags", told)
        self.exaggeration = 1

    def _draw(self) -> None:
        plot = self.figure
        shades = LinearColorMapper(
            palette=PALETTE, low=0, high=SHADES - 1, high_color="rgba(0,0,0,0)"
        )
        deposit = Image(image="image", x=0, y=0, dw="dw", dh="dh", color_mapper=shades)
        plot.add_glyph(self._image, deposit)
        plot.varea("x", y1=0, y2="z", color=GROUND, source=self._base)
        plot.varea("x", y1="all", y2="air", color=AIR, source=self._flow)
        plot.varea("x", y1="top", y2="all", color=LARGE, source=self._flow)
        plot.varea("x", y1="top", y2="small", color=SMALL, source=self._flow)
        plot.line("x", "all", color="#555555", line_width=1, source=self._flow)
        plot.varea("x", y1=0, y2="z", color=GROUND, source=self._wall)
        for lines, source, marker in (
            (FRONT, self._fronts, "circle"),
            (KINK, self._kinks, "triangle"),
        ):
            plot.scatter(
                "x",
                "z",
                size=15,
                marker=marker,
                color=lines["color"],
                line_color="white",
                line_width=1.5,
                source=source,
            )
        plot.grid.visible = False
        plot.outline_line_color = None
        for axis in plot.axis:
            axis.axis_label_text_font_size = axis.major_label_text_font_size = "15px"
            axis.axis_label_text_font_style = "normal"
            axis.minor_tick_line_color = None

    def ready(self, now: float) -> bool:
        """Whether the browser has painted what it was sent, at the time `now` [s] on the wall.

        A slow one is not sent more pictures than it can paint; one that is not looked at, few.
        """
        painted = self.figure.y_scale.tags == self.figure.x_scale.tags
        return painted or now - self._sent > PATIENCE

    def show(self, pile: Poured) -> None:
        """Have the deposit of another pour."""
        archive = pile.archive
        width, top = edges(pile.course.x)[1], edges(values_of(archive, "z"))[1]
        self._image.data = {"image": [image_of(pile)], "dw": [width], "dh": [top]}
        self._base.data = _to_the_edges(pile, z=values_of(archive, "base_height"))
        self._wall.data = {"x": [width, 2 * width], "z": [2 * self.window.height] * 2}
        self.exaggeration = self.window.exaggeration(pile)

    def show_at(self, pile: Poured, moment: Moment, now: float) -> None:
        """Show an instant of the pour, at the time `now` [s] on the wall."""
        small = moment.height + self.exaggeration * moment.rolling[:, 0]
        everything = moment.height + self.exaggeration * moment.rolling.sum(axis=1)
        air = np.full_like(small, 2 * self.window.height)
        self._flow.data = _to_the_edges(
            pile, top=moment.height, air=air, small=small, all=everything
        )
        for source, places in ((self._kinks, moment.kinks), (self._fronts, moment.fronts)):
            source.data = {"x": places[:, 0], "z": places[:, 1]}
        self._sent = now
        self.figure.x_scale.tags = [now]


def image_of(pile: Poured) -> NDArray[np.uint8]:
    """Coarseness (row, column) of a deposit in SHADES, NOTHING where nothing lies."""
    archive = pile.archive
    coarse = coarseness(archive["deposit_fraction"], archive).transpose("z", "x").values
    shade = np.rint((SHADES - 1) * averaged(coarse, (min(len(coarse), ROWS), coarse.shape[1])))
    return np.where(np.isfinite(shade), shade, NOTHING).astype(np.uint8)


def _to_the_edges(pile: Poured, **values: Floats) -> dict[str, Floats]:
    """Columns (x,) that reach from the edge of the slope to behind the wall."""
    x = pile.course.x
    left, right = edges(x)
    reaching = {name: np.concatenate([v[:1], v, v[-1:]]) for name, v in values.items()}
    return {"x": np.concatenate([[left], x, [2 * right]])} | reaching
