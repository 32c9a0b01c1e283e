"""The numbers of one pour, and those of several side by side, as Datasets."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from compare.accessor import Strata
from compare.balances import Measured, balances, unbalanced, volume_residual
from compare.quantities import (
    Quantity,
    cell_length,
    quantity,
    settled_thickness,
    total_inflow,
    velocity,
    why_not_measured,
)
from compare.regimes import regime
from experiment import ArchiveError
from experiment.archive import experiment_of

__all__ = ["compare", "in_detail", "measure", "numbers_of", "refuse_unlike"]

OF_ANY = ("layering", "pure_share", "layered_share", "segregation")  # deposit, however thin
BALANCES = {
    "wavelength_of_period": ("cm", "R0 v T / L"),
    "period_residual": ("1", "wavelength over R0 v T / L, less 1"),
    "wavelength_of_velocities": ("cm", "R0 v (1 / v_f + 1 / v_k)"),
    "velocities_residual": ("1", "wavelength over R0 v (1 / v_f + 1 / v_k), less 1"),
    "wavelength_of_kinks": ("cm", "R0 (v + v_k) / v_k"),
    "kinks_residual": ("1", "wavelength over R0 (v + v_k) / v_k, less 1"),
}


def measure(archive: xr.Dataset) -> xr.Dataset:
    """Every number that one archive gives: a Dataset of scalars with units and long names.

    Velocities are magnitudes: kinks go uphill, fronts downhill. Numbers that need layers are NaN
    where the regime has none, those that need lines where there are none. Raises
    :class:`ArchiveError` for a drum, and where the source moves.
    """
    told, comment = numbers_of(archive)
    return xr.Dataset(told, attrs={"comment": comment} if comment else {})


def numbers_of(archive: xr.Dataset) -> tuple[dict[str, Quantity], str]:
    """What :func:`measure` tells, by name, and its comment; empty where there is nothing to say."""
    reason = why_not_measured(archive)
    if reason is not None:
        raise ArchiveError(reason)
    strata: Strata = archive.strata
    kinks, fronts = strata.lines
    laid = strata.laid
    word = regime(
        laid.scalars["layered_share"],
        laid.scalars["segregation"],
        settled_thickness(archive) / total_inflow(archive),
    )
    kink = Measured(*kinks.seen.mean_velocity())
    kink = kink._replace(value=-kink.value)
    front = Measured(*fronts.seen.mean_velocity())
    period = Measured(*kinks.seen.period())
    told = _settled(laid.numbers(), word)
    wavelength = Measured(told["wavelength"][1], told["wavelength_error"][1])
    v, r0, length = velocity(archive), total_inflow(archive), cell_length(archive)
    balanced = balances(archive, wavelength, period, front, kink)
    numbers = (
        {"regime": quantity(word, "", "what the pour did")}
        | _with_error("kink_velocity", kink, "cm s-1", "velocity of kinks, uphill")
        | _with_error("front_velocity", front, "cm s-1", "velocity of avalanche fronts, downhill")
        | _with_error("cycle_period", period, "s", "time between kinks")
    )
    numbers |= {
        "kink_velocity_scaled": quantity(kink.value / v, "1", "kink_velocity / v"),
        "front_velocity_scaled": quantity(front.value / v, "1", "front_velocity / v"),
        "cycle_period_scaled": quantity(period.value * v / length, "1", "cycle_period v / L"),
        "wavelength_scaled": quantity(wavelength.value / r0, "1", "wavelength / R0"),
        "volume_residual": quantity(
            volume_residual(archive),
            "1",
            "poured, but neither rolling nor at rest: the largest part of any species",
        ),
    }
    for name, balance in balanced.items():
        numbers |= _with_error(name, balance, *BALANCES[name])
    thoughts = [
        laid.comment if word != "unsettled" else "",
        unbalanced(balanced["period_residual"]),
    ]
    thoughts += [
        f"{name}: {lines.comment}"
        for name, lines in (("kinks", kinks), ("fronts", fronts))
        if lines.comment
    ]
    return numbers | told, "\n".join(filter(None, thoughts))


def _settled(numbers: dict[str, Quantity], word: str) -> dict[str, Quantity]:
    """The `numbers` of layers; without those that cannot be told where too few were laid."""
    if word != "unsettled":
        return numbers
    return {
        name: told if name.startswith("zone_") or name in OF_ANY else (dims, np.nan, attributes)
        for name, told in numbers.items()
        for dims, _, attributes in [told]
    }


def _with_error(name: str, number: Measured, units: str, long_name: str) -> dict[str, Quantity]:
    return {
        name: quantity(number.value, units, long_name),
        f"{name}_error": quantity(number.error, units, f"standard error of {name}"),
    }


def compare(archives: Sequence[xr.Dataset]) -> xr.Dataset:
    """Both models' numbers over a dimension `model`, and what was published for the mixture.

    A model is chosen by name, as in `comparison.sel(model_name="continuum")`. Raises
    :class:`ArchiveError` where the archives are of different pours.
    """
    refuse_unlike(archives)
    each: list[xr.Dataset] = [archive.strata.measure() for archive in archives]
    measured: xr.Dataset = xr.concat(each, "model", combine_attrs="drop_conflicts")
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
        f"{archive.attrs['model']}: {line}"
        for archive, numbers in zip(archives, each, strict=True)
        for told in (archive, numbers)
        for line in told.attrs.get("comment", "").splitlines()
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


def in_detail(archives: Sequence[xr.Dataset]) -> dict[str, xr.Dataset]:
    """What the numbers of a comparison come from: MODEL/kinks, MODEL/fronts, MODEL/layers.

    As groups of these names they are saved in comparison.nc beside the archives.
    """
    found: dict[str, xr.Dataset] = {}
    for archive in archives:
        strata: Strata = archive.strata
        for name in ("kinks", "fronts", "layers"):
            found[f"{archive.attrs['model']}/{name}"] = getattr(strata, name)()
    return found


def refuse_unlike(archives: Sequence[xr.Dataset]) -> None:
    """Only pours of one set-up can be set side by side; the models' own tables may differ."""
    first, *others = (experiment_of(archive) for archive in archives)
    for other in others:
        for part in ("mixture", "cell", "feed", "pour"):
            if getattr(other, part) != getattr(first, part):
                raise ArchiveError(f"archives of different pours: their {part} is not the same")
