"""Pouring on from a finished archive: what it holds stays, and the pour goes on where it ended."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from experiment.archive.digest import DIGEST
from experiment.archive.provenance import difference_of_setups
from experiment.archive.storage import opened
from experiment.archive.variables import VARIABLES
from experiment.arrays import Floats, Ints
from experiment.errors import ArchiveError, SetupError
from experiment.experiment import Experiment
from experiment.pouring.state import State

__all__ = ["STATE", "Base", "extended", "refuse_another_setup"]

STATE = "state"  # the group of an archive that a longer pour goes on from
ROWS = 2**24  # bytes of records that are read at once
WHOLE = 1e-9


def extended(asked: Experiment, there: Experiment) -> Experiment:
    """The longer pour that is `asked` for, recorded as often as the one that is `there`.

    However many records `asked` has.

    Raises :class:`SetupError` where it is another set-up, or not longer by whole intervals between
    records.
    """
    refuse_another_setup(asked, there)
    interval = there.pour.duration / there.pour.records
    records = asked.pour.duration / interval
    longer = asked.pour.duration > there.pour.duration
    if not longer or abs(records - round(records)) > WHOLE * records:
        raise SetupError(
            f"pour.duration = {asked.pour.duration:g}: to extend a pour of "
            f"{there.pour.duration:g} s it should be longer by whole intervals of {interval:g} s"
        )
    pour = asked.pour.model_copy(update={"records": round(records)})
    return asked.model_copy(update={"pour": pour})


def refuse_another_setup(asked: Experiment, there: Experiment) -> None:
    """Raise :class:`SetupError` where they differ in more than how long they are poured."""
    as_long = asked.pour.model_copy(
        update={"duration": there.pour.duration, "records": there.pour.records}
    )
    if other := difference_of_setups(there, asked.model_copy(update={"pour": as_long})):
        raise SetupError(f"only a pour of the same set-up can be extended: {other}")


@dataclass(frozen=True)
class Base:
    """An archive that a longer pour goes on from, and keeps as it is below a `floor`."""

    path: Path
    digest: str  # that tells whether it still is the same
    floor: Ints  # (column,) the lowest bin of the deposit that the longer pour tells of

    def refuse_another(self) -> None:
        """Raise :class:`ArchiveError` where there is another archive now."""
        with opened(self.path) as archive:
            digest = archive.attrs[DIGEST]
        if digest != self.digest:
            raise ArchiveError(f"{str(self.path)!r} is not the archive that was being extended")

    def recorded(self) -> Iterator[tuple[int, State]]:
        """The records by and by: the number of a first one, and variables from it on."""
        names = [name for name, variable in VARIABLES.items() if "time" in variable.dims]
        with opened(self.path) as archive:
            records = archive.sizes["time"]
            size = sum(archive[name].nbytes for name in names) // records
            for first in range(0, records, max(1, ROWS // size)):
                block = archive[names].isel(time=slice(first, first + max(1, ROWS // size)))
                yield first, {name: block[name].values for name in names}

    def below(self, archive: xr.Dataset, band: Floats, low: int) -> Floats:
        """Rows of a deposit (z, x, species) from bin `low` up, below the floor those of `archive`.

        That is the archive of this base, opened.
        """
        whole = band.copy()
        there = archive["deposit_fraction"].isel(z=slice(low, low + len(band))).values
        old = (low + np.arange(len(there)))[:, None] < self.floor
        whole[: len(there)][old] = there[old]
        return whole
