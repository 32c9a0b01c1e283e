"""Pictures of phase diagrams: regimes, theory's boundaries, and small deposits at chosen points."""

from collections.abc import Mapping
from itertools import combinations
from string import ascii_lowercase
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from compare.phase.axes import DRAW
from compare.phase.patterns import PATTERNS, patterns
from compare.phase.theory import ONSET, pure_slopes
from compare.pictures.style import (
    BLUE,
    GREEN,
    LIGHT_BLUE,
    LIGHT_YELLOW,
    MODEL_NAMES,
    ORANGE,
    VERMILION,
    style,
)
from experiment.arrays import Floats, Ints

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

    Legend = dict[str, Artist]  # by label

__all__ = ["COLOURS", "draw_phase"]

SHADES = (BLUE, GREEN, LIGHT_BLUE, ORANGE, LIGHT_YELLOW, "0.75", "white")
COLOURS = dict(zip(PATTERNS, SHADES, strict=True))
ORDER: dict[str, dict[str, Any]] = {
    "layering": {"color": BLUE},
    "layered_share": {"color": GREEN, "linestyle": "--"},
    "segregation": {"color": VERMILION, "linestyle": "-."},
}
EQUAL_SLOPES: dict[str, Any] = {"color": "black", "linestyle": "--", "linewidth": 1.4}
GROWTH: dict[str, Any] = {"color": "black", "marker": "o", "markersize": 3, "linewidth": 1.4}
BARS: dict[str, Any] = {"color": "black", "marker": "o", "markersize": 3, "linestyle": ""}
MARK: dict[str, Any] = {"boxstyle": "circle,pad=0.2", "facecolor": "white", "linewidth": 0.6}
SAID_OF_PICTURES = "deposits let down to a level floor, source on their left; large grains bright"
ACROSS = 4  # pictures
BESIDE = (9, 9)  # points, the letter of a draw, so as not to hide it
NARROWEST = 6.6  # inches, for two columns of the legend
FEW = 1.5  # decades, within which more is labelled than the powers of ten
EVEN = 1e-6  # relative difference of ratios that are equal


