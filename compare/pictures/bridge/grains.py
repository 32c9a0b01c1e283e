"""Real grains, drawn: deposits, and how irregular they are by the volume of a grain."""

from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from compare.pictures.paper.look import letter, page
from compare.pictures.style import BLUE, GREEN, VERMILION, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_grains"]

SHOWN = ("continuum, dx = w", "true", "row, d x d", "slab, 10 d x d")
PANELS = "aaabbbcccddd;eeeeffffgggg"
TOP = 12.0  # cm of the deposits that are shown
MEAN = "continuum, dx = w"
BARS: dict[str, Any] = {"linestyle": "", "markersize": 4.0, "capsize": 2.0, "elinewidth": 0.8}
COLOURS = {"layer_scatter": BLUE, "kink_scatter": VERMILION}
QUANTILES = 0.05, 0.95


def draw_grains(found: xr.Dataset) -> "Figure":
    """Above deposits, let down; below scatter and means against V, and single piles."""
    with style():
        figure = page(6.6)
        panels = figure.subplot_mosaic(PANELS, height_ratios=(1, 1.25))
        deposits = [panels[name] for name in "abcd"]
        for axes, size in zip(deposits, SHOWN, strict=True):
            if size in found["size"].values:
                _draw_deposit(axes, found.sel(size=size))
        deposits[0].set_ylabel("z (cm)")
        _draw_scatter(panels["e"], found)
        _draw_means(panels["f"], found)
        _draw_piles(panels["g"], found)
        titles = *SHOWN, "scatter of layers, kinks", "means over continuum's", "single piles"
        letter(panels.values(), titles)
    return figure


def _draw_deposit(axes: "Axes", size: xr.Dataset) -> None:
    top = size["deposit_height"].item()
    extent = (0, 30, 0, top)
    axes.imshow(size["deposit"], extent=extent, vmin=0, vmax=1, interpolation="nearest")
    highest = top * float(np.isfinite(size["deposit"].values).all(axis=1).mean())
    axes.set(xlabel="x (cm)", ylim=(highest - TOP, highest))


def _draw_scatter(axes: "Axes", found: xr.Dataset) -> None:
    there = found.isel(size=(found["volume"] > 0).values)
    volume = np.array([there["volume"].values.min(), there["volume"].sel(size="true").item()])
    for name, colour in COLOURS.items():
        label = name.removesuffix("_scatter") + "s"
        bars = BARS | {"color": colour, "marker": "o", "label": label}
        axes.errorbar(there["volume"], there[name], there[f"{name}_error"], **bars)
        c, p = found[f"{name}_coefficient"].item(), found[f"{name}_exponent"].item()
        axes.plot(volume, c * (volume / volume[1]) ** p, color=colour, linewidth=1.0)
    axes.axvline(volume[1], color="0.8", linewidth=0.8, zorder=0)
    axes.set(xscale="log", yscale="log", xlabel="V (cm²)", ylabel="scatter / mean")
    axes.legend(loc="lower right")


def _draw_means(axes: "Axes", found: xr.Dataset) -> None:
    there = found.isel(size=(found["volume"] > 0).values)
    for name, colour, label in (
        ("wavelength", BLUE, "wavelength"),
        ("kink_velocity", VERMILION, "kink velocity"),
        ("front_velocity", GREEN, "front velocity"),
    ):
        mean = found[name].sel(size=MEAN).item()
        bars = BARS | {"color": colour, "marker": "o", "label": label}
        axes.errorbar(there["volume"], there[name] / mean, there[f"{name}_error"] / mean, **bars)
    axes.axhline(1.0, color="0.8", linewidth=0.8, zorder=0)
    axes.axvline(found["volume"].sel(size="true").item(), color="0.8", linewidth=0.8, zorder=0)
    axes.set(xscale="log", xlabel="V (cm²)", ylim=(0, 2.8))
    axes.legend(loc="upper left")


def _draw_piles(axes: "Axes", found: xr.Dataset) -> None:
    low, high = (found.sel(quantile=q) for q in QUANTILES)
    axes.fill_betweenx(
        [low["kink_velocity_drawn"].item(), high["kink_velocity_drawn"].item()],
        low["wavelength_drawn"].item(),
        high["wavelength_drawn"].item(),
        color="0.9",
        label="uncertain inputs",
    )
    for size, colour in (("true", VERMILION), ("row, d x d", BLUE)):
        if size in found["size"].values:
            piles = found.sel(size=size)
            axes.plot(
                piles["wavelength_pile"], piles["kink_velocity_pile"], ".", color=colour, label=size
            )
    mean = found.sel(size=MEAN)
    axes.plot(mean["wavelength"], mean["kink_velocity"], "*", color="0.2", label="continuum")
    axes.set(xlabel="wavelength (cm)", ylabel="kink velocity (cm/s)")
    axes.set_ylim(bottom=0)
    axes.legend(loc="lower left")
