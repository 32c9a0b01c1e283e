"""What stays the same in a film: the deposit of the end, axes, title, and what colours stand for.

Lengths and heights have one scale, unless that makes the picture too flat or too steep.
"""

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr

from compare.pictures.moment import Course
from compare.pictures.style import FRONT, KINK, MODEL_NAMES, edges
from compare.quantities import coarseness, scaled_diameter, settled_since, values_of
from experiment.archive import experiment_of
from experiment.arrays import Floats

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.legend import Legend

__all__ = [
    "FEED",
    "FRONT_MARK",
    "GAP",
    "KINK_MARK",
    "LARGE",
    "RIGHT",
    "Pixels",
    "Stage",
    "set_stage",
]

DPI = 110
LARGE = 11  # points, of title and time
LEFT, RIGHT, BOTTOM, TITLE, GAP = 72, 20, 50, 40, 10  # pixels around axes and legend
CLOCK = 120  # pixels for the time
FLATTEST, STEEPEST = 4.2, 0.5  # width to height of the axes
NARROWEST = 0.8  # of the widest film
BAND = 0.045  # of the pile's length and height, which the rolling layer should be seen to take
MAGNIFIED = (1, 2, 3, 4, 5, 6, 8, 10, 15, 20)
BEFORE_POURING: dict[str, Any] = {"color": "0.85", "linewidth": 0}
FEED: dict[str, Any] = {"color": "0.5", "linewidth": 1.5}
MARK: dict[str, Any] = {"linestyle": "", "markersize": 9, "markeredgecolor": "w"}
KINK_MARK: dict[str, Any] = {"color": KINK["color"], "marker": "v"} | MARK
FRONT_MARK: dict[str, Any] = {"color": FRONT["color"], "marker": "o"} | MARK


class Pixels(NamedTuple):
    """Size of a picture."""

    width: int
    height: int


class Stage(NamedTuple):
    """Where a film plays."""

    canvas: "FigureCanvasAgg"
    axes: "Axes"
    colours: Floats  # (species, RGBA), those of the deposit
    ends: tuple[float, float]  # cm, from where to where there are columns
    top: float  # cm, of the axes
    magnified: int  # times that the rolling layer is drawn as thick as it is


def set_stage(archive: xr.Dataset, course: Course, most: Pixels) -> Stage:
    """Draw all that is drawn once, in a figure of at most so many pixels, and of an even number."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    canvas = FigureCanvasAgg(Figure(dpi=DPI))
    canvas.figure.set_layout_engine("none")
    axes = canvas.figure.add_axes((0.0, 0.0, 1.0, 1.0))
    magnified = _magnified(course)
    rolling = magnified * course.rolling.sum(axis=-1)
    top = 1.03 * float((course.height + rolling).max())
    ends = edges(course.x)
    colours = _draw_deposit(axes, archive)
    axes.set(xlim=ends, ylim=(0.0, top), xlabel="x (cm)", ylabel="z (cm)")
    stage = Stage(canvas, axes, colours, ends, top, magnified)
    _lay_out(stage, _meanings(stage, archive, course), most)
    _draw_title(stage, archive)
    return stage


def _magnified(course: Course) -> int:
    """So that the rolling layer is seen."""
    usual = float(np.quantile(course.rolling.sum(axis=-1), 0.99))
    extent = float(np.sqrt(np.ptp(course.x) * course.height.max()))
    wanted = BAND * extent / usual if usual > 0 else 1.0
    return max(factor for factor in MAGNIFIED if factor <= max(wanted, 1.0))


def _draw_deposit(axes: "Axes", archive: xr.Dataset) -> Floats:
    """The deposit of the end, continued to where nothing was poured; the species' colours."""
    x, z, base = (values_of(archive, name) for name in ("x", "z", "base_height"))
    coarse = coarseness(archive["deposit_fraction"], archive).transpose("z", "x").values
    image = axes.imshow(
        _continued(_continued(coarse)[::-1])[::-1],
        extent=(*edges(x), *edges(z)),
        vmin=0,
        vmax=1,
        interpolation="antialiased",
    )
    left, right = edges(x)
    axes.fill_between([left, *x, right], np.pad(base, 1, "edge"), **BEFORE_POURING)
    return np.asarray(image.cmap(scaled_diameter(archive)))


