"""Generalised angles of repose against the composition of the surface: Makse, Fig. `angles`.

    theta_1(phi_2) = m phi_2 + theta_11        theta_2(phi_2) = m phi_2 + theta_21
    psi = theta_1 - theta_2,   delta = theta_22 - theta_11,   m = delta + psi

Makse, PRE 56, 7008 (1997), Eq. (dependence), drawn from theta_a(phi) = sum_b theta_ab phi_b of the
continuum's law. "Dependence of the generalized angle of repose for the two types of rolling grains
on the concentration of the surface of large grains phi_2 for a, delta > 0, and b, delta < 0." The
caption gives no numbers: these are those of section V.

A is a surface of small grains near the middle of the pile, at theta = theta_11. A patch of large
grains caught there lies at the same angle: at B, below theta_22, where more large grains are
caught, or at C, above theta_22, where they roll on. The text does not say whether B and C are
those states or the angle theta_22 that they are held against; here they are the states.
"""

from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from compare.pictures.paper.look import LARGE, SMALL, letter, page
from compare.pictures.style import style
from compare.quantities import named
from continuum import law_of
from continuum.theory.collisions import generalised_repose_slope
from experiment import load
from experiment.arrays import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["PRESETS", "draw_repose_angles", "repose_angles"]

PRESETS = ("makse-stratification", "makse-segregation")  # delta > 0, delta < 0
MARGIN = 0.15, 0.35  # of slope, below and above the lines
MIDDLE = 0.52  # phi_2 where words stand
ARROW: dict[str, Any] = {"shrinkA": 0, "shrinkB": 0, "color": "0.3"}
SAID: dict[str, Any] = {"ha": "center", "va": "center", "color": "0.3", "fontsize": "small"}


def repose_angles(points: int = 101) -> xr.Dataset:
    """theta_a (mixture, species, phi_2) of the two mixtures of section V, as tangents.

    Beside it theta_ab (mixture, species, surface_species), delta, psi and m (mixture,).
    """
    phi_2 = np.linspace(0.0, 1.0, points)
    mixtures = [load(preset).mixture for preset in PRESETS]
    lines = [
        generalised_repose_slope(np.stack([1.0 - phi_2, phi_2]), law_of(mixture))
        for mixture in mixtures
    ]
    psi = np.array([mixture.psi for mixture in mixtures])
    delta = np.array([mixture.delta for mixture in mixtures])
    over = ("mixture", "species")
    matrices = np.array([mixture.repose_slope for mixture in mixtures])
    return xr.Dataset(
        {
            "generalised_repose_slope": (
                (*over, "phi_2"),
                np.stack(lines),
                named("generalised repose slope theta_a(phi_2) of rolling a"),
            ),
            "repose_slope": (
                (*over, "surface_species"),
                matrices,
                named("repose slope theta_ab of rolling a on b"),
            ),
            "delta": ("mixture", delta, named("delta = theta_22 - theta_11")),
            "psi": ("mixture", psi, named("psi = theta_11 - theta_21")),
            "m": ("mixture", delta + psi, named("m = theta_22 - theta_21")),
        },
        coords={
            "phi_2": ("phi_2", phi_2, named("surface fraction of large grains")),
            "mixture_name": ("mixture", list(PRESETS), named("preset", "")),
            "species_name": ("species", ["small", "large"], named("rolling species", "")),
        },
        attrs={"title": "Generalised angles of repose"},
    )


def draw_repose_angles(found: xr.Dataset) -> "Figure":
    """Draw theta_1 and theta_2 against phi_2, for delta > 0 and delta < 0 side by side."""
    slopes = found["repose_slope"].values
    heights = slopes.min() - MARGIN[0], slopes.max() + MARGIN[1]
    with style():
        figure = page(3.6)
        panels = figure.subplots(1, 2)
        for axes, k in zip(panels, found["mixture"].values, strict=True):
            _draw_lines(axes, found.isel(mixture=k), heights)
            _draw_states(axes, slopes[k])
            axes.set_xlabel(r"surface fraction of large grains, $\phi_2$")
        panels[0].set_ylabel(r"angle of repose, $\theta$ (tangent)")
        letter(panels, (rf"$\delta = {delta:+g}$" for delta in found["delta"].values))
        panels[0].legend(loc="upper left")
    return figure


def _draw_lines(axes: "Axes", found: xr.Dataset, heights: tuple[float, float]) -> None:
    phi_2, theta = found["phi_2"].values, found["repose_slope"].values
    small, large = found["generalised_repose_slope"].values
    axes.fill_between(phi_2, heights[0], large, color="0.86", linewidth=0)
    axes.fill_between(phi_2, large, small, color="0.94", linewidth=0)
    axes.plot(phi_2, small, linewidth=1.8, label=r"$\theta_1$, rolling small grains", **SMALL)
    axes.plot(phi_2, large, linewidth=1.8, label=r"$\theta_2$, rolling large grains", **LARGE)
    axes.text(0.72, heights[0] + 0.12, "both are caught", **SAID)
    around = (float(np.interp(MIDDLE, phi_2, line)) for line in (small, large))
    axes.text(MIDDLE, _room(theta[0, 0], *around), "small ones\nare caught", **SAID)
    axes.set(xlim=(0, 1), ylim=heights)
    fifth = len(phi_2) // 5
    ends = (phi_2[fifth], small[fifth]), (phi_2[fifth], large[fifth])
    axes.annotate("", ends[0], xytext=ends[1], arrowprops={"arrowstyle": "<->", **ARROW})
    axes.text(phi_2[fifth] - 0.05, np.mean(ends, axis=0)[1] - 0.06, r"$\psi$", **SAID)
    names = [[rf"$\theta_{{{a}{b}}} = {theta[a - 1, b - 1]:g}$" for a in (1, 2)] for b in (1, 2)]
    axes.set_yticks(theta[:, 0], names[0])
    axes.secondary_yaxis("right").set_yticks(theta[:, 1], names[1])


def _room(angle: float, above: float, below: float) -> float:
    """The middle of the wider one of the two gaps that `angle` leaves between the lines."""
    return (angle + (above if above - angle > angle - below else below)) / 2


def _draw_states(axes: "Axes", theta: Floats) -> None:
    """A, and the patch of large grains at the same angle: B where it is fed, C where it fades."""
    angle = theta[0, 0]
    patch = "B" if angle < theta[1, 1] else "C"
    axes.annotate(
        "",
        (0.97, angle),
        xytext=(0.0, angle),
        arrowprops={"arrowstyle": "->", "linestyle": "--", **ARROW},
    )
    for x, name, place in ((0.0, "A", (9, 7)), (1.0, patch, (-9, 7))):
        axes.plot([x], [angle], "o", color="black", markersize=4.5, clip_on=False, zorder=5)
        axes.annotate(name, (x, angle), xytext=place, textcoords="offset points", weight="bold")
