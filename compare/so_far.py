"""A pour as far as it has come: what its archive would hold, had it ended there."""

import numpy as np
import xarray as xr

from compare.quantities import cell_height, values_of

__all__ = ["so_far"]

FEWEST = 2  # records


def so_far(archive: xr.Dataset, time: float) -> xr.Dataset:
    """An archive cut to its records up to a time [s], but never to fewer than two.

    The deposit is cut to what lies below the height that the pile had then: what the flow took up
    again later is not brought back, and the set-up stays that of the whole pour. A drum's section,
    which turns, cannot be cut.
    """
    records = int(np.searchsorted(values_of(archive, "time"), time, side="right"))
    begun = archive.isel(time=slice(max(records, FEWEST)))
    height = values_of(begun, "height")[-1]
    bottom = values_of(archive, "z") - cell_height(archive) / 2
    rows = max(2, int(np.searchsorted(bottom, height.max())))
    begun, bottom = begun.isel(z=slice(rows)), bottom[:rows]
    there = bottom[:, None] < height
    fraction = np.where(there[..., None], values_of(begun, "deposit_fraction"), np.nan)
    return begun.assign(deposit_fraction=begun["deposit_fraction"].copy(data=fraction))
