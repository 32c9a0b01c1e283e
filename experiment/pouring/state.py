"""Named arrays and files: the state of a pour, and other arrays without dimensions of their own."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

__all__ = ["State", "arrays_in", "arrays_of", "bare_dataset", "put_back"]

State = dict[str, NDArray[Any]]


def arrays_of(structure: tuple[Any, ...], prefix: str = "") -> State:
    """The arrays of a NamedTuple, as they are kept, by the names of its fields."""
    fields = zip(structure._fields, structure, strict=True)  # type: ignore[attr-defined]
    return {f"{prefix}{name}": array for name, array in fields if isinstance(array, np.ndarray)}


def put_back(arrays: State, state: State) -> None:
    """Overwrite `arrays` by those of `state` that have their names.

    Raises LookupError for one that is missing, and ValueError for one of another shape or type.
    """
    for name, array in arrays.items():
        if state[name].shape != array.shape or state[name].dtype != array.dtype:
            raise ValueError(f"its {name} is not one of this set-up")
        array[...] = state[name]


def bare_dataset(arrays: Mapping[str, NDArray[Any]]) -> xr.Dataset:
    """The arrays as a Dataset, each with dimensions of its own."""
    return xr.Dataset(
        {
            name: ([f"{name}_{k}" for k in range(array.ndim)], array)
            for name, array in arrays.items()
        }
    )


def arrays_in(dataset: xr.Dataset) -> State:
    """The arrays of a Dataset."""
    return {str(name): values.values for name, values in dataset.variables.items()}
