"""The limit of small grains, drawn: how lattice and continuum part as grains become coarse."""

from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from compare.convergence import QUANTITIES
from compare.pictures.paper.look import THIN, letter, page
from compare.pictures.style import BLUE, GREEN, ORANGE, VERMILION, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

__all__ = ["draw_limit"]

SYMBOLS = (r"$\lambda$ (cm)", r"$v_k$ (cm/s)", r"$v_f$ (cm/s)")
BY_WIDTH = ((VERMILION, "s"), (BLUE, "o"), (GREEN, "^"), (ORANGE, "D"))
BARS: dict[str, Any] = {"linestyle": "", "markersize": 4.0, "capsize": 2.0, "elinewidth": 1.0}


def draw_limit(found: xr.Dataset) -> "Figure":
    """Deposits; a column for each quantity with means and errors over n; below, what grains add.

    In the middle, a dashed line is the continuum on the grid of that width, a grey band what it
    tends to as dx -> 0. At the bottom, lattice - continuum - c and the law A (8 / n)^p.
    """
    with style():
        figure = page(7.2)
        top, bottom = figure.subfigures(2, 1, squeeze=False, height_ratios=[1.0, 3.2])[:, 0]
        _draw_deposits(top, found)
        above, below = bottom.subplots(2, len(QUANTITIES), sharex=True)
        for k, name in enumerate(QUANTITIES):
            for width, look in zip(found["width"].values, BY_WIDTH, strict=False):
                there = found.sel(width=width)
                _draw_means(above[k], there, name, look)
                if np.isfinite(there[f"{name}_exponent"]):
                    _draw_law(below[k], there, name, look)
            value, error = (found[f"{name}_extrapolated{e}"].item() for e in ("", "_error"))
            above[k].axhspan(value - error, value + error, color="0.85", zorder=0)
            n = found["fineness"].values[::2]
            below[k].set_xscale("log")
            below[k].set_xticks(n, map(str, n))
            below[k].set_xticks([], minor=True)
            below[k].set(yscale="log", xlabel="n, grains in the layer")
        letter([*above, *below], [*SYMBOLS, *(f"{symbol} of grains" for symbol in SYMBOLS)])
        bottom.legend(
            *above[0].get_legend_handles_labels(),
            loc="outside lower center",
            ncols=found.sizes["width"],
        )
    return figure


def _draw_deposits(figure: "SubFigure", found: xr.Dataset) -> None:
    panels = figure.subplots(1, found.sizes["example"])
    for axes, name, picture in zip(
        panels, found["example_name"].values, found["deposit"].values, strict=True
    ):
        axes.imshow(picture, vmin=0, vmax=1, rasterized=True)
        axes.set(title=name, xticks=[], yticks=[])


def _draw_means(axes: "Axes", there: xr.Dataset, name: str, look: tuple[str, str]) -> None:
    colour, marker = look
    axes.errorbar(
        there["fineness"],
        there[name],
        there[f"{name}_error"],
        color=colour,
        marker=marker,
        label=f"w = {there['width'].item():g} cm",
        **BARS,
    )
    axes.axhline(there[f"{name}_continuum"].item(), **(THIN | {"color": colour}))


def _draw_law(axes: "Axes", there: xr.Dataset, name: str, look: tuple[str, str]) -> None:
    colour, marker = look
    amplitude, exponent, remainder = (
        there[f"{name}_{part}"].item() for part in ("amplitude", "exponent", "remainder")
    )
    added = (there[name] - there[f"{name}_continuum"] - remainder) * np.sign(amplitude)
    error = np.hypot(there[f"{name}_error"], there[f"{name}_continuum_error"])
    axes.errorbar(there["fineness"], added, error, color=colour, marker=marker, **BARS)
    n = np.array([there["least"].item(), there["fineness"].max()])
    axes.plot(
        n,
        abs(amplitude) * (there["amplitude_at"].item() / n) ** exponent,
        color=colour,
        linewidth=1.0,
    )