def draw_phase(diagram: xr.Dataset) -> "Figure":
    """A column for each model: the regimes over what varies, and deposits below, if there are any.

    Over two fields a map; over draws, points in the first two fields; over one field, the
    parameters of order, wavelength and kink velocity. Of more axes than two, the others are in
    their middle.
    """
    from matplotlib.figure import Figure

    plane = _plane(diagram)
    models = plane["model_name"].values.tolist()
    most = max(len(_pictures(plane, model)) for model in models)
    rows = -(-most // ACROSS)
    with style():
        figure = Figure(figsize=(max(5.2 * len(models), NARROWEST), 4.8 + 1.3 * rows))
        legend: Legend = {}
        columns = figure.subfigures(1, len(models), squeeze=False)[0]
        for column, model in zip(columns, models, strict=True):
            legend |= _draw_model(column, plane, model, rows)
        figure.suptitle(plane.attrs["title"], parse_math=False)
        across = min(len(models) + 1, 3)
        figure.legend(list(legend.values()), list(legend), loc="outside lower center", ncols=across)
    return figure


def _plane(diagram: xr.Dataset) -> xr.Dataset:
    """The part of a diagram that is drawn: two axes at the most, numbers in their order."""
    fields = _fields(diagram)
    middle = {dim: diagram.sizes[dim] // 2 for dim in _dims(diagram)[2:]}
    said = [
        f", {diagram[dim].attrs['field']} = {diagram[dim].values[k]:g}"
        for dim, k in middle.items()
        if dim in diagram.coords
    ]
    plane = _with_places(diagram, fields, middle).isel(middle)
    ordered = [name for name in fields if _is_of_numbers(plane[name].values)]
    plane = plane.sortby(ordered).assign_attrs(title="".join([diagram.attrs["title"], *said]))
    if len(fields) < 2 or DRAW in _dims(plane):
        return plane
    sizes = [plane.sizes[dim] for dim in _dims(plane)]
    return plane.assign(
        pure_slope=([*_dims(plane), "grain"], pure_slopes(plane).reshape(*sizes, -1))
    )


def _with_places(diagram: xr.Dataset, fields: list[str], middle: Mapping[str, int]) -> xr.Dataset:
    """The diagram with those pictures that are in its `middle`, and where they are in `fields`."""
    if "picture_point" not in diagram:
        return diagram
    dims = _dims(diagram)
    places = np.unravel_index(diagram["picture_point"].values, [diagram.sizes[dim] for dim in dims])
    at = dict(zip(dims, places, strict=True))
    inside = np.all([at[dim] == k for dim, k in middle.items()], axis=0) if middle else True
    along = {name: at[str(diagram[name].dims[0])] for name in fields}
    where = {
        f"picture_{axis}": ("picture", _numbers(diagram, name)[along[name]])
        for axis, name in zip("xy", fields, strict=False)
    }
    shown = np.flatnonzero(np.broadcast_to(inside, diagram.sizes["picture"]))
    return diagram.assign(where).isel(picture=shown)


def _draw_model(column: "SubFigure", plane: xr.Dataset, model: str, rows: int) -> "Legend":
    """Draw one model's column; the entries that it adds to the legend."""
    of_model = plane.sel(model_name=model)
    heights = [4.2, 1.3 * rows] if rows else [1.0]
    parts = column.subfigures(len(heights), 1, squeeze=False, height_ratios=heights)[:, 0]
    fields = _fields(plane)
    if len(fields) == 1:
        axes = parts[0].subplots(3, 1, sharex=True)
        legend = _draw_curves(axes, of_model, fields[0])
        letters_on = axes[0]
    else:
        letters_on = parts[0].subplots()
        legend = _draw_map(letters_on, of_model, fields)
    letters_on.set_title(MODEL_NAMES[model])
    if rows:
        _draw_pictures(parts[1], letters_on, plane, model, rows)
    return legend


def _draw_map(axes: "Axes", of_model: xr.Dataset, fields: list[str]) -> "Legend":
    """Regimes over two fields, with theory's boundaries where these are on a grid."""
    from matplotlib.colors import ListedColormap

    regime = _regimes(of_model)
    how: dict[str, Any] = {
        "cmap": ListedColormap(list(COLOURS.values())),
        "vmin": -0.5,
        "vmax": len(COLOURS) - 0.5,
    }
    _label(axes.xaxis, of_model, fields[0])
    _label(axes.yaxis, of_model, fields[1])
    x, y = (_numbers(of_model, name) for name in fields)
    if DRAW in of_model["regime"].dims:
        x, y = (_everywhere(of_model, name) for name in fields)
        axes.scatter(x, y, c=regime.ravel(), edgecolors="0.3", linewidths=0.4, **how)
        return _patches(regime)
    axes.pcolormesh(_edges(x), _edges(y), regime.T, rasterized=True, **how)
    return _patches(regime) | _draw_theory(axes, of_model, fields)


def _draw_theory(axes: "Axes", of_model: xr.Dataset, fields: list[str]) -> "Legend":
    from matplotlib.lines import Line2D

    legend: Legend = {}
    x, y = (_numbers(of_model, name) for name in fields)
    slopes = of_model["pure_slope"].values
    for a, b in combinations(range(slopes.shape[-1]), 2):
        difference = slopes[..., b] - slopes[..., a]
        if (difference < 0).any() and (difference > 0).any():
            lines = {f"{key}s": value for key, value in EQUAL_SLOPES.items()}
            axes.contour(x, y, difference.T, [0.0], **lines)
            legend["equal repose slopes (delta = 0)"] = Line2D([], [], **EQUAL_SLOPES)
    if ONSET in of_model:
        onset = of_model[ONSET].values
        known = np.isfinite(onset)
        axes.plot(onset[known], y[known], **GROWTH)
        legend["onset of growth in the spectrum (continuum)"] = Line2D([], [], **GROWTH)
    return legend


def _draw_curves(rows: Any, of_model: xr.Dataset, field: str) -> "Legend":
    """What is measured over one field, before the colours of the regimes."""
    x = _numbers(of_model, field)
    order, wavelength, kinks = rows
    regime = _regimes(of_model)
    edges = _edges(x)
    for axes in rows:
        for kind, low, high in zip(regime, edges, edges[1:], strict=False):
            axes.axvspan(low, high, color=list(COLOURS.values())[kind], alpha=0.35, linewidth=0)
    legend = _patches(regime, alpha=0.35)
    for name, line in ORDER.items():
        (legend[name.replace("_", " ")],) = order.plot(x, of_model[name], **line)
    for axes, name in ((wavelength, "wavelength"), (kinks, "kink_velocity")):
        axes.errorbar(x, of_model[name], of_model[f"{name}_error"], **BARS)
    order.set_ylabel("order")
    wavelength.set_ylabel("wavelength (cm)")
    kinks.set_ylabel("kink velocity (cm/s)")
    _label(kinks.xaxis, of_model, field)
    return legend


def _draw_pictures(
    part: "SubFigure", axes: "Axes", plane: xr.Dataset, model: str, rows: int
) -> None:
    """The deposits of a model, each with a letter that stands at its point, too."""
    frames = np.ravel(part.subplots(rows, ACROSS, squeeze=False))
    for frame in frames:
        frame.set_axis_off()
    part.supxlabel(SAID_OF_PICTURES, fontsize="small")
    over_two = "picture_y" in plane
    for frame, letter, k in zip(frames, ascii_lowercase, _pictures(plane, model), strict=False):
        picture = plane.isel(picture=k)
        frame.imshow(picture["deposit"], vmin=0, vmax=1)
        frame.set_title(letter, fontsize="small", pad=2)
        axes.annotate(
            letter,
            (float(picture["picture_x"]), float(picture["picture_y"]) if over_two else 0.92),
            xycoords="data" if over_two else axes.get_xaxis_transform(),
            xytext=BESIDE if DRAW in _dims(plane) else (0, 0),
            textcoords="offset points",
            bbox=MARK,
            ha="center",
            va="center",
            fontsize="x-small",
        )


def _fields(plane: xr.Dataset) -> list[str]:
    """The coordinates, at most two, over which a plane is drawn."""
    names = [str(name) for name, there in plane.coords.items() if "field" in there.attrs]
    there = [name for dim in _dims(plane) for name in names if plane[name].dims == (dim,)]
    return there[:2]


def _dims(plane: xr.Dataset) -> list[str]:
    """Those over which something varies."""
    return [str(dim) for dim in plane["regime"].dims if dim != "model"]


def _pictures(plane: xr.Dataset, model: str) -> list[int]:
    """The numbers of the pictures that are of a model, as many as there are letters."""
    if "picture_model" not in plane:
        return []
    number = plane["model_name"].values.tolist().index(model)
    mine = np.flatnonzero(plane["picture_model"].values == number)
    return [int(k) for k in mine[: len(ascii_lowercase)]]


def _numbers(plane: xr.Dataset, field: str) -> Floats:
    """The values of a coordinate; of one that is in words, their places."""
    values = plane[field].values
    numbers: Floats = (values if _is_of_numbers(values) else np.arange(len(values))) * 1.0
    return numbers


def _everywhere(of_model: xr.Dataset, field: str) -> Floats:
    """The values of a coordinate at each point (point,), the last axis fastest."""
    regime = of_model["regime"]
    values = xr.DataArray(_numbers(of_model, field), dims=of_model[field].dims)
    return values.broadcast_like(regime).transpose(*regime.dims).values.ravel()


def _regimes(of_model: xr.Dataset) -> Ints:
    """The places of the patterns in COLOURS."""
    words = patterns(of_model)
    return np.array([PATTERNS.index(word) for word in words.values.flat]).reshape(words.shape)


def _patches(regime: Ints, alpha: float = 1.0) -> "Legend":
    """Entries of the legend for the regimes that are there."""
    from matplotlib.patches import Patch

    return {
        name: Patch(facecolor=colour, edgecolor="0.5", alpha=alpha)
        for k, (name, colour) in enumerate(COLOURS.items())
        if (regime == k).any()
    }


def _label(axis: Any, plane: xr.Dataset, field: str) -> None:
    """Say what the axis is of; logarithmic for values of one ratio, words where it is of words."""
    from matplotlib.ticker import NullFormatter, StrMethodFormatter

    units = plane[field].attrs.get("units", "1")
    axis.set_label_text(plane[field].attrs["field"] + (f" ({units})" if units != "1" else ""))
    values = plane[field].values
    if not _is_of_numbers(values):
        axis.set_ticks(np.arange(len(values)), values.tolist())
    elif _is_geometric(values):
        axis.axes.set(**{f"{axis.axis_name}scale": "log"})
        plain = StrMethodFormatter("{x:g}")
        axis.set_major_formatter(plain)
        is_short = values[-1] < 10**FEW * values[0]
        axis.set_minor_formatter(plain if is_short else NullFormatter())


def _is_of_numbers(values: NDArray[Any]) -> bool:
    return values.dtype.kind in "fi"


def _is_geometric(x: Floats) -> bool:
    if len(x) < 3 or (x <= 0).any():
        return False
    steps, ratios = np.diff(x), np.diff(np.log(x))
    return bool(np.ptp(ratios) < EVEN * abs(ratios[0]) and np.ptp(steps) > EVEN * abs(steps[0]))


def _edges(x: Floats) -> Floats:
    """The edges between values that grow, half-way, and beyond the first and the last."""
    if _is_geometric(x):
        edges: Floats = np.exp(_edges(np.log(x)))
    elif len(x) == 1:
        edges = np.array([x[0] - 0.5, x[0] + 0.5])
    else:
        between = (x[1:] + x[:-1]) / 2
        edges = np.array([2 * x[0] - between[0], *between, 2 * x[-1] - between[-1]])
    return edges
