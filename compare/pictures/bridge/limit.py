"""The limit of small grains, drawn: how lattice and continuum part as grains become coarse."""

from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from compare.bridge.limit import LEAST, ONE
from compare.convergence import QUANTITIES
from compare.pictures.paper.look import THIN, letter, page
from compare.pictures.style import BLUE, GREEN, ORANGE, VERMILION, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_limit"]

SYMBOLS = (r"$\lambda$ (cm)", r"$v_k$ (cm/s)", r"$v_f$ (cm/s)")
BY_WIDTH = ((VERMILION, "s"), (BLUE, "o"), (GREEN, "^"), (ORANGE, "D"))
BARS: dict[str, Any] = {"linestyle": "", "markersize": 4.0, "capsize": 2.0, "elinewidth": 1.0}


def draw_limit(found: xr.Dataset) -> "Figure":
    """A column for each quantity: means and errors over n above; below, less the continuum's.

    Above, a dashed line is the continuum on the grid of that width, a grey band what it tends to as
    dx -> 0. Below, curves are the laws; within a percent the scale is even, beyond it logarithmic.
    """
    with style():
        figure = page(5.4)
        above, below = figure.subplots(2, len(QUANTITIES), sharex=True)
        for k, name in enumerate(QUANTITIES):
            for width, look in zip(found["width"].values, BY_WIDTH, strict=False):
                there = found.sel(width=width)
                _draw_means(above[k], there, name, look)
                _draw_differences(below[k], there, name, look)
            value, error = (found[f"{name}_extrapolated{e}"].item() for e in ("", "_error"))
            above[k].axhspan(value - error, value + error, color="0.85", zorder=0)
            below[k].axhline(0.0, color="0.4", linewidth=0.8)
            below[k].set_yscale("symlog", linthresh=_fine(found, name), linscale=0.8)
            below[k].set_xlabel("n, grains that the layer is thick")
        letter([*above, *below], [*SYMBOLS, *(f"{symbol}, less continuum" for symbol in SYMBOLS)])
        figure.legend(
            *above[0].get_legend_handles_labels(),
            loc="outside lower center",
            ncols=found.sizes["width"],
        )
    return figure


def _draw_means(axes: "Axes", there: xr.Dataset, name: str, look: tuple[str, str]) -> None:
    colour, marker = look
    axes.errorbar(
        there["fineness"],
        there[name],
        there[f"{name}_error"],
        color=colour,
        marker=marker,
        label=f"columns of {there['width'].item():g} cm",
        **BARS,
    )
    axes.axhline(there[f"{name}_continuum"].item(), **(THIN | {"color": colour}))
    axes.set_xscale("log", base=2)


def _draw_differences(axes: "Axes", there: xr.Dataset, name: str, look: tuple[str, str]) -> None:
    colour, marker = look
    difference = there[name] - there[f"{name}_continuum"]
    error = np.hypot(there[f"{name}_error"], there[f"{name}_continuum_error"])
    axes.errorbar(there["fineness"], difference, error, color=colour, marker=marker, **BARS)
    amplitude, exponent, remainder = (
        there[f"{name}_{part}"].item() for part in ("amplitude", "exponent", "remainder")
    )
    n = np.geomspace(LEAST, there["fineness"].max(), 100)
    axes.plot(n, amplitude * (ONE[0] / n) ** exponent + remainder, color=colour, linewidth=1.0)


def _fine(found: xr.Dataset, name: str) -> float:
    """The scale below which differences are drawn on an even scale: a percent."""
    return 0.01 * float(found[f"{name}_extrapolated"].item())
