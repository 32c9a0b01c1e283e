"""The final archive of a pour, put together from its parts, some rows at a time.

Memory holds a band of the deposit or a file of records, however long the pour was.
"""

from collections.abc import Iterator
from pathlib import Path

import netCDF4
import numpy as np

from experiment.archive import lay_out, seal, store
from experiment.arrays import Floats
from experiment.encoding import encoding_of
from experiment.extension import STATE
from experiment.pouring import Pouring
from experiment.recorder import record_steps
from experiment.state import bare_dataset
from experiment.variables import COORDINATES, VARIABLES, Variable
from experiment.work import Work

__all__ = ["assemble_on_disk"]

BAND = 2**25  # bytes of the deposit in memory
STREAMED = {name for name, variable in VARIABLES.items() if {"time", "z"} & {*variable.dims}}
LABELS = [coordinate for coordinate in COORDINATES.values() if coordinate.dtype == "str"]


def assemble_on_disk(path: Path, pouring: Pouring, work: Work) -> None:
    """Write the archive of a pour that is at its end, with the state that it ended in."""
    experiment, grid = pouring.experiment, pouring.grid()
    time = np.array(record_steps(experiment.pour, pouring.dt)) * pouring.dt
    store(lay_out(experiment, pouring.model, grid | {"time": time}, {}), path)
    with netCDF4.Dataset(path, "a") as file:
        file.set_auto_mask(False)
        for name in STREAMED:
            _create(file, VARIABLES[name], pouring)
        for first, block in work.recorded():
            for name in block.keys() & STREAMED:
                file[name][first : first + len(block[name])] = block[name]
        for low, band in _bands(pouring, work, len(grid["z"])):
            file["deposit_fraction"][low : low + len(band)] = band
        file.setncatts(pouring.notes(file["height"]))
    store(bare_dataset(pouring.state()), path, "a", STATE)
    seal(path)


def _create(file: netCDF4.Dataset, variable: Variable, pouring: Pouring) -> None:
    """An empty variable of the file, as xarray would have made it."""
    dims, label_dims = variable.dims, set(variable.dims)
    shape = [len(file.dimensions[dim]) for dim in dims]
    told = encoding_of(variable.name, dims, shape, whole_grains=pouring.whole_grains)
    kind, fill = told.pop("dtype", variable.dtype), told.pop("_FillValue")
    made = file.createVariable(
        variable.name, kind, dims, fill_value=False if fill is None else fill, **told
    )
    made.setncatts(variable.attributes)
    labels = [label.name for label in LABELS if label_dims.issuperset(label.dims)]
    if labels:
        made.coordinates = " ".join(labels)


def _bands(pouring: Pouring, work: Work, rows: int) -> Iterator[tuple[int, Floats]]:
    """The deposit from below, band by band: the first row of each, and its rows."""
    high = max(1, BAND // (8 * pouring.columns * pouring.experiment.mixture.species))
    for low in range(0, rows, high):
        band = pouring.section(work, low, min(low + high, rows))
        yield low, band if work.base is None else work.base.below(band, low)
