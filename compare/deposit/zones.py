"""Zones along the slope: where small grains lie alone, where large ones do, where there are layers.

Segregation is the standard deviation over x of the column's mean coarseness, over its largest
possible value sqrt(f (1 - f)), f the coarseness of all: 1 for species that lie apart.

A column belongs to the small (large) grains where the mean coarseness of what was laid is below
PURE (above 1 - PURE); and to the layers where these are at least FAINTEST strong and either of a
piece along the slope (COHERENT) or in good order along the vertical (REGULAR), for layers may be
irregular, and in columns much narrower than a layer grains are ragged. A zone is the longest run of
such columns; it begins at the upper edge of the first one.
"""

import numpy as np
from numpy.typing import NDArray

from experiment.arrays import Floats

__all__ = ["LAYERED_SHARE", "zones"]

PURE = 0.1
FAINTEST = 0.1
COHERENT = 0.4
REGULAR = 0.45
LAYERED_SHARE = 0.2  # of the slope, from which on a deposit counts as layered
DIGITS = 9  # of edges in cm, that the pouring point be at 0


def zones(
    x: Floats, coarseness: Floats, layering: Floats, coherence: Floats, regularity: Floats
) -> dict[str, float]:
    """Where zones begin and end [cm], NaN where there is none; and shares of the slope.

    From the mean `coarseness`, the strength of `layering`, its `coherence` and its `regularity` in
    the columns at `x`, all (x,). What is still bare (NaN) is left out of the shares.
    """
    known = np.isfinite(coarseness)
    mean = np.where(known, coarseness, 0.5)
    small, large = mean < PURE, mean > 1 - PURE
    ordered = (coherence >= COHERENT) | (regularity >= REGULAR)
    layered = known & (layering >= FAINTEST) & ordered
    found: dict[str, float] = {}
    for name, zone in (("small", small), ("large", large), ("layered", layered)):
        found[f"zone_{name}_begin"], found[f"zone_{name}_end"] = _longest_run(x, zone)
    columns = max(1, int(known.sum()))
    return found | {
        "pure_share": float((small | large).sum() / columns),
        "layered_share": float(layered.sum() / columns),
        "segregation": _segregation(coarseness[known]),
    }


def _segregation(coarseness: Floats) -> float:
    if not len(coarseness):
        return 0.0
    overall = coarseness.mean()
    largest = np.sqrt(overall * (1.0 - overall))
    return float(coarseness.std() / largest) if largest > 0 else 0.0


def _longest_run(x: Floats, inside: NDArray[np.bool_]) -> tuple[float, float]:
    """The edges of the longest run of columns that are `inside`."""
    steps = np.diff(np.concatenate([[False], inside, [False]]).astype(int))
    begins, ends = np.flatnonzero(steps == 1), np.flatnonzero(steps == -1)
    if not len(begins):
        return np.nan, np.nan
    longest = int((ends - begins).argmax())
    half = (x[1] - x[0]) / 2 if len(x) > 1 else 0.0
    edges = x[begins[longest]] - half, x[ends[longest] - 1] + half
    return abs(round(float(edges[0]), DIGITS)), round(float(edges[1]), DIGITS)
