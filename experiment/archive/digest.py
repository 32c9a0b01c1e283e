"""What proves that a file holds what was written: a digest of its content, a checksum of its bytes.

The **digest** is SHA-256 over what a Dataset says, not over how it is stored: names, dimensions,
kinds, shapes, numbers and attributes, all but the date in `history`. It is the same in memory, in
netCDF-4 at any compression and in Zarr, so two archives hold the same numbers if and only if their
digests agree. Files carry it as the attribute `content_sha256`.

The **checksum** is a last line of text behind the end of the HDF5 file, which HDF5 does not read:

    stratify sha256 2c26b46b68ffc68ff99b453c1d30413413422d706483bfa0f98a5e886266e7ae

It is checked before the file is parsed, for HDF5 does not bear damage: of 8000 damaged archives it
read 10 as other numbers and never came back from 4. Behind the end of HDF5 there is that line or
nothing: a program that changes or copies an archive drops it, and the digest alone vouches for it.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from experiment.errors import ArchiveError

__all__ = ["DIGEST", "bare_size", "digest_of", "put_checksum", "refuse_damaged"]

DIGEST = "content_sha256"
DATED = ("history", DIGEST)  # attributes of the Dataset that are no content
BLOCK = 2**23  # bytes
SIGN = b"\nstratify sha256 "
LINE = len(SIGN) + 64 + 1


def digest_of(dataset: xr.Dataset) -> str:
    """SHA-256 of what `dataset` says, in hexadecimal; it may be opened lazily and be large.

    0 and -0 are one number, and so are all NaN.
    """
    undated = {name: told for name, told in dataset.attrs.items() if name not in DATED}
    found = hashlib.sha256(_canonical(undated))
    for name in sorted(dataset.variables, key=str):
        values = dataset.variables[name]
        words = values.dtype.kind in "OSUT"
        kind = "text" if words else values.dtype.newbyteorder("<").str
        told = {"name": name, "dims": list(values.dims), "kind": kind, "shape": list(values.shape)}
        found.update(_canonical(told))
        found.update(_canonical(values.attrs))
        for block in _blocks(values):
            found.update(_text(block) if words else _numbers(block))
    return found.hexdigest()


def put_checksum(path: Path) -> None:
    """End the finished file with the line that holds the checksum of all before it."""
    with path.open("r+b") as file:
        file.write(SIGN + _checksum(file, path.stat().st_size) + b"\n")


def refuse_damaged(path: Path) -> None:
    """Raise :class:`ArchiveError` where the bytes of `path` are not those of its last line.

    A file that ends where HDF5 does, and has no such line, passes.
    """
    size = bare_size(path)
    with path.open("rb") as file:
        ends = _end_of_hdf5(file.read(36))
        file.seek(0)
        if size < path.stat().st_size:
            intact = SIGN + _checksum(file, size) + b"\n" == file.read()
        else:
            intact = ends is None or size <= ends
    if not intact:
        raise ArchiveError("it is damaged: its bytes are not those that were written")


def bare_size(path: Path) -> int:
    """The size [bytes] of a file without the line of its checksum, if it has one."""
    size = path.stat().st_size
    with path.open("rb") as file:
        file.seek(max(0, size - LINE))
        return size - LINE if file.read().startswith(SIGN) else size


def _end_of_hdf5(superblock: bytes) -> int | None:
    """Where the superblock of an HDF5 file, of the version that netCDF-4 writes, says it ends."""
    if superblock[:8] == b"\x89HDF\r\n\x1a\n" and superblock[8] in {2, 3}:
        return int.from_bytes(superblock[28:36], "little")
    return None


def _checksum(file: BinaryIO, size: int) -> bytes:
    found = hashlib.sha256()
    for start in range(0, size, BLOCK):
        found.update(file.read(min(BLOCK, size - start)))
    return found.hexdigest().encode()


def _blocks(values: xr.Variable) -> Iterator[NDArray[Any]]:
    """The values along their first axis, some MB at a time, in whole chunks where those fit."""
    if values.ndim == 0:
        yield values.values
        return
    row = max(1, values.nbytes // max(1, values.shape[0]))
    chunk = values.encoding.get("preferred_chunks", {}).get(values.dims[0], 1)
    rows = max(1, BLOCK // row)
    rows -= rows % chunk if rows > chunk else 0
    for start in range(0, values.shape[0], rows):
        yield values[start : start + rows].values


def _numbers(block: NDArray[Any]) -> memoryview:
    if block.dtype.kind == "f":
        block = np.atleast_1d(block) + block.dtype.type(0)
        block[np.isnan(block)] = np.nan
    return np.ascontiguousarray(block, dtype=block.dtype.newbyteorder("<")).data


def _text(block: NDArray[Any]) -> bytes:
    return b"".join(_canonical(word) for word in block.ravel().tolist())


def _canonical(told: object) -> bytes:
    """One line of JSON: the same for equal values, in whatever type a file gives them back."""
    return json.dumps(_plain(told), sort_keys=True).encode() + b"\n"


def _plain(told: object) -> object:
    if isinstance(told, Mapping):
        return {str(key): _plain(value) for key, value in told.items()}
    items = np.asarray(told).ravel().tolist()
    items = [item.decode(errors="replace") if isinstance(item, bytes) else item for item in items]
    return items[0] if len(items) == 1 else items
