"""The final archive of a pour, put together from its parts, some rows at a time.

Memory holds a band of the deposit or a file of records, however long the pour was.
"""

from collections.abc import Collection, Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np

from experiment.archive.encoding import encoding_of
from experiment.archive.layout import lay_out
from experiment.archive.storage import few_pieces, opened, seal, store
from experiment.archive.variables import COORDINATES, VARIABLES, Variable
from experiment.arrays import Floats
from experiment.pouring.extension import STATE
from experiment.pouring.loop import Pouring
from experiment.pouring.recorder import record_steps
from experiment.pouring.state import bare_dataset
from experiment.pouring.work import Work

__all__ = ["assemble_on_disk", "skeleton"]

BAND = 2**24  # bytes of the deposit in memory
DEPOSIT = "deposit_fraction"
RECORDED = [name for name, variable in VARIABLES.items() if "time" in variable.dims]
LABELS = [coordinate for coordinate in COORDINATES.values() if coordinate.dtype == "str"]


def assemble_on_disk(path: Path, pouring: Pouring, work: Work) -> None:
    """Write the archive of a pour that is at its end, with the state that it ended in."""
    pouring.bury()
    skeleton(path, pouring, work)
    with few_pieces(), netCDF4.Dataset(path, "a") as file:
        deposit = _create(file, VARIABLES[DEPOSIT], pouring)
        for low, band in _bands(pouring, work, len(file.dimensions["z"])):
            if pouring.pure_bins:
                band = np.where(np.isnan(band), deposit._FillValue, band)
            deposit[low : low + len(band)] = band
    store(bare_dataset(pouring.state()), path, "a", STATE, squeeze=False)
    seal(path)


def skeleton(path: Path, pouring: Pouring, work: Work, without: Collection[str] = ()) -> None:
    """Write all of an archive but for the deposit, and `without` some coordinates."""
    experiment = pouring.experiment
    time = np.array(record_steps(experiment.pour, pouring.dt)) * pouring.dt
    known = {"time": time, **{n: v for n, v in pouring.grid().items() if n not in without}}
    store(lay_out(experiment, pouring.model, known, {}), path)
    with few_pieces(), netCDF4.Dataset(path, "a") as file:
        for name in RECORDED:
            _create(file, VARIABLES[name], pouring)
        for first, block in work.recorded():
            for name in RECORDED:
                file[name][first : first + len(block[name])] = block[name]
        file.setncatts(pouring.notes(file["height"]))


def _create(file: netCDF4.Dataset, variable: Variable, pouring: Pouring) -> "netCDF4.Variable[Any]":
    """An empty variable of the file, as xarray would have made it."""
    dims, label_dims = variable.dims, set(variable.dims)
    shape = [len(file.dimensions[dim]) for dim in dims]
    whole = pouring.pure_bins if variable.name == DEPOSIT else pouring.whole_grains
    told = encoding_of(variable.name, shape, whole_grains=whole)
    kind, fill = told.pop("dtype", variable.dtype), told.pop("_FillValue")
    made = file.createVariable(
        variable.name, kind, dims, fill_value=False if fill is None else fill, **told
    )
    made.setncatts(variable.attributes)
    labels = [label.name for label in LABELS if label_dims.issuperset(label.dims)]
    if labels:
        made.coordinates = " ".join(labels)
    made.set_auto_maskandscale(False)
    return made


def _bands(pouring: Pouring, work: Work, rows: int) -> Iterator[tuple[int, Floats]]:
    """The deposit from below, band by band: the first row of each, and its rows."""
    high = max(1, BAND // (8 * pouring.columns * pouring.experiment.mixture.species))
    base, section = work.base, pouring.section(work)
    with nullcontext() if base is None else opened(base.path) as archive:
        for low in range(0, rows, high):
            band = section(low, min(low + high, rows))
            if base is not None and archive is not None:
                band = base.below(archive, band, low)
            yield low, band
