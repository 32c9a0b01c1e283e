"""What a phase diagram says in a table: how many points are of which regime, where layers begin."""

from collections import Counter
from collections.abc import Iterator

import numpy as np
import xarray as xr
from rich.table import Table
from rich.text import Text

from compare.phase.boundary import LAYERED_FROM
from compare.phase.patterns import PATTERNS, patterns
from compare.phase.plan import thinned
from compare.phase.theory import ONSET
from compare.table import plain, with_error

__all__ = ["failures", "phase_record", "phase_table"]

MOST_ROWS = 16


def phase_table(diagram: xr.Dataset) -> Table:
    """A row for each regime, then one for where layers begin at each value of the other fields."""
    models = diagram["model_name"].values.tolist()
    sheet = Table("", *models, "spectrum", title=Text(diagram.attrs["title"], style="bold"))
    diagram = diagram.assign(pattern=patterns(diagram))
    counts = {model: _counts(diagram, model, "pattern") for model in models}
    for pattern in PATTERNS:
        numbers = [counts[model][pattern] for model in models]
        if any(numbers):
            sheet.add_row(f"{pattern}: points", *map(str, numbers))
    if LAYERED_FROM in diagram:
        sheet.add_section()
        sheet.add_row(Text(diagram[LAYERED_FROM].attrs["long_name"], style="bold"))
        for row in _rows(diagram):
            sheet.add_row(*row)
    return sheet


def failures(diagram: xr.Dataset) -> list[str]:
    """A line for each reason why points of a model failed, the most frequent first."""
    return [
        f"{model}: {number} failed: {reason}"
        for model in diagram["model_name"].values.tolist()
        for reason, number in _counts(diagram, model, "failure").most_common()
    ]


def phase_record(diagram: xr.Dataset) -> dict[str, object]:
    """The same as plain numbers and words, for JSON; None where there is no number."""
    diagram = diagram.assign(pattern=patterns(diagram))
    record: dict[str, object] = {"title": diagram.attrs["title"]}
    for name, there in diagram.coords.items():
        record[str(name)] = there.values.tolist()
    for model in diagram["model_name"].values.tolist():
        record[model] = {
            "points": dict(_counts(diagram, model, "pattern")),
            "failures": dict(_counts(diagram, model, "failure")),
        } | {
            str(name): _plain(diagram[name].sel(model_name=model))
            for name in diagram.data_vars
            if str(name).startswith(LAYERED_FROM)
        }
    if ONSET in diagram:
        record[ONSET] = _plain(diagram[ONSET])
    return record


def _counts(diagram: xr.Dataset, model: str, name: str) -> Counter[str]:
    words = diagram[name].sel(model_name=model).values.ravel().tolist()
    return Counter(word for word in words if word)


def _rows(diagram: xr.Dataset) -> Iterator[tuple[str, ...]]:
    """A row for each line across the first axis, or for MOST_ROWS of them, as the spectrum has."""
    found = diagram[LAYERED_FROM]
    others = [dim for dim in found.dims if dim != "model"]
    sizes = [diagram.sizes[dim] for dim in others]
    for line in thinned(int(np.prod(sizes)), MOST_ROWS):
        at = dict(zip(others, np.unravel_index(line, sizes), strict=True)) if others else {}
        here = diagram.isel(at)
        fields = (name for name in here.coords if "field" in here[name].attrs)
        said = ", ".join(f"{name} = {_said(here[name])}" for name in fields if not here[name].dims)
        edges = (here[f"{LAYERED_FROM}{end}"].values.tolist() for end in ("", "_error", "_strays"))
        onset = float(here[ONSET]) if ONSET in here else np.nan
        yield (
            f"  at {said}" if said else "",
            *(_edge(*edge) for edge in zip(*edges, strict=True)),
            f"{onset:.3g}" if np.isfinite(onset) else "-",
        )


def _edge(place: float, error: float, strays: float) -> str:
    """A boundary, and how many points do not obey it."""
    return with_error(place, error) + (f" ({strays:.0f} astray)" if strays else "")


def _said(value: xr.DataArray) -> str:
    return f"{value.item():.4g}" if value.dtype.kind in "fi" else str(value.item())


def _plain(values: xr.DataArray) -> object:
    """Numbers as nested lists."""
    if values.ndim:
        return [_plain(part) for part in values]
    return plain(values.item())
