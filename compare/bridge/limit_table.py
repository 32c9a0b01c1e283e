"""What the study of small grains found, in a table."""

import math
from collections.abc import Iterator

import xarray as xr
from rich.table import Table
from rich.text import Text

from compare.bridge.limit import ONE
from compare.convergence import QUANTITIES
from compare.table import with_error

__all__ = ["limit_table"]

HEADS = ("wavelength (cm)", "kink velocity (cm/s)", "front velocity (cm/s)")


def limit_table(found: xr.Dataset) -> Table:
    """Means for each size of grains on each width of columns, the laws, and what was changed.

    In brackets is how far a number is from the continuum on that grid.
    """
    sheet = Table("w (cm)", "n", *HEADS, title=Text(found.attrs["title"], style="bold"))
    for width in found["width"].values:
        for row in _of_width(found.sel(width=width)):
            sheet.add_row(f"{width:g}", *row)
        sheet.add_section()
    extrapolated = (_number(found, f"{name}_extrapolated") for name in QUANTITIES)
    sheet.add_row("-> 0", "continuum", *extrapolated)
    sheet.add_section()
    for cause in found["cause_name"].values if found.sizes["cause"] else ():
        there = found.isel(cause=found["cause_name"].values.tolist().index(cause))
        cells = (_against(there, f"cause_{name}", f"cause_{name}_continuum") for name in QUANTITIES)
        sheet.add_row(f"{ONE[1]:g}, {cause}", str(ONE[0]), *cells)
    return sheet


def _of_width(there: xr.Dataset) -> Iterator[tuple[str, ...]]:
    """The sizes poured on columns of a width, the continuum on its grid, and the law."""
    for n in there["fineness"].values:
        at = there.sel(fineness=n)
        if any(math.isfinite(at[name].item()) for name in QUANTITIES):
            yield str(n), *(_against(at, name, f"{name}_continuum") for name in QUANTITIES)
    yield "continuum", *(_number(there, f"{name}_continuum") for name in QUANTITIES)
    if math.isfinite(there[f"{QUANTITIES[0]}_exponent"].item()):
        for part, label in (("amplitude", "A"), ("exponent", "p"), ("remainder", "c")):
            yield label, *(_number(there, f"{name}_{part}") for name in QUANTITIES)


def _number(found: xr.Dataset, name: str) -> str:
    return with_error(found[name].item(), found[f"{name}_error"].item())


def _against(found: xr.Dataset, name: str, continuum: str) -> str:
    value, expected = found[name].item(), found[continuum].item()
    told = _number(found, name)
    return f"{told} ({value / expected - 1:+.1%})" if math.isfinite(value) else told
