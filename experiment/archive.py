"""One netCDF-4 file per model run: the same names from both models, whole or absent.

:func:`assemble` builds the Dataset from plain arrays and refuses what the table of variables does
not know; :func:`write` puts it under its final name only once it is complete; :func:`read` refuses
whatever is not such a file, or no longer the one that was written (:mod:`experiment.digest`).
"""

import os
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

import netCDF4
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from experiment.digest import DIGEST, digest_of, put_checksum, refuse_damaged
from experiment.errors import ArchiveError, StratifyError
from experiment.experiment import Experiment
from experiment.files import whole_file
from experiment.variables import COORDINATES, VARIABLES, Variable

__all__ = [
    "COMPRESSED",
    "CONVENTIONS",
    "assemble",
    "check",
    "experiment_of",
    "history",
    "lay_out",
    "load",
    "read",
    "reading",
    "seal",
    "store",
    "write",
    "write_whole",
]

CONVENTIONS = "CF-1.11"
REFERENCES = "H. A. Makse, Phys. Rev. E 56, 7008 (1997), doi:10.1103/PhysRevE.56.7008"
MODELS = ("ca_model", "continuum")
COMPRESSED: dict[str, Any] = {"zlib": True, "complevel": 1, "fletcher32": True}
AS_BYTES: dict[str, Any] = {"dtype": "u1", "_FillValue": np.uint8(255), "complevel": 6}
ATTRIBUTES = ("Conventions", "title", "source", "history", "references", "model", "experiment")
MOST_SQUEEZED = 10_000  # bytes of numbers in a byte of a file; deflate does 1032


def assemble(
    experiment: Experiment,
    model: str,
    arrays: dict[str, NDArray[Any]],
    attributes: dict[str, Any],
) -> xr.Dataset:
    """The archive of one run as a Dataset, from the `arrays` that the model recorded.

    `arrays` holds the coordinates time [s], x and z [cm] and every variable that the set-up does
    not already tell; `attributes` are the model's own notes on the run. Raises
    :class:`ArchiveError` for a name that is not in the table, a missing one, or a wrong shape.
    """
    return check(lay_out(experiment, model, arrays, attributes))


def lay_out(
    experiment: Experiment,
    model: str,
    arrays: dict[str, NDArray[Any]],
    attributes: dict[str, Any],
) -> xr.Dataset:
    """As :func:`assemble`, of as much of an archive as there is."""
    known = _told_by(experiment) | arrays
    table = COORDINATES | VARIABLES
    stray = [name for name in known if name not in table]
    if stray:
        raise ArchiveError(f"{stray[0]!r} is no variable of the archive; known: {', '.join(table)}")
    return xr.Dataset(
        {name: _data_array(VARIABLES[name], known[name]) for name in VARIABLES if name in known},
        {
            name: _data_array(COORDINATES[name], known[name])
            for name in COORDINATES
            if name in known
        },
        {
            "Conventions": CONVENTIONS,
            "title": experiment.title,
            "source": f"{model} of stratify {version('stratify')}",
            "history": history("poured"),
            "references": REFERENCES,
            "model": model,
            "experiment": experiment.to_toml(),
            "seed": experiment.pour.seed,
            **attributes,
        },
    )


def check(dataset: xr.Dataset, absent: Collection[str] = ()) -> xr.Dataset:
    """Return `dataset` if it is an archive as the table says; else raise :class:`ArchiveError`.

    Variables that are `absent` need not be there.
    """
    for name in ATTRIBUTES:
        if name not in dataset.attrs:
            raise ArchiveError(f"attribute {name!r} is missing")
    if dataset.attrs["model"] not in MODELS:
        raise ArchiveError(f"model = {dataset.attrs['model']!r}; allowed: {', '.join(MODELS)}")
    for variable in (COORDINATES | VARIABLES).values():
        if variable.name in dataset.variables:
            _check_variable(dataset[variable.name], variable)
        elif not variable.optional and variable.name not in absent:
            raise ArchiveError(f"variable {variable.name!r} is missing")
    for name in (name for name in ("time", "x", "z") if name not in absent):
        if dataset.sizes[name] < 2 or not (np.diff(dataset[name].values) > 0).all():
            raise ArchiveError(f"{name} should have at least 2 values, and grow")
    return dataset


def history(done: str) -> str:
    """The attribute that says when, and by which version, a file was `done`."""
    now = datetime.now(UTC).isoformat(timespec="seconds")
    return f"{now} {done} by stratify {version('stratify')}"


def write_whole(
    dataset: xr.Dataset,
    path: Path,
    groups: Mapping[str, xr.Dataset] | None = None,
    *,
    force: bool = False,
) -> Path:
    """Write any Dataset as netCDF-4 under a temporary name, then rename: whole or absent.

    `groups` are further Datasets, each put into the file's group of that name. Raises
    :class:`OutputExistsError` where `path` exists and `force` is not given, and
    :class:`ArchiveError` where it cannot be written.
    """
    with whole_file(path, force=force) as part:
        _put(dataset, part, "w")
        for name, group in (groups or {}).items():
            _put(group, part, "a", name)
        put_checksum(part)
    return path


def store(dataset: xr.Dataset, path: Path, mode: Literal["w", "a"] = "w") -> None:
    """Put `dataset` into the netCDF-4 file `path`, a new one or (a) one that holds more.

    The digest that the file then carries is that of `dataset`, the checksum that of the file.
    """
    _put(dataset, path, mode)
    put_checksum(path)


