"""Where an archive is: in a file of a folder, or in a group of a Zarr store.

    run/continuum.nc              run.zarr/continuum
    run/continuum.nc.unfinished/  run.continuum.unfinished/    the work on it
    run/comparison.nc             run.comparison.nc            what is made of it

There is no place in a store for what is not Zarr.
"""

from pathlib import Path

__all__ = ["archive_at", "beside", "in_store", "is_archive"]


def in_store(path: Path) -> bool:
    """Whether `path` is in a Zarr store, by the ending of the store."""
    return path.parent.suffix == ".zarr"


def is_archive(path: Path) -> bool:
    """Whether `path` is one that an archive of ours would have, by its ending."""
    return path.suffix == ".nc" or in_store(path)


def archive_at(folder: Path, model: str) -> Path:
    """The archive that a model pours into a folder or a store."""
    return folder / model if in_store(folder / model) else folder / f"{model}.nc"


def beside(path: Path) -> Path:
    """`path`, or where it would be outside the store that it is in."""
    store = path.parent
    return store.with_name(f"{store.stem}.{path.name}") if in_store(path) else path
