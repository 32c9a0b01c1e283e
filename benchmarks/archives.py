"""What an archive's bytes cost: filters, levels and chunks, relative to the setting in use.

The archives are those that experiment.archive writes, and the settings in use are read back from
them; each other one changes one thing of these, for all variables along time (records) or for the
deposit. Both are written in blocks of whole chunks and read whole; * needs a plug-in to be read.
"""

import tempfile
from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import netCDF4
import numpy as np
from numpy.typing import NDArray

import ca_model
import continuum
from benchmarks.clock import once
from experiment import NotApplicableError, load
from experiment.archive import write

PRESETS = ("makse-stratification", "glass-sugar", "lattice-stratification", "drum-mixture")
KEPT = ("zlib", "complevel", "shuffle", "fletcher32")
CHANGES: dict[str, dict[str, Any]] = {"in use": {}, "no filter": dict.fromkeys(KEPT, False)}
for level, shuffle in product((1, 2, 4, 6), (False, True)):
    name = f"zlib {level}{' shuffled' * shuffle}"
    CHANGES[name] = {"zlib": True, "complevel": level, "shuffle": shuffle}
for name, level in (("zstd", 1), ("blosc_lz4", 5), ("blosc_zstd", 5)):
    CHANGES[f"{name} {level} *"] = {"zlib": False, "compression": name, "complevel": level}
CHANGES |= {f"{size} kB a chunk": {"chunk": size} for size in (64, 256, 1024)} | {
    "one chunk": {"chunk": np.inf},
    "256 kB, by species": {"chunk": 256, "apart": True},
    "no checksums": {"fletcher32": False},
    "0 and 1 as bytes": {"bytes": True},
}


class Stored(NamedTuple):
    """A variable as it lies in a file, undecoded."""

    values: NDArray[Any]
    dims: tuple[str, ...]
    setting: dict[str, Any]


def get(path: Path, dim: str) -> dict[str, Stored]:
    with netCDF4.Dataset(path) as file:
        file.set_auto_maskandscale(False)
        found = {}
        for variable in (v for v in file.variables.values() if dim in v.dimensions):
            chunks, setting = variable.chunking(), dict[str, Any](variable.filters())
            setting = {key: setting[key] for key in KEPT}
            setting["chunksizes"] = variable.shape if chunks == "contiguous" else tuple(chunks)
            found[variable.name] = Stored(variable[:], variable.dimensions, setting)
        return found


def changed(variable: Stored, change: Mapping[str, Any]) -> Stored:
    values, setting = variable.values, {**variable.setting, **change}
    if setting.pop("bytes", False) and ((values == 0) | (values == 1)).all():
        values = values.astype("u1")
    apart = setting.pop("apart", False) and values.ndim == 3
    row = (*values.shape[1:-1], 1) if apart else values.shape[1:]
    if size := setting.pop("chunk", 0):
        rows = size * 1024 / (values.itemsize * np.prod(row))
        setting["chunksizes"] = (int(np.clip(rows, 1, len(values))), *row)
    return Stored(values, variable.dims, setting)


def put(path: Path, variables: Mapping[str, Stored]) -> None:
    with netCDF4.Dataset(path, "w", format="NETCDF4") as file:
        for name, (values, dims, setting) in variables.items():
            for dim in set(dims) - set(file.dimensions):
                file.createDimension(dim, values.shape[dims.index(dim)])
            variable = file.createVariable(name, values.dtype, dims, fill_value=False, **setting)
            block = setting["chunksizes"][0]
            for start in range(0, len(values), block):
                variable[start : start + block] = values[start : start + block]


def costs(archive: Path, part: Path, dim: str) -> dict[str, NDArray[Any]]:
    """Of each setting, for the variables along `dim`: kB, ms to write, ms to read."""
    variables = get(archive, dim)
    best = {name: np.full(3, np.inf) for name in CHANGES}
    for _, (name, change) in product(range(2), CHANGES.items()):
        wanted = {key: changed(variable, change) for key, variable in variables.items()}
        wrote, read = once(partial(put, part, wanted)), once(partial(get, part, dim))
        best[name] = np.minimum(best[name], (part.stat().st_size / 1e3, wrote * 1e3, read * 1e3))
    return best


def table(title: str, columns: Mapping[str, Mapping[str, NDArray[Any]]]) -> None:
    used = [column["in use"] for column in columns.values()]
    print(f"{title:18s}" + "".join("{:8.0f}{:5.0f}{:4.0f}".format(*base) for base in used))
    for name in CHANGES:
        ratios = (column[name] / column["in use"] for column in columns.values())
        print(f"{name:18s}" + "".join("{:8.2f}{:5.1f}{:4.1f}".format(*ratio) for ratio in ratios))


def main() -> None:
    poured, records, deposits = {}, {}, {}
    with tempfile.TemporaryDirectory() as folder:
        archive, part = Path(folder, "archive.nc"), Path(folder, "part.nc")
        for model, preset in product((ca_model, continuum), PRESETS):
            pour = partial(model.pour, load(preset))
            with suppress(NotApplicableError):  # to this model
                write(pour(), archive, force=True)
                name = f"{preset.partition('-')[0]} {model.__name__}"
                poured[name] = once(pour) * 1e3
                records[name], deposits[name] = (costs(archive, part, dim) for dim in ("time", "z"))
    print(f"{'':18s}" + "".join(f"{name:>17s}" for name in poured))
    print(f"{'poured in, ms':18s}" + "".join(f"{took:17.0f}" for took in poured.values()))
    print(f"{'':18s}" + f"{'size write read':>17s}" * len(poured))
    table("records: kB, ms", records)
    table("deposit: kB, ms", deposits)
