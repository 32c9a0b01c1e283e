"""`archive.strata`: the measurements of an archive, each made once and kept with it."""

from functools import cached_property

import xarray as xr

from compare.deposit import layers
from compare.kymograph import kinks_and_fronts

__all__ = ["Strata"]


@xr.register_dataset_accessor("strata")  # type: ignore[no-untyped-call]
class Strata:
    """What can be measured in an archive, as in `archive.strata.kinks()`.

    Results are kept as long as the archive is, which should not be changed in place meanwhile.
    """

    def __init__(self, archive: xr.Dataset) -> None:
        self._archive = archive

    def kinks(self) -> xr.Dataset:
        """Lines where the flow stops; see :func:`compare.kinks`."""
        return self._lines[0]

    def fronts(self) -> xr.Dataset:
        """Lines where the flow sets in; see :func:`compare.fronts`."""
        return self._lines[1]

    def layers(self) -> xr.Dataset:
        """Layers and zones of the deposit; see :func:`compare.layers`."""
        return self._layers

    def measure(self) -> xr.Dataset:
        """Every number that the archive gives; see :func:`compare.measure`."""
        return self._measured

    @cached_property
    def _lines(self) -> tuple[xr.Dataset, xr.Dataset]:
        return kinks_and_fronts(self._archive)

    @cached_property
    def _layers(self) -> xr.Dataset:
        return layers(self._archive)

    @cached_property
    def _measured(self) -> xr.Dataset:
        from compare.measurement import measure

        return measure(self._archive)
