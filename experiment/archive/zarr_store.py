"""Archives in a Zarr store, which takes the part of the folder: a group for each file.

    run.zarr/                    a group of groups, with a list of all there is ("consolidated")
        ca_model/  continuum/    archives: names, numbers, attributes and digest of the netCDF-4
            state/               what a longer pour goes on from

A group is made of a whole netCDF-4 archive, some rows at a time, and then renamed. Each piece has
its CRC-32C; one that is lost reads as NaN or 0 in zarr, and only the digest tells. No folder can be
renamed over another, so an old group is put aside first: a process that is killed between the two
leaves it whole in the work folder, and the next pour of that name puts it back.

Needs zarr, `pip install 'stratify[zarr]'`; nothing of it is imported before it is used.
"""

import math
import os
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import netCDF4
import numpy as np
import xarray as xr

from experiment.archive.digest import digest_of
from experiment.archive.files import make_folder, sync
from experiment.errors import ArchiveError

if TYPE_CHECKING:
    from zarr import Group

__all__ = ["fill_store", "make_ready", "need_zarr", "open_group", "proven_digest"]

PIECE = 2**22  # bytes; each is a file of its own
REPLACED = "replaced"
WORDS = "OU"  # kinds of numpy


def need_zarr() -> None:
    """Raise :class:`ArchiveError` where zarr is not installed."""
    if find_spec("zarr") is None:
        raise ArchiveError("Zarr stores are the work of zarr: pip install 'stratify[zarr]'")


def open_group(path: Path, group: str | None = None, **how: Any) -> xr.Dataset:
    """The Dataset in the group `path`, or in a group of that, read as it is needed."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of what is no Zarr, which may be what is left of it
        return xr.open_dataset(path / (group or ""), engine="zarr", consolidated=False, **how)


def proven_digest(path: Path) -> str:
    """The digest of what the group `path` holds; not worked out again while its files stay."""
    told = ((entry, entry.stat()) for entry in path.rglob("*"))
    return _digest(path, frozenset((str(e), s.st_ino, s.st_size, s.st_mtime_ns) for e, s in told))


@lru_cache(maxsize=8)
def _digest(path: Path, files: frozenset[tuple[str, int, int, int]]) -> str:  # noqa: ARG001
    with open_group(path, cache=False) as stored:
        return digest_of(stored)


def fill_store(part: Path, path: Path) -> None:
    """Make the finished netCDF-4 archive `part` the group `path`, in place of one that is there."""
    made = part.with_name(f"{part.name}.zarr")
    with netCDF4.Dataset(part) as file:
        groups = [None, *file.groups]
    for group in groups:
        _copy(part, group, made / (group or ""))
    for entry in (made, *made.rglob("*")):
        sync(entry)
    with _unlisted(path.parent):
        if path.exists():
            path.rename(part.with_name(REPLACED))
        made.rename(path)
        sync(path.parent)


def make_ready(path: Path, folder: Path) -> None:
    """Make the store for the group `path`, and undo half a replacement that its `folder` tells of.

    Raises :class:`ArchiveError` where the store cannot be made.
    """
    need_zarr()
    make_folder(path.parent)
    with _unlisted(path.parent):
        if (folder / REPLACED).exists() and not path.exists():
            (folder / REPLACED).rename(path)


def _copy(part: Path, group: str | None, to: Path) -> None:
    from zarr import open_group as open_zarr

    with xr.open_dataset(
        part, engine="netcdf4", group=group, decode_cf=False, create_default_indexes=False
    ) as stored:
        made = open_zarr(to, mode="w-", zarr_format=3, attributes=_plain(stored.attrs))
        for name, values in stored.variables.items():
            _copy_variable(values, made, str(name))


def _copy_variable(values: xr.Variable, group: "Group", name: str) -> None:
    """Store a variable as it lies in netCDF-4: in the same type, and squeezed alike."""
    from zarr.codecs import BloscCodec, BloscShuffle, Crc32cCodec

    told, shape, kind = values.encoding, values.shape, values.dtype.kind
    rows = max(1, PIECE // max(1, values.dtype.itemsize * math.prod(shape[1:])))
    shuffle = BloscShuffle.shuffle if told.get("shuffle") else BloscShuffle.noshuffle
    blosc = BloscCodec(cname="zlib", clevel=told.get("complevel", 0), shuffle=shuffle)
    lost = "" if kind in WORDS else np.nan if kind == "f" else 0
    array = group.create_array(
        name,
        shape=shape,
        dtype="string" if kind in WORDS else values.dtype,
        chunks=tuple(max(1, min(rows, n) if k == 0 else n) for k, n in enumerate(shape)),
        compressors=[*([blosc] if told.get("zlib") else []), Crc32cCodec()],
        chunk_key_encoding={"name": "default", "separator": "."},
        fill_value=values.attrs.get("_FillValue", lost),
        dimension_names=[str(dim) for dim in values.dims],
        attributes=_plain(values.attrs),
        config={"write_empty_chunks": True},
    )
    firsts = range(0, shape[0], rows) if shape else ()
    for part in [slice(first, first + rows) for first in firsts] if shape else [...]:
        array[part] = values[part].values


def _plain(attributes: Mapping[Any, Any]) -> dict[str, Any]:
    return {str(name): np.asarray(told).tolist() for name, told in attributes.items()}


@contextmanager
def _unlisted(store: Path) -> Iterator[None]:
    """Change what the store holds, by one process at a time: what it lists is true at any moment.

    Its list is taken away before, and made anew after; there is none beside a damaged archive.
    """
    import fcntl

    from zarr import consolidate_metadata
    from zarr import open_group as open_zarr

    handle = os.open(store, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        try:
            root = open_zarr(store, mode="a", zarr_format=3, use_consolidated=False)
        except (AttributeError, LookupError, TypeError, ValueError) as error:
            raise ArchiveError(
                f"{str(store / 'zarr.json')!r} is not that of a store: {error}"
            ) from None
        root.update_attributes({})  # and write it without the list
        yield
        with suppress(LookupError, OSError, TypeError, ValueError), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that the list is in no standard yet
            consolidate_metadata(store, zarr_format=3)
    finally:
        os.close(handle)
