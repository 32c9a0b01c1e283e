"""Capture, amplification and cross-amplification against the angle: Makse, Fig. `functions`.

    b_a = gamma_aa P(theta_a - theta)      capture of rolling a
    a_a = gamma_aa P(theta - theta_a)      amplification of static a by rolling a
    x_a = gamma_ab P(theta - theta_a)      amplification of static b by rolling a

Makse, PRE 56, 7008 (1997), Eq. (canonical2). "Schematic plot of capture, amplification and
cross-amplification functions used in the definition of the present model. These functions are
expected to be continuous in a region near the angle of repose (as shown by the thin curves)."

P(z) = max(z, 0), and with `smoothing` w the thin curves, P(z) = (z + sqrt(z^2 + w^2)) / 2. Drawn
from the continuum's collision functions. The caption gives no numbers: the rates and slopes are
those of the figure of profiles, on a surface of equal shares; w = psi / 4, so that the functions
of the two species hardly meet where they bend, as the caption says of unlike sizes.
"""

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from compare.pictures.paper.look import THIN, letter, page
from compare.pictures.style import GREEN, PURPLE, style
from compare.quantities import named
from continuum import Law, law_of
from continuum.theory.collisions import amplification, capture, generalised_repose_slope
from experiment import load
from experiment.arrays import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["collision_functions", "draw_collision_functions"]

PRESET = "makse-profile"
BEND = 0.25  # psi, the width over which the thin curves bend
SHARE = 0.5  # of either species at the surface
FUNCTIONS = {  # symbol, colour and meaning
    "capture": ("b", "black", "capture b_a of rolling a"),
    "amplification": ("a", GREEN, "amplification a_a of static a by rolling a"),
    "cross_amplification": (
        "x",
        PURPLE,
        "cross-amplification x_a of the other species by rolling a",
    ),
}


def collision_functions(points: int = 201) -> xr.Dataset:
    """b_a, a_a and x_a (form, species, theta) [1/s]; form is sharp or smooth.

    The slopes go from psi below theta_2 to psi above theta_1. Beside them theta_a (species,) at
    this composition, and smoothing (form,).
    """
    mixture = load(PRESET).mixture
    law = law_of(mixture)
    surface = np.full((mixture.species, points), SHARE)
    repose = generalised_repose_slope(surface, law)[:, 0]
    slope = np.linspace(repose.min() - mixture.psi, repose.max() + mixture.psi, points)
    widths = (0.0, BEND * mixture.psi)
    forms = [_functions(surface, slope, law._replace(smoothing=width)) for width in widths]
    over = ("form", "species", "theta")
    return xr.Dataset(
        {
            name: (over, np.stack([form[k] for form in forms]), named(meaning, "s-1"))
            for k, (name, (_, _, meaning)) in enumerate(FUNCTIONS.items())
        }
        | {
            "generalised_repose_slope": ("species", repose, named("theta_a at this composition")),
            "smoothing": ("form", np.array(widths), named("width over which P bends")),
        },
        coords={
            "theta": ("theta", slope, named("slope of the pile")),
            "species_name": ("species", ["small", "large"], named("rolling species", "")),
            "form_name": ("form", ["sharp", "smooth"], named("form of the functions", "")),
        },
        attrs={"title": "Collision functions"},
    )


def _functions(surface: Floats, slope: Floats, law: Law) -> tuple[Floats, Floats, Floats]:
    """b_a, a_a, x_a (species, theta) of two species."""
    amplified = amplification(surface, slope, law)  # (static, rolling, theta)
    direct = np.stack([amplified[0, 0], amplified[1, 1]])
    cross = np.stack([amplified[1, 0], amplified[0, 1]])
    return capture(surface, slope, law), direct, cross


def draw_collision_functions(found: xr.Dataset) -> "Figure":
    """Draw the functions of either species against theta: sharp ones thick, smooth ones thin."""
    with style():
        figure = page(3.2)
        panels = figure.subplots(1, 2, sharex=True, sharey=True)
        for axes, k in zip(panels, found["species"].values, strict=True):
            _draw(axes, found.isel(species=k), int(k) + 1)
        panels[0].set_ylabel("rate (1/s)")
        letter(panels, ("small grains roll", "large grains roll"))
    return figure


def _draw(axes: "Axes", found: xr.Dataset, species: int) -> None:
    theta, repose = found["theta"].values, float(found["generalised_repose_slope"])
    for name, (symbol, colour, _) in FUNCTIONS.items():
        sharp, smooth = found[name].values
        label = rf"${symbol}_{species}$, {name.replace('_', '-')}"
        axes.plot(theta, sharp, color=colour, linewidth=2.0, label=label)
        axes.plot(theta, smooth, color=colour, **THIN)
    axes.plot([], [], color="0.4", **THIN, label=f"smoothing {float(found['smoothing'][1]):g}")
    axes.axvline(repose, ymax=0.55, color="0.7", linewidth=0.8, zorder=0)
    across = axes.get_xaxis_transform()
    axes.text(repose, 0.56, rf"$\theta_{species}$", transform=across, ha="center")
    axes.set(xlabel=r"slope of the pile, $\theta$ (tangent)", xlim=(theta[0], theta[-1]))
    axes.set_ylim(bottom=0)
    axes.legend(loc="upper center")
