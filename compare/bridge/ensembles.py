"""Set-ups that are poured again and again, each pile with random numbers of its own."""

from collections.abc import Sequence
from itertools import chain

import numpy as np
import xarray as xr

from compare.campaign import campaign
from compare.convergence import QUANTITIES
from compare.ensemble import mean_and_error, piles
from compare.quantities import named
from compare.regimes import LAYERED_REGIMES
from experiment import Experiment
from experiment.arrays import Floats
from experiment.pouring import Progress

__all__ = ["means_over_piles", "pour_alike", "pour_piles", "share_of", "with_own_errors"]


def pour_piles(
    setups: Sequence[Experiment],
    seeds: int,
    *,
    model: str = "ca_model",
    workers: int | None = None,
    progress: Progress | None = None,
) -> xr.Dataset:
    """What is measured in each of `seeds` piles of each of `setups`, over `setup` and `pile`.

    `workers` and `progress` are those of :func:`compare.campaign`.
    """
    return pour_alike(
        [piles(setup, seeds) for setup in setups], model=model, workers=workers, progress=progress
    )


def pour_alike(
    ensembles: Sequence[Sequence[Experiment]],
    *,
    model: str,
    workers: int | None = None,
    progress: Progress | None = None,
) -> xr.Dataset:
    """The same of ensembles of any kind, all of them of as many set-ups."""
    every = list(chain.from_iterable(ensembles))
    found = campaign(every, [model], workers=workers, progress=progress).isel(model=0, drop=True)
    shape = len(ensembles), len(ensembles[0])
    return xr.Dataset(
        {
            str(name): (("setup", "pile"), there.values.reshape(shape), there.attrs)
            for name, there in found.data_vars.items()
        }
    )


def means_over_piles(found: xr.Dataset) -> xr.Dataset:
    """Mean and standard error of QUANTITIES over the piles with layers, and the scatter of those.

    For each NAME over `setup`: NAME, NAME_error, NAME_scatter (standard deviation of the piles) and
    NAME_count, how many piles tell it; NaN where too few do.
    """
    layered = found["regime"].isin(LAYERED_REGIMES)
    told: dict[str, tuple[str, Floats, dict[str, str]]] = {}
    for name in QUANTITIES:
        units, meaning = found[name].attrs["units"], found[name].attrs["long_name"]
        values = found[name].where(layered).values
        there = [row[np.isfinite(row)] for row in values]
        means, errors = np.transpose([mean_and_error(row) for row in there])
        counts = np.array([len(row) for row in there])
        told |= {
            name: ("setup", means, named(f"{meaning}, mean of the piles", units)),
            f"{name}_error": ("setup", errors, named(f"standard error of {name}", units)),
            f"{name}_scatter": (
                "setup",
                errors * np.sqrt(counts),
                named(f"standard deviation of {name} over the piles", units),
            ),
            f"{name}_count": ("setup", counts, named(f"piles that tell {name}")),
        }
    return xr.Dataset(told)


def with_own_errors(means: xr.Dataset, found: xr.Dataset) -> xr.Dataset:
    """The means over piles of `found`; the error of piles that are all alike is that of one."""
    errors: dict[str, xr.DataArray] = {}
    for name in QUANTITIES:
        alike = found[name].min("pile") == found[name].max("pile")
        own = found[f"{name}_error"].median("pile")
        errors[f"{name}_error"] = means[f"{name}_error"].where(~alike, own)
    return means.assign(errors)


def share_of(progress: Progress, begin: float, end: float) -> Progress:
    """What is told how far a part of the work is, which is from `begin` to `end` of the whole."""
    return lambda share: progress(begin + (end - begin) * share)