def seal(path: Path, beside: Collection[str] = ()) -> None:
    """Give the finished netCDF-4 file `path` the digest of its root Dataset, and its checksum.

    The Dataset is read in blocks that fit into memory; what the file holds `beside` it is left out.
    """
    with xr.open_dataset(path, engine="netcdf4", drop_variables=beside, cache=False) as stored:
        digest = digest_of(stored)
    with netCDF4.Dataset(path, "a") as file:
        file.setncattr(DIGEST, digest)
    put_checksum(path)


def write(dataset: xr.Dataset, path: Path, *, force: bool = False) -> Path:
    """Write an archive whole or not at all; see :func:`write_whole`."""
    return write_whole(check(dataset), path, force=force)


def read(path: Path) -> xr.Dataset:
    """The archive at `path`, loaded. Raises :class:`ArchiveError` where it is not a whole one."""
    return load(path)


def load(path: Path, absent: Collection[str] = (), beside: Collection[str] = ()) -> xr.Dataset:
    """As :func:`read`, of an archive that lacks what is `absent`; what it has `beside` is left."""
    with reading(path):
        refuse_damaged(path)
        dataset = _intact(path, beside)
        check(dataset, absent)
        _check_experiment(dataset)
    return dataset


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Raise :class:`ArchiveError` where what is read from `path` is not that of a whole archive."""
    if not os.path.isfile(path):  # which does not raise in a folder that nobody may enter
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
    return f"{str(path)!r} is not a whole netCDF-4 archive: {reason}"


def _intact(path: Path, beside: Collection[str]) -> xr.Dataset:
    """The Dataset at `path` without its digest, which it must have and which must be its own."""
    with xr.open_dataset(
        path, engine="netcdf4", decode_cf=False, create_default_indexes=False
    ) as stored:
        told = stored.attrs.pop(DIGEST, None)
        if told is None:
            raise ArchiveError(
                f"it carries no {DIGEST}: another program wrote it, or an older version of this "
                "one; `stratify pour` writes it anew"
            )
        raw = stored.drop_vars(beside, errors="ignore")
        if raw.nbytes > MOST_SQUEEZED * path.stat().st_size:
            raise ArchiveError(f"it is damaged: it claims {raw.nbytes:.2g} bytes of numbers")
        dataset = xr.decode_cf(raw).load()
    if digest_of(dataset) != str(told):
        raise ArchiveError(f"it is damaged or was changed: its content is not that of {DIGEST}")
    return dataset


def experiment_of(dataset: xr.Dataset) -> Experiment:
    """The set-up that an archive carries. Raises :class:`SetupError` where it is unsound."""
    return Experiment.from_toml(str(dataset.attrs.get("experiment", "")))


def _put(
    dataset: xr.Dataset, path: Path, mode: Literal["w", "a"], group: str | None = None
) -> None:
    encoding = {
        name: COMPRESSED | (AS_BYTES if _is_pure(values) else {"_FillValue": None})
        for name, values in dataset.variables.items()
        if values.dtype.kind == "f" and values.size > 0 and values.ndim > 0
    }
    signed = dataset.assign_attrs({DIGEST: digest_of(dataset)})
    signed.to_netcdf(path, mode, format="NETCDF4", group=group, engine="netcdf4", encoding=encoding)


def _is_pure(values: xr.Variable) -> bool:
    """Whether fractions are of whole grains: 0, 1, or NaN where there is nothing."""
    if values.dims != VARIABLES["deposit_fraction"].dims:
        return False
    whole = (values.values == 0.0) | (values.values == 1.0) | np.isnan(values.values)
    return bool(whole.all())


def _told_by(experiment: Experiment) -> dict[str, NDArray[Any]]:
    """The variables that the set-up alone tells."""
    mixture = experiment.mixture
    known: dict[str, NDArray[Any]] = {
        "species_name": np.array(mixture.names, dtype=object),
        "surface_species_name": np.array(mixture.names, dtype=object),
        "repose_slope": np.array(mixture.repose_slope),
        "drift_velocity": np.array(mixture.drift_velocity),
        "grain_diameter": np.array(mixture.grain_diameter),
        "inflow": experiment.mean_inflow,
    }
    if mixture.collision_rate is not None:
        known["collision_rate"] = np.array(mixture.collision_rate)
    return known


def _check_experiment(dataset: xr.Dataset) -> None:
    """Refuse an archive whose variables say otherwise than the set-up that it carries."""
    for name, values in _told_by(experiment_of(dataset)).items():
        if name not in dataset or not np.array_equal(dataset[name].values, values):
            raise ArchiveError(f"{name} is not that of its set-up")


def _data_array(variable: Variable, values: NDArray[Any]) -> xr.Variable:
    if values.ndim != len(variable.dims):
        raise ArchiveError(f"{variable.name} has shape {values.shape}, not {variable.dims}")
    kind = object if variable.dtype == "str" else variable.dtype
    return xr.Variable(variable.dims, values.astype(kind), variable.attributes)


def _check_variable(values: xr.DataArray, variable: Variable) -> None:
    if values.dims != variable.dims:
        raise ArchiveError(f"{variable.name} has dimensions {values.dims}, not {variable.dims}")
    if variable.dtype == "str":
        return
    numbers = values.dtype == np.dtype(variable.dtype)
    if not numbers or not (variable.gaps or np.isfinite(values.values).all()):
        raise ArchiveError(f"{variable.name} holds values that are no {variable.dtype} numbers")
