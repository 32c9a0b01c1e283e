"""The grains: sizes, repose slopes, collision rates and drift velocities of N species.

Matrices read [rolling species, surface species]. The repose slope of rolling species a on a
surface of composition phi is theta_a(phi) = sum_b theta_ab phi_b; `experiment/slopes.py` says what
may be given in its place.
"""

import math
from collections.abc import Mapping
from typing import Any, Self

from pydantic import Field, model_validator

from experiment.fields import (
    LARGEST,
    SMALLEST,
    NonNegative,
    Part,
    Positive,
    RateMatrix,
    SlopeMatrix,
    number_between,
)
from experiment.slopes import resolve_slopes, slope_names, two_species_slopes

__all__ = ["Mixture"]


def _mean_diameter(part: dict[str, Any]) -> float:
    diameters: tuple[float, ...] = part["grain_diameter"]
    return math.fsum(diameters) / len(diameters)


class Mixture(Part):
    """N species of grains, smallest first by custom, and the law of their surface flow.

    Besides `repose_slope`, the slopes may be given as `repose_angle` in degrees (a matrix, or the
    pure species' angles together with `psi`) or as `theta_11`, `theta_22`, ... and `psi`; for two
    species, `delta` may stand for `theta_22`, and `m1` beside it. These also change single
    parameters of a matrix that is given. `cross_rate` sets every collision rate of unlike grains.
    """

    #: what the species are called; as many as there are species
    names: tuple[str, ...] = Field(min_length=1)
    grain_diameter: tuple[Positive, ...] = Field(min_length=1)  #: cm; d_a
    drift_velocity: tuple[Positive, ...]  #: cm/s; v_a; one number serves all species
    repose_slope: SlopeMatrix  #: 1; theta_ab of rolling a on a surface of b; see the shorthands
    #: 1/s; gamma_ab; the continuum and the lattice's rate rule need it
    collision_rate: RateMatrix | None = None
    cross_amplification: RateMatrix | None = None  #: 1/s; BdG's constant rates mu, diagonal 0
    dispersion: NonNegative = 0.0  #: cm2/s; D, diffusion of the rolling layer
    smoothing: NonNegative = 0.0  #: 1; width over which P(z) bends
    #: cm; d, thickness of the surface layer; default: the mean diameter
    surface_depth: Positive = Field(default_factory=_mean_diameter)
    #: cm; l of the curvature term; default: the mean diameter
    curvature_length: NonNegative = Field(default_factory=_mean_diameter)

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
    def known_fields(cls, given: Mapping[str, Any]) -> set[str]:
        """The fields and their shorthands, for as many species as are named."""
        shorthands = {"repose_angle", "cross_rate", *slope_names(given)}
        return super().known_fields(given) | shorthands

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
        resolve_slopes(fields)
        if "cross_rate" in fields:
            _resolve_cross_rate(fields)
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


def _resolve_cross_rate(fields: dict[str, Any]) -> None:
    cross = number_between("cross_rate", fields.pop("cross_rate"), 0.0, LARGEST)
    rates = fields.get("collision_rate")
    rows = rates if isinstance(rates, (list, tuple)) else ()
    if len(rows) < 2 or not all(isinstance(row, (list, tuple)) for row in rows):
        raise ValueError(
            f"cross_rate = {cross:g}: it needs a collision_rate beside it, "
            "a matrix of two or more species"
        )
    fields["collision_rate"] = [
        [rate if a == b else cross for b, rate in enumerate(row)] for a, row in enumerate(rows)
    ]
