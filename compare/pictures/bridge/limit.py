"""The limit of small grains, drawn: wavelength and velocities against the height of a grain."""

from typing import TYPE_CHECKING

import xarray as xr

from compare.convergence import QUANTITIES
from compare.pictures.paper.look import page
from compare.pictures.style import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["draw_limit"]


def draw_limit(found: xr.Dataset) -> "Figure":
    """A panel for each quantity."""
    with style():
        figure = page(3.0)
        for axes, name in zip(figure.subplots(1, 3), QUANTITIES, strict=True):
            for width in found["width"].values:
                there = found.sel(width=width)
                axes.errorbar(1 / there["fineness"], there[name], there[f"{name}_error"])
            axes.set(xscale="log", xlabel="1 / n", ylabel=name)
    return figure
