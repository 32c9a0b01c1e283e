"""The frames of a film: a pour at instants, of which only what changes is drawn anew.

A frame hides of the deposit what is above the pile of its instant, and draws what rolls there: a
band for each species, small grains at the bottom, as percolation has them.
"""

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from compare.pictures.moment import Course, Moment
from compare.pictures.stage import FEED, FRONT_MARK, GAP, KINK_MARK, LARGE, RIGHT, Pixels, set_stage
from compare.pictures.style import style
from compare.quantities import values_of
from experiment.archive import experiment_of
from experiment.arrays import Floats, Ints

if TYPE_CHECKING:
    from matplotlib.artist import Artist

__all__ = ["Frames"]

BEYOND = 0.01  # of the length outside of the axes, so that nothing ends on their edge


class Frames:
    """The frames of an archive's film, of `size` (width, height) pixels, both even.

    Raises :class:`NotApplicableError` for a drum.
    """

    def __init__(self, archive: xr.Dataset, most: Pixels) -> None:
        self.course = Course(archive)
        self._source = experiment_of(archive).feed.source
        with style():
            self.stage = set_stage(archive, self.course, most)
            self._draw_what_moves(np.argsort(values_of(archive, "grain_diameter"), kind="stable"))
            self._canvas = self.stage.canvas
            self._canvas.draw()
        self.size = Pixels(*self._canvas.get_width_height())
        self._background = self._canvas.copy_from_bbox(self._canvas.figure.bbox)

    def at(self, time: float) -> memoryview:
        """The frame of a time [s], RGBA (height, width, 4); the next one takes its place."""
        self.show(self.course.at(time))
        self._canvas.restore_region(self._background)
        for artist in self._moving:
            self.stage.axes.draw_artist(artist)
        frame: memoryview = self._canvas.buffer_rgba()
        return frame

    def show(self, moment: Moment) -> None:
        """Put what moves to where it is at this moment."""
        left, right = self.stage.ends
        beyond = BEYOND * (right - left)
        x = np.array([left - beyond, *self.course.x, right + beyond])
        layers = self.stage.magnified * np.cumsum(moment.rolling[:, self._order], axis=1)
        surface = np.pad(moment.height, 1, "edge")
        levels = [surface, *(surface + np.pad(layer, 1, "edge") for layer in layers.T)]
        self.sky.set_xy(_between(x, surface, np.full(len(x), self.stage.top)))
        for band, lower, upper in zip(self.bands, levels[:-1], levels[1:], strict=True):
            band.set_xy(_between(x, lower, upper))
        self._surface.set_data(x, np.where(levels[-1] > surface, surface, np.nan))
        self._rim.set_data(x, levels[-1])
        self.kinks.set_data(*moment.kinks.T)
        self.fronts.set_data(*moment.fronts.T)
        if self._source is not None:
            [spout] = self._source.position(np.array([moment.time]))
            self._stream.set_data([spout, spout], [np.interp(spout, x, levels[-1]), self.stage.top])
        self._clock.set_text(f"t = {moment.time:.{self._decimals}f} s")

    def _draw_what_moves(self, order: Ints) -> None:
        """What each frame draws, from the back to the front."""
        from matplotlib.markers import CARETDOWN

        axes, canvas = self.stage.axes, self.stage.canvas
        width, height = canvas.get_width_height()
        self._order = order
        self._decimals = max(0, round(3 - float(np.log10(self.course.records[-1]))))
        colours = ["w", *self.stage.colours[order]]
        self.sky, *self.bands = (axes.fill([0], [0], color=c, linewidth=0)[0] for c in colours)
        [self._stream] = axes.plot([], [], **FEED)
        [self._surface] = axes.plot([], [], color="w", linewidth=1.2)
        [self._rim] = axes.plot([], [], color="0.25", linewidth=0.8)
        [self.fronts] = axes.plot([], [], **FRONT_MARK)
        [self.kinks] = axes.plot([], [], **KINK_MARK | {"marker": CARETDOWN})
        place = 1.0 - RIGHT / width, 1.0 - GAP / height
        self._clock = canvas.figure.text(*place, "", ha="right", va="top", fontsize=LARGE)
        self._moving: list[Artist] = [
            self.sky,
            *self.bands,
            self._stream,
            self._surface,
            self._rim,
            *(axes.spines[side] for side in ("left", "bottom")),
            self.fronts,
            self.kinks,
            self._clock,
        ]
        for artist in self._moving:
            artist.set_animated(True)


def _between(x: Floats, lower: Floats, upper: Floats) -> Floats:
    """The polygon (vertex, 2) between two lines over x."""
    return np.column_stack([np.append(x, x[::-1]), np.append(lower, upper[::-1])])
