"""What every measurement takes from an archive: the pour's scales, and where and when to look."""

import math
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from experiment.archive import experiment_of
from experiment.arrays import Floats

__all__ = [
    "Quantity",
    "cell_height",
    "cell_length",
    "cell_width",
    "coarseness",
    "collision_rate",
    "flux",
    "measured_columns",
    "named",
    "quantity",
    "rise_velocity",
    "scaled_diameter",
    "settled_height",
    "settled_since",
    "settled_thickness",
    "slope_columns",
    "total_inflow",
    "values_of",
    "velocity",
    "why_not_measured",
]

Quantity = tuple[tuple[str, ...], Any, dict[str, str]]  # dims, value and attributes

TRANSIENT_SHARE = 1 / 3
EDGE_SHARE = 0.2
BARE = 0.1  # R0: what is laid thinner than this covers nothing


def values_of(archive: xr.Dataset, name: str) -> NDArray[Any]:
    """The array of a variable, without the coordinates that `archive[name]` looks up."""
    values: NDArray[Any] = archive.variables[name].values
    return values


def total_inflow(archive: xr.Dataset) -> float:
    """R0 = sum_a R_a^0 [cm]."""
    return float(values_of(archive, "inflow").sum())


def flux(archive: xr.Dataset) -> float:
    """sum_a v_a R_a^0 [cm2/s]: what is poured per time and unit gap."""
    return float((values_of(archive, "inflow") * values_of(archive, "drift_velocity")).sum())


def velocity(archive: xr.Dataset) -> float:
    """The drift velocity v [cm/s] of the grains, averaged over what is poured."""
    return flux(archive) / total_inflow(archive)


def collision_rate(archive: xr.Dataset) -> float:
    """The rate gamma = sum_a gamma_aa R_a^0 / R0 [1/s]; NaN where there are no collision rates."""
    if "collision_rate" not in archive:
        return math.nan
    direct = np.diagonal(values_of(archive, "collision_rate"))
    return float(direct @ values_of(archive, "inflow")) / total_inflow(archive)


def cell_width(archive: xr.Dataset) -> float:
    """Width [cm] of the evenly spaced cells or columns along x."""
    x = values_of(archive, "x")
    return float(x[1] - x[0])


def cell_length(archive: xr.Dataset) -> float:
    """L [cm], from the pouring point to the end on its right."""
    return float(values_of(archive, "x")[-1]) + cell_width(archive) / 2


def cell_height(archive: xr.Dataset) -> float:
    """Height [cm] of the evenly spaced cells of the deposit."""
    z = values_of(archive, "z")
    return float(z[1] - z[0])


def slope_columns(archive: xr.Dataset) -> slice:
    """The columns of the slope that is measured: that to the right of the source."""
    return slice(int(np.searchsorted(values_of(archive, "x"), 0.0, side="right")), None)


def why_not_measured(archive: xr.Dataset) -> str | None:
    """Why a pour has no kinks and layers of one flow down one slope; None if it has."""
    experiment = experiment_of(archive)
    if experiment.cell.shape == "drum":
        return "nothing is poured into a drum: kinks and layers are those of a pour"
    if experiment.feed.source is not None:
        return "its source moves: kinks and layers are those of a source at rest"
    return None


def rise_velocity(archive: xr.Dataset) -> float:
    """R0 v / L [cm/s]: how fast the settled pile grows on average.

    L is the length that grains cover, which in a heap grows, too; and what fell off an open end
    does not count.
    """
    settled = values_of(archive, "time") >= settled_since(archive)
    slope = slope_columns(archive)
    height = values_of(archive, "height")[settled, slope]
    laid = height - values_of(archive, "base_height")[slope] > BARE * total_inflow(archive)
    covered = laid.sum(axis=1).mean() * cell_width(archive)
    volumes = (values_of(archive, f"{name}_volume")[settled] for name in ("poured", "outflow"))
    poured, lost = (float((volume[-1] - volume[0]).sum()) for volume in volumes)
    kept = 1.0 - lost / poured if poured > 0 else 1.0
    return flux(archive) * kept / float(covered) if covered > 0 else 0.0


def settled_since(archive: xr.Dataset) -> float:
    """Time [s] from which on the pour counts as settled: after a third of it."""
    return float(values_of(archive, "time")[-1]) * TRANSIENT_SHARE


def settled_height(archive: xr.Dataset) -> Floats:
    """Height (x,) [cm] of the pile when the transient was over, between two records."""
    time, height = values_of(archive, "time"), values_of(archive, "height")
    since = settled_since(archive)
    k = int(np.searchsorted(time, since).clip(1))
    growth = (height[k] - height[k - 1]) / (time[k] - time[k - 1])
    settled: Floats = height[k - 1] + growth * (since - time[k - 1])
    return settled


def settled_thickness(archive: xr.Dataset) -> float:
    """Mean thickness [cm] of what was laid after the transient."""
    return float((values_of(archive, "height")[-1] - settled_height(archive)).mean())


def measured_columns(archive: xr.Dataset) -> NDArray[np.bool_]:
    """Which columns (x,) are measured: not the fifth of the slope at either end.

    Of a heap, the slope on the right.
    """
    x = values_of(archive, "x")
    length = cell_length(archive)
    return (x > EDGE_SHARE * length) & (x < (1 - EDGE_SHARE) * length)


def quantity(value: Any, units: str, long_name: str, *, dims: tuple[str, ...] = ()) -> Quantity:
    """A measured number, or an array over `dims`, as a Dataset takes it."""
    return dims, value, named(long_name, units)


def coarseness(fraction: xr.DataArray, archive: xr.Dataset) -> xr.DataArray:
    """Mean grain diameter of a composition, scaled from 0 (all smallest) to 1 (all largest).

    For two species it is the fraction of the large one; for grains of one size it is the fraction
    of the last species.
    """
    return fraction.dot(xr.DataArray(scaled_diameter(archive), dims="species"), dim="species")


def scaled_diameter(archive: xr.Dataset) -> Floats:
    """Of each species (species,), from 0 to 1; of grains of one size that of the last is 1."""
    diameter = values_of(archive, "grain_diameter")
    spread = diameter.max() - diameter.min()
    if spread > 0:
        return np.asarray((diameter - diameter.min()) / spread)
    return np.append(np.zeros(len(diameter) - 1), 1.0)


def named(meaning: str, units: str = "1") -> dict[str, str]:
    """The attributes of a variable; of a word, which has no unit, `units` is empty."""
    return {"long_name": meaning} | ({"units": units} if units else {})
