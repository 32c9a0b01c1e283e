"""Limited differences for advection: how steep a cell's profile may be taken, with one signature.

Each takes the differences to the neighbours behind and ahead, and gives 0 at an extremum, so that
no new extremum arises; on smooth profiles all of them are a difference of second order.
"""

from numba import njit

__all__ = ["LIMITERS", "VAN_LEER", "limited"]

LIMITERS = ("minmod", "van_leer", "monotonized_central", "superbee")
MINMOD, VAN_LEER, MONOTONIZED_CENTRAL, SUPERBEE = range(len(LIMITERS))


@njit(cache=True)
def limited(limiter: int, behind: float, ahead: float) -> float:
    """The difference across a cell by the limiter of that place in LIMITERS."""
    if limiter == MINMOD:
        return minmod(behind, ahead)
    if limiter == MONOTONIZED_CENTRAL:
        return monotonized_central(behind, ahead)
    if limiter == SUPERBEE:
        return superbee(behind, ahead)
    return van_leer(behind, ahead)


@njit(cache=True)
def minmod(behind: float, ahead: float) -> float:
    """The smaller of the two."""
    if behind * ahead <= 0.0:
        return 0.0
    return behind if abs(behind) < abs(ahead) else ahead


@njit(cache=True)
def van_leer(behind: float, ahead: float) -> float:
    """Their harmonic mean."""
    if behind * ahead <= 0.0:
        return 0.0
    return 2.0 * behind * ahead / (behind + ahead)


@njit(cache=True)
def monotonized_central(behind: float, ahead: float) -> float:
    """Their mean, as far as it is at most twice either of them."""
    return minmod(0.5 * (behind + ahead), minmod(2.0 * behind, 2.0 * ahead))


@njit(cache=True)
def superbee(behind: float, ahead: float) -> float:
    """The larger of them, as far as it is at most twice the other: the steepest."""
    steep = minmod(2.0 * behind, ahead)
    other = minmod(behind, 2.0 * ahead)
    return steep if abs(steep) > abs(other) else other
