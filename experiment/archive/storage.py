"""Datasets in files that are whole or absent, and that say so when they were damaged.

netCDF-4, whatever the Dataset tells of; :mod:`experiment.archive.digest` has what proves a file.
What is read may be a group of a Zarr store as well (:mod:`experiment.archive.zarr_store`).
"""

import os
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import netCDF4
import numpy as np
import xarray as xr

from experiment.archive.digest import DIGEST, digest_of, put_checksum, refuse_damaged
from experiment.archive.encoding import PIECE, encoding_of, unsqueezed
from experiment.archive.files import size_of, whole_file
from experiment.archive.places import in_store
from experiment.archive.zarr_store import need_zarr, open_group, proven_digest
from experiment.errors import ArchiveError, StratifyError

__all__ = [
    "content_of",
    "few_pieces",
    "holds",
    "opened",
    "read_whole",
    "reading",
    "seal",
    "store",
    "told_by",
    "write_whole",
]

CACHE = 4 * PIECE
MOST_SQUEEZED = 10_000  # bytes of numbers in a byte of a file; deflate does 1032
OTHER = (
    f"it carries no {DIGEST}: another program wrote it, or an older version of this one; "
    "`stratify pour` writes it anew"
)

CHANGED = f"it is damaged or was changed: its content is not that of {DIGEST}"


def write_whole(
    dataset: xr.Dataset,
    path: Path,
    groups: Mapping[str, xr.Dataset] | None = None,
    *,
    force: bool = False,
    squeeze: bool = True,
) -> Path:
    """Write any Dataset as netCDF-4 under a temporary name, then rename: whole or absent.

    `groups` are further Datasets, each put into the file's group of that name. What is not to stay
    for long need not be squeezed. Raises :class:`OutputExistsError` where `path` exists and `force`
    is not given, and :class:`ArchiveError` where it cannot be written.
    """
    if in_store(path):
        raise ArchiveError(f"{str(path)!r}: Datasets go to netCDF-4 files only; see pour_to_file")
    with whole_file(path, force=force) as part:
        store(dataset, part, squeeze=squeeze)
        for name, group in (groups or {}).items():
            store(group, part, "a", name, squeeze=squeeze)
        put_checksum(part)
    return path


def store(
    dataset: xr.Dataset,
    part: Path,
    mode: Literal["w", "a"] = "w",
    group: str | None = None,
    *,
    squeeze: bool = True,
) -> None:
    """Put `dataset` with its digest into a file that is not finished, a new one or (a) another."""
    lattice = dataset.attrs.get("model") == "ca_model"

    def how(name: str, values: xr.Variable) -> dict[str, Any]:
        if values.ndim == 0 or values.size == 0:
            return {"_FillValue": None}
        if not squeeze:
            return unsqueezed(values.shape)
        return encoding_of(name, values.shape, whole_grains=lattice and _is_pure(values))

    floats = {str(n): v for n, v in dataset.variables.items() if v.dtype.kind == "f"}
    encoding = {name: how(name, values) for name, values in floats.items()}
    signed = dataset.assign_attrs({DIGEST: digest_of(dataset)})
    signed.to_netcdf(part, mode, format="NETCDF4", group=group, engine="netcdf4", encoding=encoding)


def _is_pure(values: xr.Variable) -> bool:
    """Whether fractions in a deposit are of whole grains: 0, 1, or NaN where there is nothing."""
    if "z" not in values.dims:
        return True
    whole = (values.values == 0.0) | (values.values == 1.0) | np.isnan(values.values)
    return bool(whole.all())


def seal(part: Path, beside: Collection[str] = ()) -> None:
    """Give a file that was written bit by bit the digest of its root Dataset, and its checksum.

    The Dataset is read in blocks that fit into memory; what the file holds `beside` it is left out.
    """
    with (
        few_pieces(),
        xr.open_dataset(part, engine="netcdf4", drop_variables=beside, cache=False) as stored,
    ):
        digest = digest_of(stored)
    with netCDF4.Dataset(part, "a") as file:
        file.setncattr(DIGEST, digest)
    put_checksum(part)


