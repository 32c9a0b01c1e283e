"""How the lattice's kernels are compiled.

They allocate nothing, and go without numba's reference counts: with them a step takes seven times
as long, for a pile is many arrays.
"""

from typing import Any

from numba import njit

__all__ = ["UNCOUNTED", "inlined"]

UNCOUNTED: dict[str, Any] = {"error_model": "numpy", "_nrt": False}

inlined = njit(forceinline=True, **UNCOUNTED)
