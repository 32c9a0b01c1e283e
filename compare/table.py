"""Tables for people: model against model beside the published value, and grid against grid."""

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np
import xarray as xr
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from compare.convergence import QUANTITIES
from compare.ensemble import PREDICTED

__all__ = [
    "as_records",
    "convergence_record",
    "convergence_table",
    "layers_record",
    "layers_table",
    "plain",
    "table",
    "with_error",
]

MOST_DIGITS = 4

ROWS = {
    "regime": "regime",
    "layering": "layering",
    "layered_share": "share of the slope with layers",
    "segregation": "segregation",
    "wavelength": "wavelength, vertical (cm)",
    "wavelength_counted": "  by counting",
    "wavelength_of_period": "  R0 v T / L, and residual",
    "wavelength_of_velocities": "  R0 v (1/v_f + 1/v_k)",
    "wavelength_of_kinks": "  R0 (v + v_k) / v_k",
    "wavelength_upper": "  on the upper slope",
    "wavelength_lower": "  on the lower slope",
    "wavelength_normal": "wavelength, normal (cm)",
    "thickness_small": "  sublayer of small grains",
    "thickness_large": "  sublayer of large grains",
    "wavelength_scaled": "wavelength / R0",
    "kink_velocity": "kink velocity (cm/s)",
    "front_velocity": "front velocity (cm/s)",
    "kink_velocity_scaled": "kink velocity / v",
    "cycle_period": "cycle period (s)",
    "volume_residual": "share of volume not accounted for",
}
RESIDUALS = {
    f"wavelength_of_{name}": f"{name}_residual" for name in ("period", "velocities", "kinks")
}


def table(comparisons: list[xr.Dataset]) -> Table:
    """The comparisons below each other: a row for each number, a column for each model."""
    models = ("ca_model", "continuum")
    sheet = Table("", *models, "published")
    for comparison in comparisons:
        sheet.add_section()
        sheet.add_row(Text(comparison.attrs["title"], style="bold"))
        for name, label in ROWS.items():
            cells = [_cell(comparison, name, model) for model in models]
            if set(cells) - {"", "-"}:
                sheet.add_row(label, *cells, _published(comparison, name))
        for row in (*_predicted_rows(comparison, models), *_piles_rows(comparison, models)):
            sheet.add_row(*row)
    return sheet


def as_records(comparison: xr.Dataset) -> dict[str, object]:
    """A comparison as plain numbers by model and name, for JSON; None where there is no number."""
    measured = [name for name in comparison.data_vars if "model" in comparison[name].dims]
    published = [name for name in comparison.data_vars if "model" not in comparison[name].dims]
    record: dict[str, object] = {
        "title": comparison.attrs["title"],
        "comment": comparison.attrs.get("comment"),
        "published": {
            str(name).removeprefix("published_"): comparison[name].item() for name in published
        },
    }
    for model in comparison["model_name"].values:
        chosen = comparison[measured].sel(model_name=model)
        record[str(model)] = {str(name): _plain_of(chosen[name]) for name in measured}
    return record


def convergence_table(convergence: xr.Dataset) -> Table:
    """A row for each grid, then the observed orders, then what the columns tend to."""
    heads = ("cells", "dx (cm)", *(ROWS[name] for name in QUANTITIES))
    sheet = Table(*heads, title=Text(convergence.attrs["title"], style="bold"))
    for cells in convergence["cells"].values:
        grid = convergence.sel(cells=cells)
        values = (with_error(*_value_and_error(grid, name)) for name in QUANTITIES)
        sheet.add_row(str(cells), f"{grid['dx'].item():g}", *values)
    sheet.add_section()
    orders = (convergence[f"{name}_order"].item() for name in QUANTITIES)
    sheet.add_row("order", "", *("-" if math.isnan(order) else f"{order:.2f}" for order in orders))
    limits = (_value_and_error(convergence, f"{name}_extrapolated") for name in QUANTITIES)
    sheet.add_row("limit", "0", *(with_error(*limit) for limit in limits))
    return sheet


def convergence_record(convergence: xr.Dataset) -> dict[str, object]:
    """A convergence as plain numbers by name, for JSON: over the grids a list; None for NaN."""
    record: dict[str, object] = {name: convergence.attrs[name] for name in ("title", "comment")}
    for name in (*convergence.coords, *convergence.data_vars):
        numbers = convergence[name].values.tolist()
        over_grids = isinstance(numbers, list)
        record[str(name)] = [plain(n) for n in numbers] if over_grids else plain(numbers)
    return record


def layers_table(found: xr.Dataset) -> Table:
    """A row for each number of a deposit's layers, with its error where one is known."""
    sheet = Table("", escape(found.attrs["title"]))
    for name in _single_numbers(found):
        if name.removesuffix("_error") != name and name.removesuffix("_error") in found:
            continue
        error = found.get(f"{name}_error", xr.DataArray(np.nan)).item()
        unit = found[name].attrs.get("units", "1")
        label = str(found[name].attrs["long_name"]) + (f" ({unit})" if unit != "1" else "")
        value = found[name].item()
        cell = value if isinstance(value, str) else with_error(value, error)
        if cell != "-":
            sheet.add_row(Text(label), cell)
    return sheet