def read_whole(path: Path, group: str | None = None, beside: Collection[str] = ()) -> xr.Dataset:
    """The Dataset in the file `path`, or in a group of it, in memory and without its digest.

    What is `beside` is left. Raises :class:`ArchiveError` where it is not what was written.
    """
    with reading(path):
        with _stored(path, group, decode_cf=False, create_default_indexes=False) as stored:
            told = stored.attrs.pop(DIGEST, None)
            if told is None:
                raise ArchiveError(OTHER)
            raw = stored.drop_vars(beside, errors="ignore")
            if raw.nbytes > MOST_SQUEEZED * size_of(path):
                raise ArchiveError(f"it is damaged: it claims {raw.nbytes:.2g} bytes of numbers")
            dataset = xr.decode_cf(raw).load()
        if digest_of(dataset) != str(told):
            raise ArchiveError(CHANGED)
    return dataset


def holds(path: Path, group: str) -> bool:
    """Whether the file or group `path` has a group of that name."""
    with reading(path):
        if in_store(path):
            return (path / group).is_dir()
        with netCDF4.Dataset(path) as file:
            return group in file.groups


def told_by(path: Path, attribute: str) -> str:
    """An attribute of the file `path`, which may be older than this version."""
    if in_store(path):
        with opened(path) as archive:
            return str(archive.attrs[attribute])
    with reading(path):
        refuse_damaged(path)
        with netCDF4.Dataset(path) as file:
            return str(file.getncattr(attribute))


def content_of(path: Path) -> str:
    """The digest of what the file `path` holds; empty in one that is older than digests."""
    with reading(path), _stored(path) as stored:
        return str(stored.attrs.get(DIGEST, ""))


def _stored(path: Path, group: str | None = None, **how: Any) -> xr.Dataset:
    if in_store(path):
        return open_group(path, group, **how)
    refuse_damaged(path)
    return xr.open_dataset(path, engine="netcdf4", group=group, **how)


@contextmanager
def few_pieces() -> Iterator[None]:
    """Files that are opened within keep little of each variable in memory; else it is up to 64 MB.

    A file keeps to it as long as it is open.
    """
    before = netCDF4.get_chunk_cache()
    netCDF4.set_chunk_cache(CACHE)
    try:
        yield
    finally:
        netCDF4.set_chunk_cache(*before)


@contextmanager
def opened(path: Path) -> Iterator[xr.Dataset]:
    """The Dataset in the file `path` with its digest, read from there as it is needed.

    Raises :class:`ArchiveError` as :func:`read_whole`; a file that another program changed is not
    looked through.
    """
    with reading(path), few_pieces(), _stored(path, cache=False) as stored:
        if DIGEST not in stored.attrs:
            raise ArchiveError(OTHER)
        if in_store(path) and proven_digest(path) != stored.attrs[DIGEST]:
            raise ArchiveError(CHANGED)
        yield stored


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Raise :class:`ArchiveError` where what is read from `path` is not that of a whole archive."""
    if in_store(path):
        need_zarr()
    there = path / "zarr.json" if in_store(path) else path
    if not os.path.isfile(there):  # which does not raise in a folder that nobody may enter
        raise ArchiveError(f"{str(path)!r}: no such archive")
    try:
        yield
    except PermissionError as error:
        raise ArchiveError(f"{str(path)!r} cannot be read: {error.strerror}") from None
    except StratifyError as error:
        raise ArchiveError(f"{str(path)!r} is not an archive of a pour: {error}") from None
    except (OSError, ArithmeticError, AttributeError, LookupError, MemoryError) as error:
        raise ArchiveError(_not_whole(path, error)) from None
    except (RuntimeError, TypeError, ValueError) as error:
        raise ArchiveError(_not_whole(path, error)) from None


def _not_whole(path: Path, error: Exception) -> str:
    reason = " ".join(str(getattr(error, "strerror", None) or error).split())
    kind = "Zarr" if in_store(path) else "netCDF-4"
    return f"{str(path)!r} is not a whole {kind} archive: {reason}"
