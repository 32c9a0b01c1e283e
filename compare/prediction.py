"""What a comparison says beyond its archives: ranges from uncertain inputs, means over piles."""

from collections.abc import Mapping, Sequence

import xarray as xr

from compare.campaign import campaign, with_chance
from compare.ensemble import draws, piles, piles_mean, predict, with_ranges
from experiment import Experiment
from experiment.archive import experiment_of
from experiment.pouring import Progress

__all__ = ["base", "models_with_chance", "with_piles", "with_prediction"]


def base(
    archives: Sequence[xr.Dataset], uncertain: Mapping[str, tuple[float, float]] | None = None
) -> Experiment:
    """The set-up of `archives`, each model's own table from its own archive, and what is uncertain.

    Raises :class:`SetupError` for an unsound range of `uncertain`, which adds to the set-up's own.
    """
    tables = {
        archive.attrs["model"]: getattr(experiment_of(archive), archive.attrs["model"])
        for archive in archives
    }
    experiment = experiment_of(archives[0]).model_copy(update=tables)
    return with_ranges(experiment, dict(uncertain or {}))


def with_prediction(
    comparison: xr.Dataset, experiment: Experiment, count: int, progress: Progress | None = None
) -> xr.Dataset:
    """The comparison with what :func:`predict` tells of `count` draws of what is uncertain."""
    drawn, inputs = draws(experiment, count)
    found = campaign(drawn, comparison["model_name"].values.tolist(), progress=progress)
    ranges = (f"{key} {low:g} to {high:g}" for key, (low, high) in experiment.uncertain.items())
    said = f"predicted from {count} draws (Latin hypercube) of {', '.join(ranges)}"
    return _beside(comparison, predict(found, inputs), [said, *_failures(found)])


def with_piles(
    comparison: xr.Dataset, experiment: Experiment, count: int, progress: Progress | None = None
) -> xr.Dataset:
    """The comparison with what :func:`piles_mean` tells of `count` piles.

    The numbers of a model in which chance has no part are NaN.
    """
    models = comparison["model_name"].values.tolist()
    found = campaign(
        piles(experiment, count), models_with_chance(experiment, models), progress=progress
    )
    by_name = piles_mean(found).swap_dims(model="model_name").reindex(model_name=models)
    return _beside(comparison, by_name.swap_dims(model_name="model"), _failures(found))


def models_with_chance(experiment: Experiment, models: Sequence[str]) -> list[str]:
    """Those in which piles that differ in their random numbers are not alike."""
    return [model for model in models if with_chance(experiment, model)]


def _failures(found: xr.Dataset) -> list[str]:
    """How many pours of each model failed, and why the first of them did."""
    told = []
    for model, row in zip(found["model_name"].values, found["failure"].values, strict=True):
        reasons = row[row != ""]
        if len(reasons):
            told.append(f"{model}: {len(reasons)} of {len(row)} pours failed: {reasons[0]}")
    return told


def _beside(comparison: xr.Dataset, told: xr.Dataset, comments: list[str]) -> xr.Dataset:
    comment = "\n".join([*comparison.attrs.get("comment", "").splitlines(), *comments])
    return comparison.merge(told).assign_attrs(comparison.attrs | {"comment": comment})