def layers_record(found: xr.Dataset) -> dict[str, object]:
    """A deposit's layers as plain numbers by name, for JSON; None where there is no number."""
    about: dict[str, object] = {name: found.attrs[name] for name in ("title", "comment")}
    return about | {name: plain(found[name].item()) for name in _single_numbers(found)}


def with_error(value: float, error: float) -> str:
    """A number with as many digits as its standard error warrants, such as 3.021 ± 0.002."""
    if not math.isfinite(value):
        return "-"
    if not math.isfinite(error) or error <= 0:
        return f"{value:.4g}"
    digits = min(max(0, 1 - math.floor(math.log10(error))), MOST_DIGITS)
    return f"{value:.{digits}f} ± {error:.{digits}f}"


def _cell(comparison: xr.Dataset, name: str, model: str) -> str:
    if model not in comparison["model_name"].values:
        return ""
    value = comparison[name].sel(model_name=model).item()
    if isinstance(value, str):
        return value
    error = f"{name}_error"
    known = error in comparison
    text = with_error(value, comparison[error].sel(model_name=model).item() if known else np.nan)
    residual = comparison[RESIDUALS[name]].sel(model_name=model) if name in RESIDUALS else np.nan
    return f"{text} ({residual:+.1%})" if math.isfinite(residual) else text


def _predicted_rows(comparison: xr.Dataset, models: Sequence[str]) -> Iterator[Sequence[str]]:
    """What is predicted from uncertain inputs, and which of them the wavelength follows."""
    if "predicted_draws" not in comparison:
        return

    def row(label: str, cell: Callable[[xr.Dataset], str], published: str = "") -> Sequence[str]:
        return (label, *_cells(comparison, models, cell), published)

    yield row("predicted: median, 16 to 84 %", lambda _: "")
    for name in PREDICTED:
        yield row(f"  {ROWS[name]}", partial(_range, name), _published(comparison, name))
    yield row("  draws with layers", _draws_with_layers)
    yield row("rank correlation of wavelength with", _by_chance)
    for key in comparison["input_name"].values:
        yield row(f"  {key}", partial(_follows, key))


def _piles_rows(comparison: xr.Dataset, models: Sequence[str]) -> Iterator[Sequence[str]]:
    """Means over piles that differ by chance."""
    if "piles_wavelength" not in comparison:
        return
    yield ("mean of the piles that stratify", *_cells(comparison, models, _number_of_piles), "")
    for name in PREDICTED:
        cells = _cells(comparison, models, partial(_mean_of_piles, name))
        yield (f"  {ROWS[name]}", *cells, _published(comparison, name))


def _cells(
    comparison: xr.Dataset, models: Sequence[str], cell: Callable[[xr.Dataset], str]
) -> list[str]:
    there = comparison["model_name"].values
    return [cell(comparison.sel(model_name=m)) if m in there else "" for m in models]


def _range(name: str, predicted: xr.Dataset) -> str:
    low, middle, high = predicted[f"predicted_{name}"].sel(quantile=[0.16, 0.5, 0.84]).values
    return f"{middle:.3g}, {low:.3g} to {high:.3g}" if math.isfinite(middle) else "-"


def _draws_with_layers(predicted: xr.Dataset) -> str:
    with_layers = predicted["predicted_wavelength_draws"].item()
    return f"{with_layers} of {predicted['predicted_draws'].item()}"


def _by_chance(predicted: xr.Dataset) -> str:
    draws = predicted["predicted_wavelength_draws"].item()
    return f"(by chance ± {1 / math.sqrt(draws - 1):.2f})" if draws > 1 else ""


def _follows(key: str, predicted: xr.Dataset) -> str:
    value = predicted["predicted_wavelength_follows"].sel(input_name=key).item()
    return f"{value:.2f}" if math.isfinite(value) else "-"


def _number_of_piles(told: xr.Dataset) -> str:
    count = told["piles_wavelength_count"].item()
    return f"{count:.0f} piles" if math.isfinite(count) else ""


def _mean_of_piles(name: str, told: xr.Dataset) -> str:
    return with_error(told[f"piles_{name}"].item(), told[f"piles_{name}_error"].item())


def _value_and_error(numbers: xr.Dataset, name: str) -> tuple[float, float]:
    return numbers[name].item(), numbers[f"{name}_error"].item()


def _single_numbers(numbers: xr.Dataset) -> list[str]:
    return [str(name) for name, values in numbers.data_vars.items() if not values.dims]


def _published(comparison: xr.Dataset, name: str) -> str:
    published = f"published_{name}"
    return f"{comparison[published].item():g}" if published in comparison else ""


def _plain_of(values: xr.DataArray) -> object:
    """A number, or the numbers by the quantile or the input that they are of."""
    if not values.ndim:
        return plain(values.item())
    labels = values["input_name" if "input" in values.dims else "quantile"].values
    return {
        str(label): plain(one) for label, one in zip(labels, values.values.tolist(), strict=True)
    }


def plain(value: object) -> object:
    """What JSON has for a number or a word: None for NaN."""
    return None if isinstance(value, float) and not math.isfinite(value) else value
