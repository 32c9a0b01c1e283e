"""What a study found as plain numbers, for JSON."""

import xarray as xr

from compare.table import plain

__all__ = ["study_record"]

MOST_VALUES = 1000


def study_record(found: xr.Dataset) -> dict[str, object]:
    """Title, comment, and every number and word but pictures, as nested lists; None for NaN."""
    record: dict[str, object] = {
        name: found.attrs[name] for name in ("title", "comment") if name in found.attrs
    }
    for name, there in found.variables.items():
        if there.size <= MOST_VALUES:
            record[str(name)] = _plain(there.values.tolist())
    return record


def _plain(values: object) -> object:
    return [_plain(part) for part in values] if isinstance(values, list) else plain(values)
