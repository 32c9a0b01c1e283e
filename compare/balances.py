"""Balances that must hold between what the deposit, the kymograph and the scales tell.

    lambda = R0 v T / L                  one cycle of period T lays one wavelength
    lambda = R0 v (1 / v_f + 1 / v_k)    a cycle is a front's way down and a kink's way up
    lambda = R0 (v + v_k) / v_k          the same, where fronts are as fast as grains (v_f = v)
    poured = rolling + deposited + fallen off an open end, of each species

The first holds to the errors of its parts, for it is the conservation of volume; the second as far
as a cycle has no pause and lines run straight; the third where fronts lose no grains on their way.
"""

from typing import NamedTuple

import numpy as np
import xarray as xr

from compare.quantities import flux, rise_velocity, total_inflow, values_of, velocity

__all__ = ["Measured", "balances", "unbalanced", "volume_residual"]


LARGEST = 0.05  # residual that a pour's end and beginning explain
IN_ANY_CASE = 0.2  # residual that is told whatever its error, which the same fault may make large


class Measured(NamedTuple):
    """A number and its standard error; NaN where there is none."""

    value: float
    error: float


def balances(
    archive: xr.Dataset, wavelength: Measured, period: Measured, front: Measured, kink: Measured
) -> dict[str, Measured]:
    """What each balance says of the wavelength [cm], and its residual: wavelength over that - 1."""
    v, r0, rate = velocity(archive), total_inflow(archive), flux(archive)
    rise = rise_velocity(archive)
    down, up = (Measured(1 / line.value, line.error / line.value**2) for line in (front, kink))
    expected = {
        "period": Measured(rise * period.value, rise * period.error),
        "velocities": Measured(
            rate * (down.value + up.value), rate * float(np.hypot(down.error, up.error))
        ),
        "kinks": Measured(r0 + r0 * v * up.value, r0 * v * up.error),
    }
    told: dict[str, Measured] = {}
    for name, right in expected.items():
        told[f"wavelength_of_{name}"] = right
        told[f"{name}_residual"] = _residual(wavelength, right)
    return told


def unbalanced(residual: Measured) -> str:
    """A line on a `residual` of R0 v T / L that its error does not explain; empty for a sound one.

    Volume is conserved: then lines or layers were missed, or cycles and layers are not one thing.
    """
    if not abs(residual.value) > min(max(LARGEST, 3 * residual.error), IN_ANY_CASE):
        return ""
    return f"wavelength departs from R0 v T / L by {residual.value:+.0%}: look at both pictures"


def volume_residual(archive: xr.Dataset) -> float:
    """The largest part of what was poured of a species by then that is unaccounted for.

    |poured - rolling - deposited - fallen off| over what was poured of the species in the end.
    """
    poured, rolling, deposited, fallen = (
        values_of(archive, f"{name}_volume")
        for name in ("poured", "rolling", "deposited", "outflow")
    )
    missing = np.abs(poured - (rolling + deposited + fallen)).max(axis=0)
    total = poured[-1]
    return float(max(missing[total > 0] / total[total > 0], default=np.nan))


def _residual(left: Measured, right: Measured) -> Measured:
    value = left.value / right.value
    return Measured(
        value - 1,
        value * float(np.hypot(left.error / left.value, right.error / right.value)),
    )
