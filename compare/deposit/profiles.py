"""What was laid after the transient: the part of a deposit that is measured."""

import numpy as np
import xarray as xr

from compare.quantities import coarseness, settled_height

__all__ = ["settled_coarseness"]


def settled_coarseness(archive: xr.Dataset) -> xr.DataArray:
    """Coarseness (z, x) of what was laid after the transient; NaN elsewhere."""
    coarse = coarseness(archive["deposit_fraction"], archive).transpose("z", "x")
    settled = archive["z"].values[:, None] > settled_height(archive)
    return coarse.copy(data=np.where(settled, coarse.values.astype(np.float64), np.nan))
