"""Pictures of the scaling: both models' wavelength and kinks against the feed, with error bars."""

from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from compare.pictures.style import MARKS, MODEL_NAMES, style
from compare.scaling import fit_wavelength

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_scaling"]

THEORY: dict[str, Any] = {"color": "0.4", "linestyle": "--", "zorder": 0}
BARS: dict[str, Any] = {"linestyle": "", "markersize": 4.5, "capsize": 2.5, "elinewidth": 1.0}


def draw_scaling(points: xr.Dataset) -> "Figure":
    """Three plots of what :func:`compare.scaling.over_inflow` found.

    The wavelength against R0, with its lines; lambda / R0 against v / v_k, with the balance of a
    kink, (v + v_k) / v_k, and that of a cycle, v / v_f + v / v_k; v_k / v against gamma R0 / v.
    """
    from matplotlib.figure import Figure

    with style():
        figure = Figure(figsize=(10.4, 3.6))
        wavelength, balance, kinks = figure.subplots(1, 3)
        for model in points["model_name"].values:
            of_model = points.sel(model_name=model)
            marks = MARKS[model] | BARS | {"label": MODEL_NAMES[model]}
            _draw_wavelength(wavelength, of_model, marks)
            _draw_balance(balance, of_model, marks)
            _draw_kinks(kinks, of_model, marks)
        _finish(wavelength, balance, kinks)
        _draw_lines(wavelength, points)
        wavelength.legend()
        balance.legend()
    return figure


def _draw_wavelength(axes: "Axes", points: xr.Dataset, marks: dict[str, Any]) -> None:
    axes.errorbar(points["total_inflow"], points["wavelength"], points["wavelength_error"], **marks)


def _draw_balance(axes: "Axes", points: xr.Dataset, marks: dict[str, Any]) -> None:
    kink = points["kink_velocity_scaled"]
    axes.errorbar(
        1 / kink,
        points["wavelength_scaled"],
        points["wavelength_scaled_error"],
        points["kink_velocity_scaled_error"] / kink**2,
        **marks,
    )
    cycle = 1 / points["front_velocity_scaled"] + 1 / kink
    axes.plot(1 / kink, cycle, "+", color=marks["color"], markersize=8)


def _draw_kinks(axes: "Axes", points: xr.Dataset, marks: dict[str, Any]) -> None:
    axes.errorbar(
        points["exchange"],
        points["kink_velocity_scaled"],
        points["kink_velocity_scaled_error"],
        **marks,
    )


def _draw_lines(axes: "Axes", points: xr.Dataset) -> None:
    lines = fit_wavelength(points)
    r0 = np.array([0.0, float(points["total_inflow"].max())])
    for model in points["model_name"].values:
        line = lines.sel(model_name=model)
        fitted = float(line["intercept"]) + float(line["slope"]) * r0
        axes.plot(r0, fitted, color=MARKS[model]["color"], zorder=0)


def _finish(wavelength: "Axes", balance: "Axes", kinks: "Axes") -> None:
    wavelength.set(xlabel="R0 (cm)", ylabel="wavelength (cm)", title="is it linear?")
    balance.set(xlabel="v / v_k", ylabel="wavelength / R0", title="a kink's balance")
    kinks.set(xlabel="gamma R0 / v", ylabel="v_k / v", title="how fast kinks climb")
    v_over_kink = np.array([0.0, balance.get_xlim()[1]])
    balance.plot(v_over_kink, 1 + v_over_kink, label="(v + v_k) / v_k", **THEORY)
    balance.plot([], [], "+", color="0.3", markersize=8, label="v / v_f + v / v_k")
    kinks.axhline(1.0, **THEORY)
    for axes in (wavelength, balance, kinks):
        axes.set_xlim(left=0)
        axes.set_ylim(bottom=0)
