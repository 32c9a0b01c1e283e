"""The numbers of one pour, and those of several side by side, as Datasets.

Two balances tie them together: one cycle of period T lays one wavelength, so wavelength =
R0 v T / L, where the left side comes from the deposit and the right one from the kymograph; and a
cycle is a front's way down and a kink's way up, so wavelength is about R0 v (1 / v_f + 1 / v_k).
"""

import math
from collections.abc import Sequence
from typing import Any

import xarray as xr

from compare.deposit import layers
from compare.kymograph import cycle_period, kinks_and_fronts, mean_velocity
from compare.quantities import (
    cell_length,
    flux,
    rise_velocity,
    settled_thickness,
    total_inflow,
    velocity,
    why_not_measured,
)
from compare.regimes import regime, segregation
from experiment import ArchiveError
from experiment.archive import experiment_of

__all__ = ["compare", "measure", "refuse_unlike"]


def measure(archive: xr.Dataset) -> xr.Dataset:
    """Every number that one archive gives: a Dataset of scalars with units and long names.

    Velocities are magnitudes: kinks go uphill, fronts downhill. Numbers that need layers are NaN
    where the regime is not `stratified`, those that need lines where there are none. Raises
    :class:`ArchiveError` for a drum, and where the source moves.
    """
    reason = why_not_measured(archive)
    if reason is not None:
        raise ArchiveError(reason)
    found = layers(archive)
    apart = segregation(archive)
    strength = float(found["layering"])
    word = regime(strength, apart, settled_thickness(archive) / total_inflow(archive))
    lines_up, lines_down = kinks_and_fronts(archive)
    uphill, kink_error = mean_velocity(lines_up)
    kink = -uphill
    front, front_error = mean_velocity(lines_down)
    period, period_error = cycle_period(lines_up)
    wavelength, error, spread, normal = (
        float(found[name]) if word == "stratified" else math.nan
        for name in (
            "wavelength",
            "wavelength_error",
            "wavelength_spread",
            "wavelength_normal",
        )
    )
    v, r0, length = velocity(archive), total_inflow(archive), cell_length(archive)
    rows: dict[str, tuple[Any, str, str]] = {
        "regime": (word, "", "what the pour did"),
        "layering": (strength, "1", "strength of the layering"),
        "segregation": (apart, "1", "degree of segregation along x"),
        "kink_velocity": (kink, "cm s-1", "velocity of kinks, uphill"),
        "kink_velocity_error": (kink_error, "cm s-1", "standard error of kink_velocity"),
        "front_velocity": (front, "cm s-1", "velocity of avalanche fronts, downhill"),
        "front_velocity_error": (front_error, "cm s-1", "standard error of front_velocity"),
        "cycle_period": (period, "s", "time between kinks"),
        "cycle_period_error": (period_error, "s", "standard error of cycle_period"),
        "wavelength": (wavelength, "cm", "vertical wavelength of the layers"),
        "wavelength_error": (error, "cm", "standard error of wavelength"),
        "wavelength_spread": (spread, "cm", "standard deviation of wavelength over x"),
        "wavelength_normal": (normal, "cm", "wavelength normal to the layers"),
        "wavelength_normal_error": (
            error * normal / wavelength,
            "cm",
            "standard error of wavelength_normal",
        ),
        "wavelength_of_period": (rise_velocity(archive) * period, "cm", "R0 v T / L"),
        "wavelength_of_velocities": (
            flux(archive) * (1 / front + 1 / kink),
            "cm",
            "R0 v (1 / v_f + 1 / v_k)",
        ),
        "kink_velocity_scaled": (kink / v, "1", "kink_velocity / v"),
        "front_velocity_scaled": (front / v, "1", "front_velocity / v"),
        "cycle_period_scaled": (period * v / length, "1", "cycle_period v / L"),
        "wavelength_scaled": (wavelength / r0, "1", "wavelength / R0"),
    }
    return xr.Dataset(
        {
            name: ((), value, {"long_name": meaning} | ({"units": units} if units else {}))
            for name, (value, units, meaning) in rows.items()
        }
    )


def compare(archives: Sequence[xr.Dataset]) -> xr.Dataset:
    """Both models' numbers over a dimension `model`, and what was published for the mixture.

    A model is chosen by name, as in `comparison.sel(model_name="continuum")`. Raises
    :class:`ArchiveError` where the archives are of different pours.
    """
    refuse_unlike(archives)
    measured = xr.concat([measure(archive) for archive in archives], "model")
    measured = measured.assign_coords(
        model_name=("model", [archive.attrs["model"] for archive in archives])
    ).set_xindex("model_name")
    experiment = experiment_of(archives[0])
    published = experiment.published
    notes: dict[str, Any] = {
        "Conventions": archives[0].attrs["Conventions"],
        "title": experiment.title,
        "source": "; ".join(archive.attrs["source"] for archive in archives),
        "history": "; ".join(archive.attrs["history"] for archive in archives),
        "references": archives[0].attrs["references"],
        "experiment": archives[0].attrs["experiment"],
    }
    comments = [
        f"{archive.attrs['model']}: {archive.attrs['comment']}"
        for archive in archives
        if "comment" in archive.attrs
    ]
    if published is not None:
        for name in ("wavelength", "kink_velocity"):
            value = getattr(published, name)
            if value is not None:
                attributes = {"units": measured[name].attrs["units"]}
                attributes["long_name"] = f"published {measured[name].attrs['long_name']}"
                measured[f"published_{name}"] = ((), value, attributes)
        comments.append(f"published {published.note}")
    if comments:
        notes["comment"] = "\n".join(comments)
    return measured.assign_attrs(notes)


def refuse_unlike(archives: Sequence[xr.Dataset]) -> None:
    """Only pours of one set-up can be set side by side; the models' own tables may differ."""
    first, *others = (experiment_of(archive) for archive in archives)
    for other in others:
        for part in ("mixture", "cell", "feed", "pour"):
            if getattr(other, part) != getattr(first, part):
                raise ArchiveError(f"archives of different pours: their {part} is not the same")
