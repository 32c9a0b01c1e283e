"""The regimes of a diagram, and where the layers lie of those that are layered and segregated.

Of three species some may lie in layers and one apart, on the upper or the lower slope, as in the
four phases of M. Shimokawa et al., Phys. Rev. E 91, 062205 (2015). It counts where the middle of
the longest zone of layers is.
"""

import numpy as np
import xarray as xr

__all__ = ["PATTERNS", "patterns"]

ABOVE, BELOW = "layers above, segregated below", "segregated above, layers below"
PATTERNS = ("stratified", ABOVE, BELOW, "segregated", "mixed", "unsettled", "failed")


def patterns(diagram: xr.Dataset) -> xr.DataArray:
    """One of PATTERNS for each point and model."""
    regime = diagram["regime"]
    middle = (diagram["zone_layered_begin"] + diagram["zone_layered_end"]) / 2
    is_above = (middle < diagram["slope_length"] / 2).transpose(*regime.dims).values
    words = np.where(regime.values == "", "failed", regime.values)
    apart = regime.values == "layered-and-segregated"
    return regime.copy(data=np.where(apart, np.where(is_above, ABOVE, BELOW), words))
