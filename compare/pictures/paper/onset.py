"""How stratification and segregation begin: Makse, Fig. `onset`, from pours.

"Schematic process leading to a, stratification (delta > 0), and b, segregation (delta < 0)"; Makse,
PRE 56, 7008 (1997), section IV: segregation comes first, then large grains are caught on the small
ones of the upper slope. For delta > 0 that patch grows: it climbs, a first kink, of large grains
only; newly arriving grains roll over it to the bottom, and from there a kink of both species
climbs, small grains beneath large ones. For delta < 0 the patch fades, and segregation stays.

Drawn are pours of the continuum with the numbers of section V, alike but for delta. The paper gives
neither the slope before pouring nor d. Here it is so flat, theta_21 < theta < theta_11, that large
grains roll down first and come to rest at its foot; and d = 0.5 cm, with which no waves are left
where the species meet for delta < 0. Heights are those above the slope before pouring.
"""

from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

import continuum
from compare.accessor import Strata
from compare.pictures.moment import Course
from compare.pictures.paper.look import LARGE, SMALL, letter, page
from compare.pictures.style import edges, style
from compare.quantities import coarseness, named
from experiment import Experiment, load

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

__all__ = ["PRESETS", "draw_onset", "onset"]

PRESETS = ("makse-stratification", "makse-segregation")  # delta > 0, delta < 0
ALIKE = {"cell.start_slope": 0.75, "mixture.surface_depth": 0.5, "pour.records": 800}
WATCHED = 1600.0  # s, for kinks
STAGES = {  # s, and what is seen for delta > 0 and for delta < 0
    180.0: ("large grains come to rest at the foot", "large grains come to rest at the foot"),
    260.0: ("they climb on small ones: a first kink", "a patch of them lies on small ones"),
    400.0: ("grains that arrive now roll over it", "the patch climbs no higher"),
    710.0: ("a kink of both species climbs", "small ones cover it: it recedes"),
    1480.0: ("each kink lays a pair of layers", "segregation stays"),
}
HEIGHTS = np.arange(0.05, 33.0, 0.1)  # cm
THICKER = 2.0  # times, rolling grains are drawn
SAID: dict[str, Any] = {"ha": "right", "va": "top", "fontsize": "small"}
POINTING: dict[str, Any] = {"arrowprops": {"arrowstyle": "->"}, "fontsize": "small"}


def onset() -> xr.Dataset:
    """Both pours at some instants, and the kinks that are found in all of each.

    coarseness (mixture, time, z, x) of the deposit, z from the slope before pouring, NaN above the
    pile; its height (mixture, time, x) [cm]; rolling_thickness (mixture, time, x, species) [cm];
    kink (mixture, time) [cm], where one climbs, else NaN; kink_count and kink_velocity (mixture,)
    [cm/s], their mean, negative uphill.
    """
    found = xr.concat([_course(load(preset).with_values(ALIKE)) for preset in PRESETS], "mixture")
    delta = np.array([load(preset).mixture.delta for preset in PRESETS])
    return found.assign_coords(
        delta=("mixture", delta, named("delta = theta_22 - theta_11")),
        mixture_name=("mixture", list(PRESETS), named("preset", "")),
        species_name=("species", ["small", "large"], named("species", "")),
    ).assign_attrs(title="Onset of stratification and of segregation")


def _course(setup: Experiment) -> xr.Dataset:
    """The instants of a pour, each poured anew, so that nothing seen then was taken up later."""
    shorter = [setup.with_values({"pour.duration": t, "pour.records": 2}) for t in STAGES]
    instants = xr.concat([_end(continuum.pour(pour)) for pour in shorter], "time")
    whole = continuum.pour(setup.with_values({"pour.duration": WATCHED}))
    strata: Strata = whole.strata
    velocity = strata.kinks()["velocity"].values
    course = Course(whole)
    places = [course.at(time).kinks[:, 0] for time in STAGES]
    highest = [x.min() if len(x) else np.nan for x in places]
    mean = velocity.mean() if len(velocity) else np.nan
    return instants.assign(
        kink=("time", highest, named("where a kink climbs", "cm")),
        kink_count=((), len(velocity), named("number of kinks that are found")),
        kink_velocity=((), mean, named("mean velocity of the kinks, downhill", "cm s-1")),
    )


def _end(archive: xr.Dataset) -> xr.Dataset:
    """What there is at the end of a pour, heights from the slope before it."""
    last = archive.isel(time=-1)
    base, z = last["base_height"].values, last["z"].values
    deposit = coarseness(last["deposit_fraction"], last).transpose("z", "x").values
    height = last["height"].values - base
    bins = np.rint((HEIGHTS[:, None] + base - z[0]) / (z[1] - z[0])).astype(int)
    there = np.take_along_axis(deposit, bins.clip(max=len(z) - 1), axis=0)
    coarse = np.where(HEIGHTS[:, None] < height, there, np.nan)
    from_base = named("height above the slope before pouring", "cm")
    return xr.Dataset(
        {
            "coarseness": (("z", "x"), coarse, named("fraction of large grains in the deposit")),
            "height": ("x", height, from_base),
            "rolling_thickness": last["rolling_thickness"],
        },
        coords={"z": ("z", HEIGHTS, from_base)},
    )


def draw_onset(found: xr.Dataset) -> "Figure":
    """Draw the two mixtures in two columns, time downwards: the pile and what rolls on it."""
    with style():
        figure = page(6.6)
        panels = figure.subplots(len(STAGES), len(PRESETS), sharex=True, sharey=True)
        for row, (time, said) in zip(panels, STAGES.items(), strict=True):
            for k, axes in enumerate(row):
                _draw(axes, found.sel(time=time).isel(mixture=k))
                axes.text(0.99, 0.97, said[k], transform=axes.transAxes, **SAID)
            row[0].text(0.99, 0.79, f"t = {time:g} s", transform=row[0].transAxes, **SAID)
        letter(panels[0], (rf"$\delta = {delta:+g}$" for delta in found["delta"].values))
        for axes in panels[-1]:
            axes.set_xlabel("x (cm)")
        figure.supylabel("height above the slope before pouring (cm)", fontsize="medium")
        figure.legend(handles=_patches(), loc="outside lower center", ncols=4)
    return figure


def _draw(axes: "Axes", at: xr.Dataset) -> None:
    x, height = at["x"].values, at["height"].values
    extent = (*edges(x), *edges(at["z"].values))
    axes.imshow(at["coarseness"].values, extent=extent, vmin=0, vmax=1, rasterized=True)
    for thickness, shade in zip(at["rolling_thickness"].values.T, (SMALL, LARGE), strict=True):
        above = height + THICKER * thickness
        axes.fill_between(x, height, above, linewidth=0, **shade)
        height = above
    kink = float(at["kink"])
    if np.isfinite(kink):
        top = float(np.interp(kink, x, height))
        axes.annotate("kink", (kink, top + 0.5), xytext=(kink + 10, top + 3.5), **POINTING)
    axes.set(xlim=extent[:2], ylim=extent[2:])


def _patches() -> list["Patch"]:
    from matplotlib import colormaps, rcParams
    from matplotlib.patches import Patch

    small, large = colormaps[rcParams["image.cmap"]]([0.0, 1.0])
    meanings = {
        "small, at rest": small,
        "large, at rest": large,
        "small, rolling (twice as thick)": SMALL["color"],
        "large, rolling": LARGE["color"],
    }
    return [Patch(color=colour, label=name) for name, colour in meanings.items()]
