"""The steady state of a silo: Makse, Fig. `profiles`, beside what the solver finds.

    R = R0 (L - x) / L;  above x_m phi_1 = 1;  below, with r = v / (gamma psi),
    R_1 / R = 1 / (1 + C exp((x - x_m) / r)),    dh/dx = -theta

Makse, PRE 56, 7008 (1997), section III. "Steady-state solution (simple-up)-(simple-down) for the
two-species granular flow in a silo geometry. L = 30 cm, tan theta_11 = 0.6, tan theta_22 = 0.5,
tan psi = 0.2, tan m = 0.1, tan delta = -0.1, R0 = 0.25 cm, v = 10 cm/sec, gamma = 20/sec, and
gamma_21 = 10/sec. a, Profiles of the rolling species. b, Profile of the concentrations. c, Profile
of the sandpile." Beside c stands its slope, d.

The caption names the simplified solution, which is off by O(r / L): phi_1 by a factor of two at
25 cm, and theta jumps at x_m. So the full one of :mod:`continuum.theory.steady_state` is drawn, the
simplified one thin beside it, and the last record of a pour of preset `makse-profile`.
"""

from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from scipy.integrate import cumulative_simpson

import continuum
from compare.pictures.paper.look import LARGE, SMALL, THIN, letter, page
from compare.pictures.style import style
from compare.quantities import named
from continuum.theory import SimplifiedSteadyState, SteadyState, steady_state_of
from experiment import load
from experiment.arrays import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

__all__ = ["draw_profiles", "profiles"]

PRESET = "makse-profile"
STEP = 0.01  # cm, between the places of the closed forms
TO_THE_WALL = 0.1  # cm; at it the slope of the closed form falls without bound
EVERY = 12  # of the solver's cells is marked
MARKS: dict[str, Any] = {"linestyle": "", "marker": "o", "markersize": 3.2, "fillstyle": "none"}
BLACK: dict[str, Any] = {"color": "black"}
BESIDE: dict[str, Any] = {"xytext": (3, 0), "textcoords": "offset points", "color": "0.4"}
SLOPES = 0.25, 0.53
NAMES = {
    "rolling_thickness": named("rolling thickness R_a", "cm"),
    "surface_fraction": named("volume fraction phi_a at the surface"),
    "height": named("height of the pile from that at the pouring point", "cm"),
    "slope": named("slope theta of the pile"),
}
LABELS = {
    "rolling_thickness": "rolling thickness (cm)",
    "surface_fraction": r"fraction at the surface, $\phi_a$",
    "height": "height from the pouring point (cm)",
    "slope": r"slope, $\theta$ (tangent)",
}

Variable = tuple[tuple[str, ...], Floats, dict[str, str]]


def profiles() -> xr.Dataset:
    """The full and the simplified closed form over x, and the solver's last record over cell.

    rolling_thickness and surface_fraction (solution, x, species), slope and height (solution, x),
    the height from that at the pouring point; with `solved_` before it, the same of the solver:
    rolling grains and the slope at the cells' lower edges, the others in their middles.
    """
    setup = load(PRESET)
    full = steady_state_of(setup)
    x = np.arange(0.0, full.length - TO_THE_WALL, STEP)
    closed = [_closed(state, x) for state in (full, SimplifiedSteadyState.of(full))]
    over = {"rolling_thickness": ("species",), "surface_fraction": ("species",)}
    variables = {
        name: (("solution", "x", *over.get(name, ())), np.stack([f[name] for f in closed]), said)
        for name, said in NAMES.items()
    }
    names = ["full", "simplified"]
    return xr.Dataset(
        variables | _solved(continuum.pour(setup).isel(time=-1)),
        coords={
            "x": ("x", x, named("distance downhill from the pouring point", "cm")),
            "solution_name": ("solution", names, named("closed form of section III", "")),
            "species_name": ("species", ["small", "large"], named("species", "")),
        },
        attrs={"title": "Steady state of a silo", "middle_cm": full.middle},
    )


def _closed(state: SteadyState, x: Floats) -> dict[str, Floats]:
    slope = state.slope(x)
    return {
        "rolling_thickness": state.rolling_thickness(x),
        "surface_fraction": state.surface_fraction(x),
        "slope": slope,
        "height": -cumulative_simpson(slope, x=x, initial=0.0),
    }


def _solved(last: xr.Dataset) -> dict[str, Variable]:
    """What the solver found, under names of its own."""
    x, height = last["x"].values, last["height"].values
    dx = x[1] - x[0]
    slope = np.append(-np.diff(height) / dx, np.nan)
    at_the_feed = height[0] + slope[0] * dx / 2
    found = {
        "rolling_thickness": last["rolling_thickness"].values,
        "surface_fraction": last["surface_fraction"].values,
        "slope": slope,
        "height": height - at_the_feed,
    }
    variables = {
        f"solved_{name}": (("cell", "species")[: values.ndim], values, NAMES[name])
        for name, values in found.items()
    }
    said = {"cell_middle": x, "cell_edge": x + dx / 2}
    return variables | {
        name: (("cell",), values, named(f"{name.replace('_', ' ')}, downhill", "cm"))
        for name, values in said.items()
    }


def draw_profiles(found: xr.Dataset) -> "Figure":
    """Rolling grains, composition, pile and slope: closed forms as lines, the solver as circles."""
    with style():
        figure = page(5.2)
        panels = figure.subplots(2, 2, sharex=True).ravel()
        for axes, (name, label) in zip(panels, LABELS.items(), strict=True):
            _draw(axes, found, name)
            axes.axvline(found.attrs["middle_cm"], color="0.75", linewidth=0.8, zorder=0)
            axes.set_ylabel(label)
        panels[0].set(xlim=(0, 30), ylim=(0, None))
        panels[3].set_ylim(SLOPES)
        for axes in panels[2:]:
            axes.set_xlabel("x (cm)")
        letter(panels, ("rolling grains", "composition", "pile", "slope of the pile"))
        panels[0].annotate("$x_m$", (found.attrs["middle_cm"], 0.13), **BESIDE)
        figure.legend(handles=_legend(), loc="outside lower center", ncols=5)
    return figure


def _draw(axes: "Axes", found: xr.Dataset, name: str) -> None:
    full, simplified = found[name].values
    solved = found[f"solved_{name}"].values
    x = found["x"].values
    cells = found["cell_middle" if name in {"surface_fraction", "height"} else "cell_edge"].values
    marked = slice(EVERY // 2, None, EVERY)
    for k, shade in enumerate((SMALL, LARGE) if full.ndim > 1 else (BLACK,)):
        of = (..., k) if full.ndim > 1 else ...
        axes.plot(x, simplified[of], **THIN, **shade)
        axes.plot(x, full[of], linewidth=1.6, **shade)
        axes.plot(cells[marked], solved[of][marked], **MARKS, **shade)


def _legend() -> list["Line2D"]:
    from matplotlib.lines import Line2D

    kinds: dict[str, dict[str, Any]] = {
        "small grains": {"linewidth": 1.6, **SMALL},
        "large grains": {"linewidth": 1.6, **LARGE},
        "full solution": {"linewidth": 1.6, **BLACK},
        "simplified": THIN | BLACK,
        "solver, 300 cells": MARKS | BLACK,
    }
    return [Line2D([], [], label=label, **kind) for label, kind in kinds.items()]
