"""The grains: sizes, repose slopes, collision rates and drift velocities of N species.

Matrices read [rolling species, surface species]. The repose slope of rolling species a on a
surface of composition phi is theta_a(phi) = sum_b theta_ab phi_b. For two species the paper's
parameters are

    psi   = theta_11 - theta_21            m1 = theta_12 - theta_11
    delta = theta_22 - theta_11            m2 = theta_22 - theta_21 = delta + psi

so (theta_11, psi, delta, m1) says the same as the matrix; the paper's m is m1 = m2.
"""

import math
from typing import Any, Self

from pydantic import Field, model_validator

from experiment.fields import (
    SMALLEST,
    STEEPEST,
    Matrix,
    NonNegative,
    Part,
    Positive,
    RateMatrix,
    SlopeMatrix,
)

__all__ = ["Mixture", "two_species_slopes"]

TWO_SPECIES = ("theta_11", "psi", "delta", "m1")
SHORTHANDS = {*TWO_SPECIES, "repose_angle"}


def two_species_slopes(
    theta_11: float, psi: float, delta: float, m1: float | None = None
) -> Matrix:
    """Repose slopes from the paper's parameters; m1 = m2 = delta + psi by default."""
    m1 = delta + psi if m1 is None else m1
    return (theta_11, theta_11 + m1), (theta_11 - psi, theta_11 + delta)


def _mean_diameter(part: dict[str, Any]) -> float:
    diameters: tuple[float, ...] = part["grain_diameter"]
    return math.fsum(diameters) / len(diameters)


class Mixture(Part):
    """N species of grains, smallest first by custom, and the law of their surface flow.

    Besides `repose_slope`, the slopes may be given as `repose_angle` in degrees (a matrix, or the
    two pure species' angles together with `psi`) or, for two species, as `theta_11`, `psi`,
    `delta` and `m1`, which also change single parameters of a matrix that is given.
    """

    names: tuple[str, ...] = Field(min_length=1)
    grain_diameter: tuple[Positive, ...] = Field(min_length=1)  # cm
    drift_velocity: tuple[Positive, ...]  # cm/s; one number serves all species
    repose_slope: SlopeMatrix  # 1
    collision_rate: RateMatrix | None = None  # 1/s; the continuum needs it
    cross_amplification: RateMatrix | None = None  # 1/s; BdG's constant rates mu, diagonal 0
    dispersion: NonNegative = 0.0  # cm2/s; D, diffusion of the rolling layer
    smoothing: NonNegative = 0.0  # 1; width over which P(z) bends
    surface_depth: Positive = Field(default_factory=_mean_diameter)  # cm
    curvature_length: NonNegative = Field(default_factory=_mean_diameter)  # cm

    @classmethod
    def two_species(
        cls,
        theta_11: float,
        psi: float,
        delta: float,
        *,
        m1: float | None = None,
        **others: Any,
    ) -> Self:
        """Two species by the paper's parameters; `others` are the remaining fields."""
        slopes = two_species_slopes(theta_11, psi, delta, m1)
        return cls.parse({"repose_slope": slopes, **others}, "mixture")

    @classmethod
    def from_degrees(cls, repose_angle: Any, **others: Any) -> Self:
        """Repose angles in degrees: a matrix, or two pure species' with `psi` in `others`."""
        return cls.parse({"repose_angle": repose_angle, **others}, "mixture")

    @classmethod
    def known_fields(cls) -> set[str]:
        """The fields and their shorthands."""
        return super().known_fields() | SHORTHANDS

    @property
    def species(self) -> int:
        """Number of species."""
        return len(self.names)

    @property
    def smallest(self) -> int:
        """Index of the smallest species; of equals, the first."""
        return self.grain_diameter.index(min(self.grain_diameter))

    @property
    def psi(self) -> float:
        """theta_11 - theta_21, which the difference in size gives (two species)."""
        return self.repose_slope[0][0] - self.repose_slope[1][0]

    @property
    def delta(self) -> float:
        """theta_22 - theta_11, the paper's control parameter (two species)."""
        return self.repose_slope[1][1] - self.repose_slope[0][0]

    @model_validator(mode="before")
    @classmethod
    def _resolve_shorthands(cls, given: Any) -> Any:
        if not isinstance(given, dict):
            return given
        fields = dict(given)
        if "repose_angle" in fields:
            _resolve_angles(fields)
        if any(name in fields for name in TWO_SPECIES):
            _resolve_two_species(fields)
        velocity = fields.get("drift_velocity")
        if isinstance(velocity, (int, float)) and isinstance(fields.get("names"), (list, tuple)):
            fields["drift_velocity"] = [velocity] * len(fields["names"])
        return fields

    @model_validator(mode="after")
    def _check_shapes(self) -> Self:
        n = self.species
        if len(set(self.names)) < n or not all(self.names):
            raise ValueError(f"names = {list(self.names)}: each must be given, and once only")
        for name in ("grain_diameter", "drift_velocity"):
            value = getattr(self, name)
            if len(value) != n:
                raise ValueError(
                    f"{name} = {list(value)}: it should have {n} values, one a species"
                )
        for name in ("repose_slope", "collision_rate", "cross_amplification"):
            matrix = getattr(self, name)
            if matrix is not None and [len(row) for row in matrix] != [n] * n:
                rows = [list(row) for row in matrix]
                raise ValueError(f"{name} = {rows}: it should be a {n} x {n} matrix")
        for a in range(n):
            if self.collision_rate is not None and self.collision_rate[a][a] < SMALLEST:
                rate = self.collision_rate[a][a]
                raise ValueError(
                    f"collision_rate[{a}][{a}] = {rate:g}: it should be greater than 0, "
                    f"at least {SMALLEST:g}"
                )
            if self.cross_amplification is not None and self.cross_amplification[a][a] != 0:
                value = self.cross_amplification[a][a]
                raise ValueError(f"cross_amplification[{a}][{a}] = {value}: it should be 0")
        return self


