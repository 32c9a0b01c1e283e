"""Between the rules, drawn: the ladder, what its factors change, the path of sharper capture."""

from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from compare.convergence import QUANTITIES
from compare.pictures.paper.look import letter, page
from compare.pictures.style import BLUE, GREEN, MARKS, ORANGE, VERMILION, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_between"]

LABELS = ("wavelength (cm)", "kink velocity (cm/s)", "front velocity (cm/s)")
BARS: dict[str, Any] = {"linewidth": 1.0, "markersize": 3.5, "capsize": 2.0, "elinewidth": 0.8}
COLOURS = {"1 / k": VERMILION, "none": GREEN, "all": ORANGE}
RATIOS = (0.25, 0.5, 1, 2, 4)
WHEN = {"first": (BLUE, ">", 0.2), "mean": ("0.2", "o", 0.0), "last": (VERMILION, "<", -0.2)}


def draw_between(found: xr.Dataset) -> "Figure":
    """A column for each of QUANTITIES: along the ladder, by factor, and along the path."""
    with style():
        figure = page(8.4)
        rows = figure.subplots(3, len(QUANTITIES), height_ratios=(1.1, 0.9, 1.2))
        for column, name, label in zip(rows.T, QUANTITIES, LABELS, strict=True):
            _draw_ladder(column[0], found, name)
            _draw_effects(column[1], found, name)
            _draw_path(column[2], found, name)
            column[0].set_xlabel(label)
            column[1].set_xlabel("changed by a factor of")
            column[2].set(xlabel="k, or gamma (1/s)", ylabel=label)
        for axes in rows[:2, 1:].flat:
            axes.tick_params(labelleft=False)
        rows[1, 1].legend(loc="lower left")
        figure.legend(*rows[2, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
        titles = ("the ladder", "", "", "each change, by itself", "", "", "the path", "", "")
        letter(rows.flat, titles)
    return figure


def _draw_ladder(axes: "Axes", found: xr.Dataset, name: str) -> None:
    rungs = found["rung"].values
    places = np.arange(len(rungs))
    axes.axvline(found[name][-1].item(), color="0.8", linewidth=0.8, zorder=0)
    axes.errorbar(found[name], places, xerr=found[f"{name}_error"], fmt="o-", color="0.2", **BARS)
    axes.set_yticks(places, rungs)
    axes.invert_yaxis()
    axes.set_xlim(left=0)


def _draw_effects(axes: "Axes", found: xr.Dataset, name: str) -> None:
    factors = found["factor"].values
    places = np.arange(len(factors))
    axes.axvline(1, color="0.8", linewidth=0.8, zorder=0)
    for when, (colour, marker, shift) in WHEN.items():
        there = found.sel(when=when)
        ratio, error = 1 + there[f"effect_{name}"] / 100, there[f"effect_{name}_error"] / 100
        bars = BARS | {"color": colour, "fmt": marker, "label": when}
        axes.errorbar(ratio, places - shift, xerr=error, **bars)
    axes.set_yticks(places, factors)
    axes.set_ylim(len(factors) - 0.5, -0.5)
    axes.set_xscale("log")
    axes.set_xlim(0.18, 6.5)
    axes.set_xticks(RATIOS, map(str, RATIOS))
    axes.minorticks_off()


def _draw_path(axes: "Axes", found: xr.Dataset, name: str) -> None:
    end = found[name].sel(rung="threshold rule").item()
    axes.axhline(end, color="0.2", linestyle=":", label="threshold rule")
    for amplified, colour in COLOURS.items():
        there = found.sel(amplified=amplified)
        y, error = there[f"path_{name}"], there[f"path_{name}_error"]
        label = f"amplification: {amplified}"
        axes.errorbar(there["k"], y, error, fmt="s-", color=colour, label=label, **BARS)
    y, error = found[f"rate_{name}"], found[f"rate_{name}_error"]
    marks = BARS | {"color": MARKS["continuum"]["color"], "fmt": "o--"}
    axes.errorbar(found["gamma"], y, error, label="continuum, gamma", **marks)
    axes.set_xscale("log")
    axes.set_ylim(bottom=0)
