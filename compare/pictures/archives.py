"""Pictures of archives: the deposit, and the kymograph of rolling grains with its lines."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from compare.accessor import Strata
from compare.pictures.style import FRONT, KINK, MODEL_NAMES, SETTLED, edges, style
from compare.quantities import coarseness, settled_since, total_inflow, why_not_measured

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

__all__ = ["draw", "draw_deposit", "draw_kymograph"]

PALE = 1.8  # how far the grey scale reaches beyond the flow, so that lines stand out on it


def draw(archives: Sequence[xr.Dataset]) -> "Figure":
    """One column for each archive: its deposit above, its kymograph below."""
    from matplotlib.figure import Figure

    with style():
        figure = Figure(figsize=(5.2 * len(archives), 7.2))
        axes = figure.subplots(2, len(archives), squeeze=False)
        for column, archive in zip(axes.T, archives, strict=True):
            draw_deposit(column[0], archive)
            draw_kymograph(column[1], archive)
        figure.suptitle(archives[0].attrs["title"], parse_math=False)
        if any(why_not_measured(archive) is None for archive in archives):
            figure.legend(handles=_line_styles(), loc="outside lower center", ncols=3)
    return figure


def draw_deposit(axes: "Axes", archive: xr.Dataset) -> None:
    """The deposit, small grains dark and large ones bright; before pouring: grey.

    A drum, into which nothing is poured, is drawn as the round thing that it is.
    """
    x, z = archive["x"].values, archive["z"].values
    coarse = coarseness(archive["deposit_fraction"], archive).values
    top = float(archive["height"].isel(time=-1).max())
    image = axes.imshow(coarse, extent=(*edges(x), *edges(z)), vmin=0, vmax=1, rasterized=True)
    if why_not_measured(archive) is None:
        axes.fill_between(x, archive["base_height"].values, color="0.85", linewidth=0)
    else:
        axes.set_aspect("equal")
    axes.set_ylim(0, 1.05 * top)
    axes.set(
        xlabel="x (cm)", ylabel="z (cm)", title=f"{MODEL_NAMES[archive.attrs['model']]}: deposit"
    )
    axes.figure.colorbar(image, ax=axes, label=_coarseness_label(archive))


def draw_kymograph(axes: "Axes", archive: xr.Dataset) -> None:
    """Rolling thickness in place and time, with the fronts and kinks that were found."""
    thickness = archive["rolling_thickness"].sum("species").values
    time = archive["time"].values
    image = axes.imshow(
        thickness,
        extent=(*edges(archive["x"].values), *edges(time)),
        cmap="Greys",
        vmin=0,
        vmax=PALE * float(np.quantile(thickness, 0.995)) or total_inflow(archive),
        rasterized=True,
    )
    if why_not_measured(archive) is None:
        _draw_lines(axes, archive)
    axes.set(
        xlabel="x (cm)",
        ylabel="t (s)",
        title=f"{MODEL_NAMES[archive.attrs['model']]}: rolling grains",
    )
    axes.figure.colorbar(image, ax=axes, label="R (cm)")


def _draw_lines(axes: "Axes", archive: xr.Dataset) -> None:
    strata: Strata = archive.strata
    for lines, drawn in ((strata.fronts(), FRONT), (strata.kinks(), KINK)):
        for passage in lines["passage"]:
            axes.plot(lines["x"], passage, **drawn)
    axes.axhline(settled_since(archive), **SETTLED)


def _coarseness_label(archive: xr.Dataset) -> str:
    diameters = np.unique(archive["grain_diameter"])
    if archive.sizes["species"] == len(diameters) == 2:
        return "fraction of large grains"
    return "coarseness (0 smallest, 1 largest)"


def _line_styles() -> list["Line2D"]:
    """Legend of the lines in the kymographs."""
    from matplotlib.lines import Line2D

    named = {"avalanche front": FRONT, "kink": KINK, "measured from here on": SETTLED}
    return [Line2D([], [], label=label, **style) for label, style in named.items()]
