"""How layers and kinks follow the feed: both models in one set of scaled variables.

    lambda = a + b R0                 is it linear, and with which slope and intercept
    lambda / R0 = (v + v_k) / v_k     a kink's volume balance, where fronts run at v
    v_k / v against gamma R0 / v      kinks climb by exchange, at some part of gamma R0

A line is fitted by weighted least squares. How far the law is from straight, the coefficient c of
an added c R0^2 tells, against its error. Where points scatter by more than their errors, chi2 / dof
is above 1, and the errors of the fit are larger by its root.
"""

from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from compare.quantities import named
from compare.regimes import LAYERED_REGIMES
from experiment.arrays import Floats

__all__ = ["Polynomial", "fit", "fit_wavelength", "over_inflow"]

MEASURED = ("wavelength", "kink_velocity", "front_velocity")
DIGITS = 9  # of R0 in cm, by which pours are told apart

Groups = list[NDArray[np.bool_]]
Variables = dict[str, tuple[str | tuple[str, ...], NDArray[Any], dict[str, str]]]


class Polynomial(NamedTuple):
    """Coefficients, from the constant on, their standard errors, and how well they fit."""

    values: Floats
    errors: Floats
    chi2_dof: float  # NaN where there were only as many points as coefficients


def fit(x: Floats, y: Floats, errors: Floats, degree: int = 1) -> Polynomial:
    """The polynomial through `y` (point,) with standard `errors`; points without are left out.

    NaN where fewer points than coefficients are left.
    """
    there = np.isfinite(y) & np.isfinite(errors) & (errors > 0)
    points, unknowns = int(there.sum()), degree + 1
    if points < unknowns:
        return Polynomial(np.full(unknowns, np.nan), np.full(unknowns, np.nan), np.nan)
    weighted = np.vander(x[there], unknowns, increasing=True) / errors[there, None]
    target = y[there] / errors[there]
    covariance = np.linalg.inv(weighted.T @ weighted)
    values = covariance @ weighted.T @ target
    chi2 = float(((target - weighted @ values) ** 2).sum())
    chi2_dof = chi2 / (points - unknowns) if points > unknowns else np.nan
    inflated = chi2_dof if chi2_dof > 1 else 1.0
    return Polynomial(values, np.sqrt(inflated * np.diag(covariance)), chi2_dof)


def over_inflow(found: xr.Dataset) -> xr.Dataset:
    """The pours of a campaign by their R0: means of those that stratify, with standard errors.

    Over `model` and `total_inflow` [cm]: wavelength, kink_velocity and front_velocity, the same
    scaled (lambda / R0, v_k / v, v_f / v), each with its `_error`, which counts the scatter of
    piles and what each was measured to; `pours`, how many stratify, and `one_pair`, how many lay
    one pair of layers a cycle, whose wavelength alone counts; and exchange(total_inflow), which is
    gamma R0 / v.
    """
    found = found.transpose("model", "pour").isel(pour=(found["failure"] == "").any("model").values)
    inflow, v, gamma = (
        np.fmax.reduce(found[name].values)  # whichever model tells
        for name in ("total_inflow", "drift_velocity", "collision_rate")
    )
    levels, level = np.unique(np.round(inflow, DIGITS), return_inverse=True)
    groups = [level == k for k in range(len(levels))]
    exchange = np.array([(gamma * inflow / v)[g].mean() for g in groups])
    points: Variables = {"exchange": ("total_inflow", exchange, named("gamma R0 / v"))}
    stratified = found["regime"].isin(LAYERED_REGIMES).values
    pairs = (found["wavelength_of_velocities"] / found["wavelength"]).values
    one_pair = stratified & (np.rint(pairs) == 1)
    for name, counted, meaning in (
        ("pours", stratified, "pours that stratify"),
        ("one_pair", one_pair, "pours that lay one pair of layers a cycle"),
    ):
        counts = np.array([[row[g].sum() for g in groups] for row in counted])
        points[name] = (("model", "total_inflow"), counts, named(meaning))
    for name in MEASURED:
        counted, scale = (one_pair, inflow) if name == "wavelength" else (stratified, v)
        values = np.where(counted, found[name].values, np.nan)
        errors = found[f"{name}_error"].values
        points |= _means(name, values, errors, groups, dict(found[name].attrs))
        by = "R0" if name == "wavelength" else "v"
        scaled = f"{name}_scaled"
        points |= _means(scaled, values / scale, errors / scale, groups, named(f"{name} / {by}"))
    r0 = ("total_inflow", levels, dict(found["total_inflow"].attrs))
    return xr.Dataset(points, {"total_inflow": r0, "model_name": found["model_name"]})


def fit_wavelength(points: xr.Dataset) -> xr.Dataset:
    """The line lambda = intercept + slope R0 of each model, from :func:`over_inflow`.

    Over `model`: slope, intercept [cm] and curvature [1/cm], of R0^2, each with its `_error`, and
    the chi2_dof of the line.
    """
    r0 = points["total_inflow"].values
    rows = list(zip(points["wavelength"].values, points["wavelength_error"].values, strict=True))
    lines, bends = ([fit(r0, *row, degree) for row in rows] for degree in (1, 2))
    found: Variables = {}
    for name, fits, power, units, meaning in (
        ("intercept", lines, 0, "cm", "wavelength at R0 = 0"),
        ("slope", lines, 1, "1", "d wavelength / d R0"),
        ("curvature", bends, 2, "cm-1", "coefficient of R0^2"),
    ):
        values, errors = (
            np.array([getattr(one, part)[power] for one in fits]) for part in ("values", "errors")
        )
        found[name] = ("model", values, named(meaning, units))
        found[f"{name}_error"] = ("model", errors, named(f"standard error of {name}", units))
    chi2_dof = np.array([line.chi2_dof for line in lines])
    found["chi2_dof"] = ("model", chi2_dof, named("chi2 of the line over its degrees of freedom"))
    return xr.Dataset(found, {"model_name": points["model_name"]})


def _means(
    name: str, values: Floats, errors: Floats, groups: Groups, attributes: dict[str, str]
) -> Variables:
    """Mean and its error (model, total_inflow) over each group of pours."""
    found = np.array(
        [[_mean(row[g], own[g]) for g in groups] for row, own in zip(values, errors, strict=True)]
    )
    dims = ("model", "total_inflow")
    error = named(f"standard error of {name}", attributes["units"])
    return {name: (dims, found[..., 0], attributes), f"{name}_error": (dims, found[..., 1], error)}


def _mean(values: Floats, errors: Floats) -> tuple[float, float]:
    """Mean of independent values and its standard error, from their scatter and own errors."""
    there = np.isfinite(values)
    n = int(there.sum())
    if n == 0:
        return np.nan, np.nan
    scatter = float(values[there].std(ddof=1)) if n > 1 else 0.0
    own = float(np.median(errors[there]))
    return float(values[there].mean()), max(scatter, own) / float(np.sqrt(n))
