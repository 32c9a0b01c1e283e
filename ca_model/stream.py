"""A deposit that goes to disk while it is poured, for piles that do not fit into memory.

The file holds what an archive holds, but for the deposit on its grid. Instead it has the slabs:

    grain     (grain,)   species of the grains at rest, slab upon slab; in a slab column after
                         column, in each from below
    captured  (slab, x)  how many of a slab's grains are each column's

:func:`read_section` makes an archive of it that is as coarse as wished. Memory holds one slab, the
pile's surface and its records, however many grains are poured.
"""

from collections.abc import Callable, Iterator
from pathlib import Path

import netCDF4
import numpy as np
import xarray as xr

from ca_model.deposit import Slab, section
from ca_model.lattice import Lattice, lattice_of
from ca_model.notes import notes
from ca_model.run import bare_pile, recorded
from experiment import Experiment, SetupError
from experiment.archive import COMPRESSED, assemble, experiment_of, lay_out, load, reading, store
from experiment.errors import ArchiveError
from experiment.files import whole_file
from experiment.recorder import record_steps

__all__ = ["pour_to_disk", "read_section", "slabs_of"]

LOG = 2**24  # grains
CHUNK = 2**18  # grains
CACHE = 4 * CHUNK  # else the library keeps as many chunks as it sees fit
STORED = COMPRESSED | {"fill_value": False}
GRAIN, CAPTURED = "grain", "captured"
ON_A_GRID = ("z", "deposit_fraction")


def pour_to_disk(
    experiment: Experiment,
    path: Path,
    progress: Callable[[float], object] | None = None,
    *,
    force: bool = False,
    log: int = LOG,
) -> Path:
    """Pour `experiment` on the lattice, and its grains into the file `path`, which it returns.

    The grains are those of :func:`ca_model.pour`, and `log` of them are kept in memory before they
    are written (by the toppling rule all of them: what lies may topple on). The file is whole or
    absent. Raises what :func:`ca_model.pour` raises, :class:`OutputExistsError` where `path` exists
    and `force` is not given, and :class:`ArchiveError` where it cannot be written.
    """
    if log < 1:
        raise SetupError(f"log = {log}: it should be at least 1")
    lattice = lattice_of(experiment)
    record_steps(experiment.pour, lattice.step)
    with whole_file(path, force=force) as part:
        with netCDF4.Dataset(part, "w", format="NETCDF4") as file:
            pile = bare_pile(experiment, lattice, _Slabs(file, lattice).lay, log)
            arrays = recorded(experiment, lattice, pile, progress)
        told = notes(experiment.mixture, lattice, arrays["height"])
        store(lay_out(experiment, "ca_model", arrays, told), part, "a")
    return path


def read_section(
    path: Path,
    cells: tuple[int, int] = (500, 1000),
    *,
    between: tuple[float, float] = (-np.inf, np.inf),
    above_base: bool = False,
) -> xr.Dataset:
    """The archive of the pour at `path`, averaged over a grid of at most `cells` (z, x).

    Of the columns whose middles are `between` two x [cm]. With `above_base` heights count from the
    surface before pouring: a pile that is much longer than it grew shows its layers so. Raises
    :class:`SetupError` for a grid of fewer than 2 cells or columns each way and
    :class:`ArchiveError` where the file is not one of :func:`pour_to_disk`, or not whole.
    """
    if min(cells) < 2:
        raise SetupError(f"cells = {cells}: there should be at least 2 each way")
    fine = load(path, absent=ON_A_GRID, beside=(GRAIN, CAPTURED))
    first, last = np.searchsorted(fine["x"].values, between)
    if last - first < 2:
        raise SetupError(f"between = {between}: there should be at least 2 columns")
    part = fine.isel(x=slice(first, last))
    with reading(path):
        lattice = _lattice_of_all(fine)
        slabs = (slab.columns(first, last) for slab in slabs_of(path))
        coarse = _coarse(_above_base(part) if above_base else part, lattice, slabs, cells)
    if above_base:
        coarse["z"].attrs["long_name"] = "height above the surface before pouring"
    return coarse


def slabs_of(path: Path) -> Iterator[Slab]:
    """The slabs of the deposit at `path`, lowest first, one at a time."""
    with netCDF4.Dataset(path) as file:
        if not {GRAIN, CAPTURED} <= file.variables.keys():
            raise ArchiveError("it holds no slabs of grains")
        file.set_auto_mask(False)
        file[GRAIN].set_var_chunk_cache(CACHE)
        end = 0
        for k in range(len(file.dimensions["slab"])):
            ends = np.concatenate([[0], np.cumsum(file[CAPTURED][k], dtype=np.int64)])
            begin, end = end, end + int(ends[-1])
            yield Slab(ends, file[GRAIN][begin:end])
        if end != len(file.dimensions[GRAIN]):
            raise ArchiveError("its slabs do not hold all of its grains")


class _Slabs:
    """Slabs in a file."""

    def __init__(self, file: netCDF4.Dataset, lattice: Lattice) -> None:
        columns = lattice.columns
        for name, size in ((GRAIN, None), ("slab", None), ("x", columns)):
            file.createDimension(name, size)
        self._grain = file.createVariable(
            GRAIN, "u1", (GRAIN,), chunksizes=(CHUNK,), chunk_cache=CACHE, **STORED
        )
        self._captured = file.createVariable(
            CAPTURED, "u4", ("slab", "x"), chunksizes=(1, columns), **STORED
        )
        self._grain.long_name = "species of a grain at rest, numbered from 0; slab upon slab"
        self._captured.long_name = "number of grains of a slab that a column captured"
        self._captured.units = "1"

    def lay(self, slab: Slab) -> None:
        """Put a slab on top."""
        grains, slabs = self._grain.size, len(self._captured)
        self._grain[grains : grains + slab.grains.size] = slab.grains
        self._captured[slabs] = np.diff(slab.ends)


def _above_base(fine: xr.Dataset) -> xr.Dataset:
    base = fine["base_height"]
    return fine.assign(height=fine["height"] - base, base_height=base * 0.0)


def _lattice_of_all(fine: xr.Dataset) -> Lattice:
    lattice = lattice_of(experiment_of(fine))
    if fine.sizes["x"] != lattice.columns:
        raise ArchiveError(f"it has {fine.sizes['x']} columns, its set-up {lattice.columns}")
    return lattice


def _coarse(
    fine: xr.Dataset, lattice: Lattice, slabs: Iterator[Slab], cells: tuple[int, int]
) -> xr.Dataset:
    """The archive of `slabs` on a grid, with the averages of what `fine` tells of each column."""
    columns, width = fine.sizes["x"], lattice.column_width
    base = np.rint(fine["base_height"].values / lattice.unit).astype(np.int64)
    top = round(float(fine["height"][-1].max()) / lattice.unit)
    units, wide = -(-max(top, 2) // cells[0]), -(-columns // cells[1])
    shape = max(2, -(-top // units)), -(-columns // wide)
    averages = {
        str(name): values.values
        for name, values in fine.coarsen(x=wide, boundary="pad").mean().variables.items()
        if {"time", "x"} & {*values.dims}
    }
    ground = lattice.ground._replace(height=base)
    on_the_grid = {
        "x": float(fine["x"][0]) - width / 2 + (np.arange(shape[1]) + 0.5) * wide * width,
        "z": (np.arange(shape[0]) + 0.5) * units * lattice.unit,
        "deposit_fraction": section(slabs, lattice.rule.grain_height, ground, shape, units, wide),
    }
    return assemble(experiment_of(fine), "ca_model", averages | on_the_grid, fine.attrs)
