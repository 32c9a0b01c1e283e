"""What was laid after the transient: the part of a deposit that is measured."""

import numpy as np
import xarray as xr

from compare.quantities import coarseness, settled_since

__all__ = ["settled_coarseness"]


def settled_coarseness(archive: xr.Dataset) -> xr.DataArray:
    """Coarseness (z, x) of what was laid after the transient; NaN elsewhere."""
    start = archive["height"].interp(time=settled_since(archive)).drop_vars("time")
    coarse = coarseness(archive["deposit_fraction"], archive).astype(np.float64)
    return coarse.where(archive["z"] > start).transpose("z", "x")
