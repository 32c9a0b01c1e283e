"""Where layers begin along the first axis of a diagram, as it was measured.

Of the places between two neighbouring points, the boundary is at the one that leaves the fewest
points on the wrong side: layered ones before it, or others after it. In that gap it is where the
share of the slope that has layers passes LAYERED_SHARE, on a straight line; half of the gap is its
error. Points without a regime count on neither side.
"""

from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from compare.deposit.zones import LAYERED_SHARE
from compare.quantities import named
from compare.regimes import LAYERED_REGIMES
from experiment.arrays import Floats

__all__ = ["LAYERED_FROM", "boundary"]

LAYERED_FROM = "layered_from"


class Edge(NamedTuple):
    """Where a row of points begins to be layered; NaN where it does not, or all of it is."""

    place: float
    error: float
    strays: int  # points on the wrong side


def boundary(diagram: xr.Dataset, first: str) -> dict[str, xr.Variable]:
    """Where layers begin along the axis `first`, which is of numbers that grow.

    Over the other axes and `model`: layered_from and layered_from_error, in the unit of the field,
    and layered_from_strays, the points on the wrong side of it. NaN where a row has layers
    everywhere or nowhere, or has them at low values only.
    """
    regime = diagram["regime"].transpose(first, ...)
    rows = diagram.sizes[first], -1
    layered = regime.isin(LAYERED_REGIMES).values.reshape(rows)
    known = ~regime.isin(("", "unsettled")).values.reshape(rows)
    share = diagram["layered_share"].transpose(first, ...).values.reshape(rows)
    edges = [
        _edge(diagram[first].values, *row) for row in zip(share.T, layered.T, known.T, strict=True)
    ]
    field, units = (diagram[first].attrs[name] for name in ("field", "units"))
    told = {
        LAYERED_FROM: named(f"{field} from which on there are layers", units),
        f"{LAYERED_FROM}_error": named("half of the gap in which it lies", units),
        f"{LAYERED_FROM}_strays": named("points on the wrong side of it"),
    }
    columns = np.array(edges).reshape(-1, len(told)).T
    return {
        name: xr.Variable(regime.dims[1:], column.reshape(regime.shape[1:]), attributes)
        for (name, attributes), column in zip(told.items(), columns, strict=True)
    }


def _edge(
    values: Floats, share: Floats, layered: NDArray[np.bool_], known: NDArray[np.bool_]
) -> Edge:
    """The boundary in a row of points at the `values` of the first axis."""
    x, share, layered = values[known], share[known], layered[known]
    strays = np.append(0, np.cumsum(layered)) + np.append(0, np.cumsum(~layered[::-1]))[::-1]
    best = int(strays.argmin())
    if not 0 < best < len(x):
        return Edge(np.nan, np.nan, int(strays[best]))
    before, after = share[best - 1], share[best]
    rises = before < LAYERED_SHARE <= after
    part = (LAYERED_SHARE - before) / (after - before) if rises else 0.5
    gap = x[best] - x[best - 1]
    return Edge(float(x[best - 1] + part * gap), float(gap / 2), int(strays[best]))
