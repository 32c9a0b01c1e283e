"""Pictures of archives: the deposit, and the kymograph of rolling grains with its lines."""

from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from compare.kymograph import fronts, kinks
from compare.quantities import cell_length, coarseness, settled_since
from experiment.archive import refuse_existing
from experiment.errors import ArchiveError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw", "draw_deposit", "draw_kymograph", "save"]

KINK_COLOUR = "#d55e00"
FRONT_COLOUR = "#56b4e9"
MODEL_NAMES = {"ca_model": "lattice", "continuum": "continuum"}


def draw(archives: Sequence[xr.Dataset]) -> "Figure":
    """One column for each archive: its deposit above, its kymograph below."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(fname=str(files(__package__) / "stratify.mplstyle")):
        figure = Figure(figsize=(5.2 * len(archives), 7.2))
        axes = figure.subplots(2, len(archives), squeeze=False)
        for column, archive in zip(axes.T, archives, strict=True):
            draw_deposit(column[0], archive)
            draw_kymograph(column[1], archive)
        figure.suptitle(archives[0].attrs["title"])
    return figure


def draw_deposit(axes: "Axes", archive: xr.Dataset) -> None:
    """The deposit, small grains dark and large ones bright; before pouring: grey."""
    x, z = archive["x"].values, archive["z"].values
    coarse = coarseness(archive["deposit_fraction"], archive).values
    length = cell_length(archive)
    top = float(archive["height"].isel(time=-1).max())
    bottom = z[0] - (z[1] - z[0]) / 2
    image = axes.imshow(
        coarse, extent=(0, length, bottom, 2 * z[-1] - z[-2]), vmin=0, vmax=1, rasterized=True
    )
    axes.fill_between(x, archive["base_height"].values, color="0.85", linewidth=0)
    axes.set_ylim(0, 1.05 * top)
    axes.set(
        xlabel="x (cm)", ylabel="z (cm)", title=f"{MODEL_NAMES[archive.attrs['model']]}: deposit"
    )
    axes.figure.colorbar(image, ax=axes, label="fraction of large grains")


def draw_kymograph(axes: "Axes", archive: xr.Dataset) -> None:
    """Rolling thickness in place and time, with the fronts and kinks that were found."""
    thickness = archive["rolling_thickness"].sum("species").values
    time = archive["time"].values
    image = axes.imshow(
        thickness,
        extent=(0, cell_length(archive), time[0], time[-1]),
        cmap="Greys",
        vmin=0,
        vmax=float(np.quantile(thickness, 0.995)),
        rasterized=True,
    )
    for lines, colour, label in (
        (fronts(archive), FRONT_COLOUR, "front"),
        (kinks(archive), KINK_COLOUR, "kink"),
    ):
        for k in range(lines.sizes["event"]):
            axes.plot(
                lines["x"], lines["passage"][k], color=colour, label=label if k == 0 else None
            )
    axes.axhline(settled_since(archive), color="0.5", linestyle=":", label="settled from here")
    axes.set(
        xlabel="x (cm)",
        ylabel="t (s)",
        title=f"{MODEL_NAMES[archive.attrs['model']]}: rolling grains",
    )
    axes.legend(loc="upper right", framealpha=0.9, frameon=True)
    axes.figure.colorbar(image, ax=axes, label="R (cm)")


def save(figure: "Figure", path: Path, *, force: bool = False) -> Path:
    """Write a picture whole or not at all, in the format that the name tells."""
    refuse_existing([path], force=force)
    part = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        figure.savefig(part)
        part.replace(path)
    except (OSError, ValueError) as error:
        part.unlink(missing_ok=True)
        reason = getattr(error, "strerror", None) or error
        raise ArchiveError(f"{str(path)!r} cannot be written: {reason}") from None
    return path
