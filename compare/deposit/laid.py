"""What is told of a deposit: plain numbers and arrays, and the Dataset that they make."""

from typing import NamedTuple

import numpy as np
import xarray as xr

from compare.quantities import Quantity, quantity
from experiment.arrays import Floats

__all__ = ["Laid"]

SCALARS = {
    "wavelength": ("cm", "vertical wavelength of the layers, by spectrum"),
    "wavelength_error": ("cm", "standard error of wavelength"),
    "wavelength_counted": ("cm", "vertical wavelength of the layers, by counting"),
    "wavelength_counted_error": ("cm", "standard error of wavelength_counted"),
    "wavelength_spread": ("cm", "standard deviation of wavelength, of single cycles in place"),
    "wavelength_normal": ("cm", "wavelength normal to the layers"),
    "wavelength_normal_error": ("cm", "standard error of wavelength_normal"),
    "wavelength_drift": ("1", "change of wavelength with x"),
    "wavelength_drift_error": ("1", "standard error of wavelength_drift"),
    "wavelength_upper": ("cm", "wavelength on the upper slope, where there are two"),
    "wavelength_lower": ("cm", "wavelength on the lower slope, where there are two"),
    "wavelength_step_x": ("cm", "where the wavelength steps, if there are two"),
    "thickness_small": ("cm", "vertical thickness of a sublayer of small grains"),
    "thickness_small_error": ("cm", "standard error of thickness_small"),
    "thickness_large": ("cm", "vertical thickness of a sublayer of large grains"),
    "thickness_large_error": ("cm", "standard error of thickness_large"),
    "pairs_a_cycle": ("1", "pairs of layers that a cycle lays"),
    "layer_pairs": ("1", "pairs of layers that were counted in a column"),
    "inclination": ("1", "slope of the layers"),
    "inclination_error": ("1", "standard error of inclination"),
    "layering": ("1", "strength of the layering"),
    "zone_small_begin": ("cm", "upper edge of the zone of small grains"),
    "zone_small_end": ("cm", "lower edge of the zone of small grains"),
    "zone_large_begin": ("cm", "upper edge of the zone of large grains"),
    "zone_large_end": ("cm", "lower edge of the zone of large grains"),
    "zone_layered_begin": ("cm", "upper edge of the zone of layers"),
    "zone_layered_end": ("cm", "lower edge of the zone of layers"),
    "pure_share": ("1", "share of the slope where one kind of grain lies nearly alone"),
    "layered_share": ("1", "share of the slope where there are layers"),
    "segregation": ("1", "degree of segregation along x"),
}
IN_PLACE = {
    "wavelength_at": ("cm", "vertical wavelength of the layers in place"),
    "layering_at": ("1", "strength of the layering in place"),
    "coherence_at": ("1", "share of the variance that an average along the layers keeps"),
    "regularity_at": ("1", "share of the variance of such an average that repeats"),
    "coarseness_at": ("1", "mean coarseness of the deposit in place"),
}


class Laid(NamedTuple):
    """What is told of a deposit, in all and in place."""

    x: xr.Variable
    scalars: dict[str, float]  # by the names of SCALARS, where there is something to tell
    in_place: tuple[Floats, ...]  # (x,), in the order of IN_PLACE
    comment: str  # what should be looked at twice; empty where nothing should

    def numbers(self) -> dict[str, Quantity]:
        """All SCALARS."""
        return {
            name: quantity(self.scalars.get(name, np.nan), *told) for name, told in SCALARS.items()
        }

    def dataset(self) -> xr.Dataset:
        """As :func:`layers_of` tells."""
        in_place = {
            name: quantity(array, *told, dims=("x",))
            for (name, told), array in zip(IN_PLACE.items(), self.in_place, strict=True)
        }
        comment = {"comment": self.comment} if self.comment else {}
        return xr.Dataset(self.numbers() | in_place, {"x": self.x}, comment)
