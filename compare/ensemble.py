"""Predictions from inputs that are not well known, and from piles that chance makes unlike.

Each uncertain field of a set-up is drawn between its ends, all alike likely, by a Latin hypercube:
of N draws, one lies in each N-th of every range. The prediction is the distribution of what is
measured, over the draws that stratify. Which input it follows, Spearman's rank correlation tells,
from -1 to 1; of inputs that do not matter it scatters about 0 by 1 / sqrt(N - 1).
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from scipy.stats import qmc, spearmanr

from compare.quantities import named
from compare.regimes import LAYERED_REGIMES
from experiment import Experiment, SetupError
from experiment.arrays import Floats

__all__ = [
    "PREDICTED",
    "QUANTILES",
    "draws",
    "latin_hypercube",
    "mean_and_error",
    "piles",
    "piles_mean",
    "predict",
    "ranges",
    "with_ranges",
]

PREDICTED = ("wavelength", "kink_velocity", "front_velocity")
QUANTILES = (0.05, 0.16, 0.5, 0.84, 0.95)
FEWEST = 4  # draws that have a rank correlation

Variables = dict[str, tuple[str | tuple[str, ...], Any, dict[str, str]]]


def ranges(texts: Sequence[str]) -> dict[str, tuple[float, float]]:
    """The ranges that texts KEY=LOW:HIGH say. Raises :class:`SetupError` where one says none."""
    found = {}
    for text in texts:
        key, equals, ends = text.partition("=")
        try:
            low, high = map(float, ends.split(":"))
        except ValueError:
            equals = ""
        if not equals or not all(key.strip().split(".")):
            raise SetupError(
                f"--vary {text!r}: it should be KEY=LOW:HIGH, as in mixture.psi=0.1:0.3"
            )
        found[key.strip()] = (low, high)
    return found


def with_ranges(experiment: Experiment, uncertain: dict[str, tuple[float, float]]) -> Experiment:
    """The set-up with more that is uncertain. Raises :class:`SetupError` for an unsound range."""
    tables = experiment.model_dump(exclude_none=True)
    return Experiment.parse(tables | {"uncertain": {**experiment.uncertain, **uncertain}})


def draws(
    experiment: Experiment, count: int, seed: int = 0
) -> tuple[list[Experiment], xr.DataArray]:
    """`count` set-ups in each of which what is uncertain has a value, and those values.

    The values are an array (pour, input). Raises :class:`SetupError` where nothing is uncertain, or
    a draw makes no set-up.
    """
    if not experiment.uncertain:
        raise SetupError("uncertain: missing; it should name at least one field to draw")
    names = list(experiment.uncertain)
    values = latin_hypercube(experiment.uncertain, count, seed)
    drawn = [experiment.with_values(dict(zip(names, row, strict=True))) for row in values.tolist()]
    inputs = xr.DataArray(values, dims=("pour", "input"), coords={"input_name": ("input", names)})
    return drawn, inputs.set_xindex("input_name")


def latin_hypercube(
    uncertain: Mapping[str, tuple[float, float]], count: int, seed: int = 0
) -> Floats:
    """`count` draws (draw, input) from the ranges: one of them lies in each part of every range."""
    low, high = np.array(list(uncertain.values())).T
    random = np.random.default_rng(seed)
    cube = qmc.LatinHypercube(len(uncertain), optimization="random-cd", rng=random)
    values: Floats = low + (high - low) * cube.random(count)
    return values


def predict(found: xr.Dataset, inputs: xr.DataArray) -> xr.Dataset:
    """What a campaign over draws says: numbers over `model`, `quantile` and `input`.

    For each NAME of PREDICTED: predicted_NAME(model, quantile), over the draws that stratify and in
    which it was found, and how many those are, predicted_NAME_draws(model), of predicted_draws; and
    predicted_wavelength_follows(model, input), its rank correlation with each input. NaN where too
    few draws tell.
    """
    told: Variables = {}
    for name in PREDICTED:
        values, meaning, units = _of_the_stratified(found, name)
        rows = [_quantiles(row[np.isfinite(row)]) for row in values]
        counts = np.isfinite(values).sum(axis=1)
        told |= {
            f"predicted_{name}": (
                ("model", "quantile"),
                rows,
                named(f"predicted {meaning}", units),
            ),
            f"predicted_{name}_draws": ("model", counts, named(f"draws that tell {name}")),
        }
    wavelength = _of_the_stratified(found, "wavelength")[0]
    follows = [_rank_correlations(row, inputs.values) for row in wavelength]
    poured = (found["failure"] == "").sum("pour").values
    told |= {
        "predicted_draws": ("model", poured, named("draws that were poured")),
        "predicted_wavelength_follows": (
            ("model", "input"),
            follows,
            named("rank correlation of the wavelength with what is uncertain"),
        ),
    }
    quantiles = ("quantile", list(QUANTILES), named("share of the draws that lie below"))
    known = {"quantile": quantiles, "input_name": inputs["input_name"]}
    return xr.Dataset(told, known | {"model_name": found["model_name"]})


def piles(experiment: Experiment, count: int) -> list[Experiment]:
    """`count` piles of one ensemble: set-ups that differ by their random numbers only."""
    return [experiment.with_values({"pour.pile": pile}) for pile in range(count)]


def piles_mean(found: xr.Dataset) -> xr.Dataset:
    """Mean and standard error over the piles of a campaign that stratify, and how many those are.

    For each NAME of PREDICTED: piles_NAME(model), piles_NAME_error and piles_NAME_count; NaN where
    too few piles tell.
    """
    told: Variables = {}
    for name in PREDICTED:
        values, meaning, units = _of_the_stratified(found, name)
        counts = np.isfinite(values).sum(axis=1)
        means, errors = np.transpose([mean_and_error(row[np.isfinite(row)]) for row in values])
        told |= {
            f"piles_{name}": ("model", means, named(f"{meaning}, mean of the piles", units)),
            f"piles_{name}_error": (
                "model",
                errors,
                named(f"standard error of piles_{name}", units),
            ),
            f"piles_{name}_count": ("model", counts, named(f"piles that tell {name}")),
        }
    return xr.Dataset(told, {"model_name": found["model_name"]})


def mean_and_error(values: Floats) -> tuple[float, float]:
    """Mean and its standard error, from the scatter; NaN where too few values tell."""
    n = len(values)
    mean = float(values.mean()) if n else np.nan
    return mean, float(values.std(ddof=1) / np.sqrt(n)) if n > 1 else np.nan


def _of_the_stratified(found: xr.Dataset, name: str) -> tuple[Floats, str, str]:
    """Values (model, pour), NaN where there are no layers, with their long name and units."""
    layered = found["regime"].isin(LAYERED_REGIMES)
    values = found[name].where(layered).transpose("model", "pour").values
    return values, found[name].attrs["long_name"], found[name].attrs["units"]


def _quantiles(values: Floats) -> Floats:
    return np.quantile(values, QUANTILES) if len(values) else np.full(len(QUANTILES), np.nan)


def _rank_correlations(values: Floats, inputs: Floats) -> list[float]:
    """Spearman's rho of `values` (pour,) with each column of `inputs` (pour, input)."""
    there = np.isfinite(values)
    if there.sum() < FEWEST or np.ptp(values[there]) == 0:
        return [np.nan] * inputs.shape[1]
    return [float(spearmanr(column, values[there]).statistic) for column in inputs[there].T]
