"""Pictures of archives: the deposit, and the kymograph of rolling grains with its lines."""

from collections.abc import Sequence
from contextlib import AbstractContextManager
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from compare.accessor import Strata
from compare.quantities import coarseness, settled_since, total_inflow, why_not_measured
from experiment.archive.files import whole_file
from experiment.arrays import Floats
from experiment.errors import ArchiveError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

__all__ = ["draw", "draw_deposit", "draw_kymograph", "draw_photograph", "save", "style"]

KINK: dict[str, Any] = {"color": "#d55e00", "linewidth": 1.6}
FRONT: dict[str, Any] = {"color": "#0072b2", "linewidth": 1.6}
SETTLED: dict[str, Any] = {"color": "0.4", "linestyle": ":"}
PALE = 1.8  # how far the grey scale reaches beyond the flow, so that lines stand out on it
MODEL_NAMES = {"ca_model": "lattice", "continuum": "continuum"}


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


def style() -> AbstractContextManager[None]:
    """Within it, pictures are drawn in the style of this house."""
    import matplotlib

    return matplotlib.rc_context(fname=str(files(__package__) / "stratify.mplstyle"))


def draw_deposit(axes: "Axes", archive: xr.Dataset) -> None:
    """The deposit, small grains dark and large ones bright; before pouring: grey.

    A drum, into which nothing is poured, is drawn as the round thing that it is.
    """
    x, z = archive["x"].values, archive["z"].values
    coarse = coarseness(archive["deposit_fraction"], archive).values
    top = float(archive["height"].isel(time=-1).max())
    image = axes.imshow(coarse, extent=(*_edges(x), *_edges(z)), vmin=0, vmax=1, rasterized=True)
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
        extent=(*_edges(archive["x"].values), *_edges(time)),
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


def draw_photograph(found: xr.Dataset) -> "Figure":
    """What :func:`compare.photograph.measure_photograph` saw, to check it by eye.

    The upright picture, and the coarseness that was found in it with the wavelength drawn to scale.
    """
    from matplotlib.figure import Figure

    coarse = found["coarseness"]
    extent = (*_edges(coarse["x"].values), *_edges(coarse["z"].values))
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


def _draw_lines(axes: "Axes", archive: xr.Dataset) -> None:
    strata: Strata = archive.strata
    for lines, style in ((strata.fronts(), FRONT), (strata.kinks(), KINK)):
        for passage in lines["passage"]:
            axes.plot(lines["x"], passage, **style)
    axes.axhline(settled_since(archive), **SETTLED)


def _edges(middles: Floats) -> tuple[float, float]:
    """Lower edge of the first and upper edge of the last of evenly spaced cells."""
    half = (middles[1] - middles[0]) / 2
    return float(middles[0] - half), float(middles[-1] + half)


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


def save(figure: "Figure", path: Path, *, force: bool = False) -> Path:
    """Write a picture whole or not at all, in the format that the name tells."""
    formats = figure.canvas.get_supported_filetypes()
    if path.suffix.removeprefix(".") not in formats:
        endings = ", ".join(f".{name}" for name in sorted(formats))
        raise ArchiveError(f"{str(path)!r} cannot be written: it should end in one of {endings}")
    with whole_file(path, force=force) as part:
        figure.savefig(part)
    return path
