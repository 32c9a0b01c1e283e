"""The picture of what was seen in a photograph."""

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from compare.pictures.style import KINK, edges, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_photograph"]


def draw_photograph(found: xr.Dataset) -> "Figure":
    """What :func:`compare.photograph.measure_photograph` saw, to check it by eye.

    The upright picture, and the coarseness that was found in it with the wavelength drawn to scale.
    """
    from matplotlib.figure import Figure

    coarse = found["coarseness"]
    extent = (*edges(coarse["x"].values), *edges(coarse["z"].values))
    with style():
        figure = Figure(figsize=(10.4, 4.8))
        left, right = figure.subplots(1, 2, sharex=True, sharey=True)
        left.imshow(found["picture"].values, extent=extent)
        image = right.imshow(coarse.values, extent=extent, vmin=0, vmax=1)
        figure.colorbar(image, ax=right, label="coarseness (0 small, 1 large)")
        for axes, title in ((left, "picture"), (right, "deposit")):
            axes.set(xlabel="x (cm)", ylabel="z (cm)", title=title, aspect="equal")
        _draw_wavelength(right, found)
        figure.suptitle(found.attrs["title"], parse_math=False)
    return figure


def _draw_wavelength(axes: "Axes", found: xr.Dataset) -> None:
    """Ticks one wavelength apart, up the middle of the deposit."""
    wavelength = float(found["wavelength"])
    middle = found["coarseness"].isel(x=found.sizes["x"] // 2).dropna("z")
    if not np.isfinite(wavelength):
        return
    ticks = np.arange(float(middle["z"][0]), float(middle["z"][-1]), wavelength)
    label = f"wavelength {wavelength:.3g} cm"
    axes.plot(
        np.full(len(ticks), float(middle["x"])), ticks, "_-", markersize=14, **KINK, label=label
    )
    axes.legend(loc="upper right", frameon=True)
