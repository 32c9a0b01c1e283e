"""How numbers lie in a file: what is squeezed, how hard, and in pieces of what size.

Measured in benchmarks/archives.py. The lattice's numbers are whole multiples, and shrink to a
thirtieth; the continuum's are noise in all but their first bytes, so that deflate takes a third off
them in five times the time that they take to be written: records of it are not squeezed. Every
variable carries a checksum of each piece (fletcher32).
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from experiment.archive.variables import VARIABLES

__all__ = ["PIECE", "encoding_of", "unsqueezed"]

PIECE = 2**18  # bytes
CHECKED = {"fletcher32": True, "_FillValue": None}
AS_BYTES = {"dtype": "u1", "_FillValue": np.uint8(255), "zlib": True, "complevel": 6}
WHOLE_NUMBERS = {"zlib": True, "complevel": 2, "shuffle": False}
SMOOTH = {"zlib": True, "complevel": 1, "shuffle": True}
NOISE: dict[str, Any] = {}


def encoding_of(name: str, shape: Sequence[int], *, whole_grains: bool) -> dict[str, Any]:
    """How xarray is to store a variable of floats of that shape, none of it 0.

    With `whole_grains` records are those of a lattice, and the fractions in a deposit are 0 or 1.
    """
    if name == "deposit_fraction":
        kind = AS_BYTES if whole_grains else SMOOTH
    elif name in VARIABLES and "time" in VARIABLES[name].dims:
        kind = WHOLE_NUMBERS if whole_grains else NOISE
    else:
        kind = SMOOTH
    return unsqueezed(shape) | kind


def unsqueezed(shape: Sequence[int]) -> dict[str, Any]:
    """How xarray is to store floats of that shape, none of it 0, fast: in pieces with checksums."""
    row = 8 * math.prod(shape[1:])
    return CHECKED | {"chunksizes": (min(shape[0], max(1, PIECE // row)), *shape[1:])}