def _resolve_angles(fields: dict[str, Any]) -> None:
    angles = fields.pop("repose_angle")
    if "repose_slope" in fields:
        raise ValueError("repose_slope and repose_angle are both given; one is allowed")
    try:
        rows = [[_tangent(angle) for angle in row] for row in angles]
    except TypeError:
        if not isinstance(angles, (list, tuple)) or len(angles) != 2 or "psi" not in fields:
            raise ValueError(
                f"repose_angle = {angles!r}: it should be a matrix in degrees, "
                "or two pure species' angles with psi beside them"
            ) from None
        theta_11, theta_22 = (_tangent(angle) for angle in angles)
        fields.setdefault("theta_11", theta_11)
        fields.setdefault("delta", theta_22 - theta_11)
    else:
        fields["repose_slope"] = rows


def _tangent(angle: Any) -> float:
    if isinstance(angle, bool) or not isinstance(angle, (int, float)) or not 0 <= angle < 89.4:
        raise ValueError(f"repose_angle = {angle!r}: it should be a number from 0 to below 89.4")
    return math.tan(math.radians(angle))


def _resolve_two_species(fields: dict[str, Any]) -> None:
    wanted = {name: fields.pop(name) for name in TWO_SPECIES if name in fields}
    for name, value in wanted.items():
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise ValueError(f"{name} = {value!r}: it should be a number")
        if not abs(value) <= STEEPEST:
            raise ValueError(f"{name} = {value!r}: it should be from {-STEEPEST:g} to {STEEPEST:g}")
    if "repose_slope" in fields:
        wanted = _parameters(fields["repose_slope"], wanted) | wanted
    missing = [name for name in TWO_SPECIES[:3] if name not in wanted]
    if missing:
        raise ValueError(f"{missing[0]}: missing; theta_11, psi and delta go together")
    slopes = two_species_slopes(**wanted)
    made_by = (("theta_11", "m1"), ("psi", "delta"))
    for row, names in zip(slopes, made_by, strict=True):
        for slope, name in zip(row, names, strict=True):
            if name in wanted and not 0 <= slope <= STEEPEST:
                raise ValueError(
                    f"{name} = {wanted[name]:g}: it makes a repose slope of {slope:g}, "
                    f"which should be from 0 to {STEEPEST:g}"
                )
    fields["repose_slope"] = slopes


def _parameters(slopes: Any, changed: dict[str, float]) -> dict[str, float]:
    """The paper's parameters of a matrix; m1 - m2 is kept where psi or delta is `changed`."""
    try:
        (t11, t12), (t21, t22) = slopes
        psi, delta, m1 = t11 - t21, t22 - t11, t12 - t11
    except (TypeError, ValueError):
        raise ValueError(f"repose_slope = {slopes!r}: psi and delta need a 2 x 2 matrix") from None
    steeper = sum(changed.get(name, old) - old for name, old in (("psi", psi), ("delta", delta)))
    return {"theta_11": t11, "psi": psi, "delta": delta, "m1": m1 + steeper}