def _continued(values: Floats) -> Floats:
    """`values` (z, x), with gaps filled by what is before them along z."""
    last = np.where(np.isfinite(values), np.arange(len(values))[:, None], 0)
    return np.take_along_axis(values, np.maximum.accumulate(last), axis=0)


def _meanings(stage: Stage, archive: xr.Dataset, course: Course) -> "list[Artist]":
    """What the colours and the marks stand for."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    names, diameters = (values_of(archive, name) for name in ("species_name", "grain_diameter"))
    meanings: list[Artist] = [
        Patch(facecolor=colour, edgecolor="0.25", linewidth=0.8, label=f"{name}, {diameter:.2g} cm")
        for name, diameter, colour in zip(names, diameters, stage.colours, strict=True)
    ]
    if values_of(archive, "base_height").any():
        meanings.append(Patch(**BEFORE_POURING, label="before pouring"))
    since = f"(from {settled_since(archive):.0f} s on)"
    lines = (
        (course.has_kinks, "kink", KINK_MARK),
        (course.has_fronts, "avalanche front", FRONT_MARK),
    )
    meanings += [
        Line2D([], [], label=f"{name} {since}", **mark) for there, name, mark in lines if there
    ]
    if experiment_of(archive).feed.source is not None:
        meanings.append(Line2D([], [], label="feed", **FEED))
    if stage.magnified > 1:
        label = f"rolling layer: {stage.magnified} times as thick"
        meanings.append(Line2D([], [], linestyle="", label=label))
    return meanings


def _lay_out(stage: Stage, meanings: "list[Artist]", most: Pixels) -> None:
    """Give the axes the shape that the pile asks for, and the figure room for axes and legend."""
    from matplotlib.lines import Line2D

    natural = (stage.ends[1] - stage.ends[0]) / stage.top
    aspect = min(max(natural, STEEPEST), FLATTEST)
    if not np.isclose(natural, aspect, rtol=0.02):
        label = f"heights: {natural / aspect:.2g} times as high"
        meanings = [*meanings, Line2D([], [], linestyle="", label=label)]
    free = Pixels(most.width - LEFT - RIGHT, most.height - BOTTOM - TITLE - 5 * GAP)
    high = min(free.width / aspect, free.height)
    wide = high * aspect
    width = _even(max(wide + LEFT + RIGHT, NARROWEST * most.width))
    legend, taken = _draw_legend(stage.canvas, meanings, width)
    height = _even(BOTTOM + high + GAP + taken + TITLE)
    _resize(stage.canvas, width, height)
    left = LEFT + (width - LEFT - RIGHT - wide) / 2
    stage.axes.set_position((left / width, BOTTOM / height, wide / width, high / height))
    legend.set_bbox_to_anchor((LEFT / width, (height - TITLE) / height))


def _draw_legend(
    canvas: "FigureCanvasAgg", meanings: "list[Artist]", width: int
) -> "tuple[Legend, float]":
    """The legend, in as few rows as fit into `width` pixels, and how high [pixels] it is."""
    _resize(canvas, width, width)
    for columns in range(len(meanings), 0, -1):
        legend = canvas.figure.legend(
            handles=meanings,
            ncols=columns,
            loc="upper left",
            borderaxespad=0.0,
            borderpad=0.0,
            columnspacing=1.0,
            handlelength=1.4,
        )
        extent = legend.get_window_extent(canvas.get_renderer())
        if columns == 1 or extent.width <= width - LEFT - RIGHT:
            break
        legend.remove()
    return legend, extent.height


def _draw_title(stage: Stage, archive: xr.Dataset) -> None:
    """Title and model, upper left, leaving room for the time beside it."""
    width, height = stage.canvas.get_width_height()
    text = f"{archive.attrs['title']} ({MODEL_NAMES[archive.attrs['model']]})"
    place = LEFT / width, 1.0 - GAP / height
    title = stage.canvas.figure.text(*place, text, va="top", fontsize=LARGE, parse_math=False)
    taken = title.get_window_extent().width / (width - LEFT - RIGHT - CLOCK)
    title.set_fontsize(LARGE / max(taken, 1.0))


def _resize(canvas: "FigureCanvasAgg", width: int, height: int) -> None:
    """Make it so many pixels, round-off or not."""
    canvas.figure.set_size_inches((width + 0.01) / DPI, (height + 0.01) / DPI)


def _even(pixels: float) -> int:
    """An even number: films have colours for two by two pixels."""
    return 2 * round(pixels / 2)
