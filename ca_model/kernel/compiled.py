"""How the lattice's kernels are compiled.

They allocate nothing, and go without numba's reference counts: with them a step takes seven times
as long, for a pile is many arrays.
"""

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

__all__ = ["UNCOUNTED", "inlined"]

UNCOUNTED: dict[str, Any] = {"error_model": "numpy", "_nrt": False}

Function = TypeVar("Function", bound=Callable[..., Any])


def inlined(function: Function) -> Function:
    """Compile a part of a kernel, to be put wherever it is called."""
    return cast(Function, njit(forceinline=True, **UNCOUNTED)(function))
