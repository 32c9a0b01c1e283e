"""One netCDF-4 file per model run: the same names from both models, whole or absent.

:func:`assemble` builds the Dataset from plain arrays and refuses what the table of variables does
not know; :func:`write` puts it under its final name only once it is complete; :func:`read` refuses
whatever is not such a file, or not the one that was written (:mod:`experiment.archive.digest`).
"""

from collections.abc import Collection
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from experiment.archive.provenance import stamp, version
from experiment.archive.storage import read_whole, reading, write_whole
from experiment.archive.variables import COORDINATES, VARIABLES, Variable
from experiment.errors import ArchiveError
from experiment.experiment import Experiment

__all__ = [
    "CONVENTIONS",
    "REFERENCES",
    "assemble",
    "check",
    "experiment_of",
    "history",
    "lay_out",
    "load",
    "read",
    "write",
]

CONVENTIONS = "CF-1.11"
REFERENCES = "H. A. Makse, Phys. Rev. E 56, 7008 (1997), doi:10.1103/PhysRevE.56.7008"
MODELS = ("ca_model", "continuum")
ATTRIBUTES = ("Conventions", "title", "source", "history", "references", "model", "experiment")


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
            "history": history("poured"),
            "references": REFERENCES,
            **stamp(model, experiment),
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
            _check_variable(dataset.variables[variable.name], variable)
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


def write(dataset: xr.Dataset, path: Path, *, force: bool = False) -> Path:
    """Write an archive whole or not at all; see :func:`write_whole`."""
    return write_whole(check(dataset), path, force=force)


def read(path: Path) -> xr.Dataset:
    """The archive at `path`, loaded. Raises :class:`ArchiveError` where it is not a whole one."""
    return load(path)


def load(path: Path, absent: Collection[str] = (), beside: Collection[str] = ()) -> xr.Dataset:
    """As :func:`read`, of an archive that lacks what is `absent`; what it has `beside` is left."""
    dataset = read_whole(path, beside=beside)
    with reading(path):
        check(dataset, absent)
        _check_experiment(dataset)
    return dataset


def experiment_of(dataset: xr.Dataset) -> Experiment:
    """The set-up that an archive carries. Raises :class:`SetupError` where it is unsound."""
    return _experiment_in(str(dataset.attrs.get("experiment", "")))


@lru_cache(maxsize=8)
def _experiment_in(text: str) -> Experiment:
    return Experiment.from_toml(text)


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
    return xr.Variable(variable.dims, values.astype(kind, copy=False), variable.attributes)


def _check_variable(values: xr.Variable, variable: Variable) -> None:
    if values.dims != variable.dims:
        raise ArchiveError(f"{variable.name} has dimensions {values.dims}, not {variable.dims}")
    if variable.dtype == "str":
        return
    numbers = values.dtype == np.dtype(variable.dtype)
    if not numbers or not (variable.gaps or np.isfinite(values.values).all()):
        raise ArchiveError(f"{variable.name} holds values that are no {variable.dtype} numbers")
