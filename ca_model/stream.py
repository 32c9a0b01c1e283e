"""A deposit on disk, grain by grain, for piles that do not fit into memory on a grid.

The file holds what an archive holds, but for the deposit on its grid. Instead it has the slabs:

    grain     (at_rest,) species of the grains at rest, slab upon slab; in a slab column after
                         column, in each from below
    captured  (slab, x)  how many of a slab's grains are each column's

:func:`read_section` makes an archive of it that is as coarse as wished. Memory holds one slab, the
pile's surface and some records, however many grains are poured.
"""

from collections.abc import Callable, Iterator
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, cast

import netCDF4
import numpy as np
import xarray as xr

from ca_model.deposit import Raster, section, top_of
from ca_model.lattice import Lattice, lattice_of
from ca_model.run import LatticePouring, begin
from experiment import Experiment, SetupError
from experiment.archive import assemble, experiment_of, load
from experiment.archive.places import in_store
from experiment.archive.storage import reading, seal
from experiment.arrays import Ints
from experiment.errors import ArchiveError
from experiment.pouring import Pouring
from experiment.pouring.assembly import skeleton
from experiment.pouring.slabs import Slab
from experiment.pouring.streaming import pour_to_file
from experiment.pouring.work import Work

__all__ = ["pour_to_disk", "read_section", "slabs_of"]

LOG = 2**24  # grains
CHUNK = 2**18  # grains
CACHE = 4 * CHUNK  # else the library keeps as many chunks as it sees fit
STORED: dict[str, Any] = {"zlib": True, "complevel": 1, "fletcher32": True, "fill_value": False}
GRAIN, CAPTURED, AT_REST = "grain", "captured", "at_rest"
ON_A_GRID = ("z", "deposit_fraction")
EVERYWHERE = 0, 2**62


def pour_to_disk(
    experiment: Experiment,
    path: Path,
    progress: Callable[[float], object] | None = None,
    *,
    force: bool = False,
    resume: bool = False,
    log: int = LOG,
) -> Path:
    """Pour `experiment` on the lattice, and its grains into the file `path`, which it returns.

    The grains are those of :func:`ca_model.pour`, and `log` of them are kept in memory before they
    are written. The file is whole or absent; a pour that was stopped goes on with `resume`. Raises
    what :func:`experiment.pouring.streaming.pour_to_file` raises.
    """
    if log < 1:
        raise SetupError(f"log = {log}: it should be at least 1")
    if in_store(path):
        raise SetupError(f"path = {path}: grains go to netCDF-4 files only, not to a Zarr store")
    pour_to_file(
        partial(begin, log=log),
        experiment,
        path,
        force=force,
        resume=resume,
        progress=progress,
        finish=_write_slabs,
    )
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
        slabs = (slab.columns(first, last) for slab in _slabs_of(path, fine, lattice, above_base))
        coarse = _coarse(_above_base(part) if above_base else part, lattice, slabs, cells)
    if above_base:
        coarse["z"].attrs["long_name"] = "height above the surface before pouring"
    return coarse


def slabs_of(path: Path) -> Iterator[Slab]:
    """The slabs of the deposit at `path`, lowest first, one at a time."""
    fine = load(path, absent=ON_A_GRID, beside=(GRAIN, CAPTURED))
    with reading(path):
        yield from _slabs_of(path, fine, _lattice_of_all(fine), above_base=False)


def _slabs_of(path: Path, fine: xr.Dataset, lattice: Lattice, above_base: bool) -> Iterator[Slab]:
    """As :func:`slabs_of`; raises where they do not make up the heights that `fine` tells."""
    bottom, top = (_in_units(fine[name], lattice) for name in ("base_height", "height"))
    if above_base:
        bottom, top = bottom - bottom, top - bottom
    with netCDF4.Dataset(path) as file:
        if not {GRAIN, CAPTURED} <= file.variables.keys():
            raise ArchiveError("it holds no slabs of grains")
        file.set_auto_mask(False)
        file[GRAIN].set_var_chunk_cache(CACHE)
        end = 0
        for k in range(len(file.dimensions["slab"])):
            ends = np.concatenate([[0], np.cumsum(file[CAPTURED][k], dtype=np.int64)])
            begin, end = end, end + int(ends[-1])
            grains = file[GRAIN][begin:end]
            above = top_of(bottom, ends, grains, lattice.rule.grain_height)
            yield Slab(bottom, above, ends, grains)
            bottom = above
        if end != len(file.dimensions[AT_REST]) or (bottom != top).any():
            raise ArchiveError("its slabs do not make up its pile")


def _in_units(height: xr.DataArray, lattice: Lattice) -> Ints:
    """The last of the heights (..., x) in u."""
    last = height.values.reshape(-1, height.sizes["x"])[-1]
    return np.asarray(np.rint(last / lattice.unit).astype(np.int64))


def _write_slabs(path: Path, pouring: Pouring, work: Work) -> None:
    """The finish of a pour to disk: its slabs, what was not handed on, and what else there is."""
    pouring.bury()
    rest = cast(LatticePouring, pouring).pile.rest()
    skeleton(path, pouring, work, without=ON_A_GRID)
    with netCDF4.Dataset(path, "a") as file:
        file.createDimension(AT_REST, None)
        file.createDimension("slab", None)
        grain = file.createVariable(
            GRAIN, "u1", (AT_REST,), chunksizes=(CHUNK,), chunk_cache=CACHE, **STORED
        )
        captured = file.createVariable(
            CAPTURED, "u4", ("slab", "x"), chunksizes=(1, pouring.columns), **STORED
        )
        grain.long_name = "species of a grain at rest, numbered from 0; slab upon slab"
        captured.long_name = "number of grains of a slab that a column captured"
        captured.units = "1"
        kept = [rest] if rest.pieces.size else []
        for k, slab in enumerate(chain(work.reaching(*EVERYWHERE), kept)):
            grains = grain.size
            grain[grains : grains + slab.pieces.size] = slab.pieces
            captured[k] = np.diff(slab.ends)
    seal(path, beside=(GRAIN, CAPTURED))


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
    top = round(float(fine["height"][-1].max()) / lattice.unit)
    units, wide = -(-max(top, 2) // cells[0]), -(-columns // cells[1])
    raster = Raster(max(2, -(-top // units)), -(-columns // wide), units=units, wide=wide)
    averages = {
        str(name): values.values
        for name, values in fine.coarsen(x=wide, boundary="pad").mean().variables.items()
        if {"time", "x"} & {*values.dims}
    }
    on_the_grid = {
        "x": float(fine["x"][0]) - width / 2 + (np.arange(raster.columns) + 0.5) * wide * width,
        "z": (np.arange(raster.rows) + 0.5) * units * lattice.unit,
        "deposit_fraction": section(slabs, lattice.rule.grain_height, raster),
    }
    return assemble(experiment_of(fine), "ca_model", averages | on_the_grid, fine.attrs)
