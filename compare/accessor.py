"""`archive.strata`: the measurements of an archive, each made once and kept with it."""

from functools import cached_property

import xarray as xr

from compare.deposit import Laid, look
from compare.kymograph import Told, follow

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
        return self._kinks

    def fronts(self) -> xr.Dataset:
        """Lines where the flow sets in; see :func:`compare.fronts`."""
        return self._fronts

    def layers(self) -> xr.Dataset:
        """Layers and zones of the deposit; see :func:`compare.layers`."""
        return self._layers

    def measure(self) -> xr.Dataset:
        """Every number that the archive gives; see :func:`compare.measure`."""
        return self._measured

    @cached_property
    def lines(self) -> tuple[Told, Told]:
        """What is told of kinks and of fronts, as arrays."""
        return follow(self._archive)

    @cached_property
    def laid(self) -> Laid:
        """What is told of the deposit, as numbers and arrays."""
        return look(self._archive)

    @cached_property
    def _kinks(self) -> xr.Dataset:
        return self.lines[0].dataset()

    @cached_property
    def _fronts(self) -> xr.Dataset:
        return self.lines[1].dataset()

    @cached_property
    def _layers(self) -> xr.Dataset:
        return self.laid.dataset()

    @cached_property
    def _measured(self) -> xr.Dataset:
        from compare.measurement import measure

        return measure(self._archive)
