"""Shared fixtures: floating-point errors are failures, and each preset is poured once."""

import signal
from collections.abc import Callable, Iterator
from types import ModuleType

import numpy as np
import pytest
import xarray as xr

import ca_model
import continuum
from experiment import Experiment, load

MODELS = {"ca_model": ca_model, "continuum": continuum}


@pytest.fixture(scope="session", autouse=True)
def ctrl_c_is_heard() -> None:
    """Also where the tests were started in the background of a shell that has it ignored."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True)
def floating_point_errors_are_failures() -> Iterator[None]:
    with np.errstate(divide="raise", over="raise", invalid="raise"):
        yield


@pytest.fixture(scope="session")
def poured() -> Callable[..., xr.Dataset]:
    """The archive of a preset in a model, with settings; the same call pours only once."""
    kept: dict[tuple[str, ...], xr.Dataset] = {}

    def pour(model: str, preset: str, *settings: str) -> xr.Dataset:
        key = (model, preset, *settings)
        if key not in kept:
            kept[key] = MODELS[model].pour(load(preset, settings))
        return kept[key]

    return pour


@pytest.fixture(scope="session")
def models() -> dict[str, ModuleType]:
    """Both models by name."""
    return MODELS


@pytest.fixture
def small_pour() -> Experiment:
    """A short stratifying pour that either model finishes in milliseconds."""
    settings = ["cell.length=20.0", "pour.duration=50.0", "pour.records=20", "continuum.cells=40"]
    return load("makse-stratification", settings)
