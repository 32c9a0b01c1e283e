"""The slope on which lines are followed: what they need of an archive."""

from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from compare.quantities import (
    cell_length,
    measured_columns,
    settled_since,
    slope_columns,
    total_inflow,
    values_of,
)
from experiment.archive import experiment_of
from experiment.arrays import Floats

__all__ = ["Slope", "slope_of"]


class Slope(NamedTuple):
    """The slope to the right of the source, on which lines are followed."""

    time: Floats  # (time,) [s]
    x: Floats  # (x,) [cm]
    thickness: Floats  # (time, x, species) [cm]
    height: Floats  # (time, x) [cm]
    measured: NDArray[np.bool_]  # (x,) whether velocities are taken there
    settled: float  # s, when the transient is over
    length: float  # cm
    inflow: float  # cm, R0
    drift: Floats  # (species,) [cm/s]
    ends_at: str


def slope_of(archive: xr.Dataset) -> Slope:
    """What lines are found from, as arrays."""
    below = slope_columns(archive)
    end = experiment_of(archive).cell.end
    return Slope(
        values_of(archive, "time"),
        values_of(archive, "x")[below],
        values_of(archive, "rolling_thickness")[:, below],
        values_of(archive, "height")[:, below],
        measured_columns(archive)[below],
        settled_since(archive),
        cell_length(archive),
        total_inflow(archive),
        values_of(archive, "drift_velocity"),
        "lip" if end == "open" else end,
    )
