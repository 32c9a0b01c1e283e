"""The steady state of two species in a silo: Makse, PRE 56, 7008 (1997), section III, in full.

The pile rises everywhere at v R0 / L, so R = R0 (L - x) / L. With r = v / (gamma psi):

Region A, 0 <= x <= x_m = R1_0 L / R0 - r, where theta_2 < theta < theta_1:
    phi_1 = 1,  R_1 = R1_0 - R0 x / L,  R_2 = R2_0
    theta = theta_11 - (v / gamma + psi g L R2_0 / R0) / (L (R1_0 + g R2_0) / R0 - x),
    g = gamma_21 / gamma

Region B, x_m <= x <= L, where theta < theta_2 < theta_1, with u = R_1 / R:
    r u' = -(1 - u) u,  u = 1 / (1 + C exp((x - x_m) / r)),  C = R2_0 L / (R0 r)
    phi_1 = u (1 + R_2 L / (r R0))
    theta = theta_22 - m phi_1 + (psi R_1 L / R0 - v / gamma) / (L - x)

The paper's simplified forms, for R1_0 = R2_0 and r << L, are :class:`SimplifiedSteadyState`:

    above x_m as before;   below  phi_1 = exp(-(x - x_m) / r),  R_1 = 2 (r / L) phi_1 R,
                                  theta = theta_22 - m phi_1 - v / (gamma (L - x))

They are only O(r / L): theta jumps by -v / (gamma (L - x_m)) at x_m, for one.

It holds for equal v, gamma_11 = gamma_22, theta_12 - theta_11 = theta_22 - theta_21, and of
s = theta - l d2h/dx2 in the place of theta where there is a curvature length l.
Region A ends where theta falls to theta_2(phi_1 = 1) = theta_21; the paper's text has
theta_1(phi_2 = 1) there.
"""

from dataclasses import dataclass, fields
from typing import Self

import numpy as np

from continuum.theory.applicability import refuse_unless, steady_silo
from experiment import Experiment, NotApplicableError
from experiment.arrays import Floats

__all__ = ["SimplifiedSteadyState", "SteadyState", "steady_state_of"]


@dataclass(frozen=True)
class SteadyState:
    """The closed form for one set-up; every method takes distances x (cell,) [cm]."""

    length: float  #: L, cm
    inflow: tuple[float, float]  #: R1_0, R2_0, cm
    velocity: float  #: v, cm/s
    rate: float  #: gamma, 1/s
    cross_rate: float  #: gamma_21, 1/s
    theta_11: float
    theta_22: float
    psi: float

    @property
    def total_inflow(self) -> float:
        """R0 [cm]."""
        return sum(self.inflow)

    @property
    def mixing_length(self) -> float:
        """R = v / (gamma psi) [cm]: over which the species mix below x_m."""
        return self.velocity / (self.rate * self.psi)

    @property
    def middle(self) -> float:
        """x_m [cm]: where the large grains begin to be captured."""
        return self.inflow[0] * self.length / self.total_inflow - self.mixing_length

    @property
    def rise_velocity(self) -> float:
        """dh/dt = v R0 / L [cm/s], the same everywhere."""
        return self.velocity * self.total_inflow / self.length

    def small_share(self, x: Floats) -> Floats:
        """U = R_1 / R (cell,)."""
        total = self.total_inflow * (self.length - x) / self.length
        above = self.inflow[0] - self.total_inflow * x / self.length
        c = self.inflow[1] * self.length / (self.total_inflow * self.mixing_length)
        below = 1.0 / (1.0 + c * np.exp(np.maximum(x - self.middle, 0.0) / self.mixing_length))
        inside = np.divide(above, total, out=np.zeros_like(x), where=total > 0)
        return np.asarray(np.where(x < self.middle, inside, below))

    def rolling_thickness(self, x: Floats) -> Floats:
        """R_1 and R_2 (cell, species) [cm]."""
        total = self.total_inflow * (self.length - x) / self.length
        u = self.small_share(x)
        return np.stack([u * total, (1.0 - u) * total], axis=-1)

    def surface_fraction(self, x: Floats) -> Floats:
        """phi_1 and phi_2 (cell, species)."""
        u = self.small_share(x)
        large = self.rolling_thickness(x)[..., 1]
        below = u * (1.0 + large * self.length / (self.mixing_length * self.total_inflow))
        phi_1 = np.where(x < self.middle, 1.0, below)
        return np.stack([phi_1, 1.0 - phi_1], axis=-1)

    def slope(self, x: Floats) -> Floats:
        """Theta, or s for l > 0, (cell,), for 0 <= x < L."""
        r1, r2 = self.inflow
        g = self.cross_rate / self.rate
        scale = self.length / self.total_inflow
        drop = self.velocity / self.rate + self.psi * g * scale * r2
        inside = np.minimum(x, self.middle)
        above = self.theta_11 - drop / (scale * (r1 + g * r2) - inside)
        m = self.theta_22 - self.theta_11 + self.psi
        phi_1 = self.surface_fraction(x)[..., 0]
        rolling_1 = self.rolling_thickness(x)[..., 0]
        excess = self.psi * rolling_1 * scale - self.velocity / self.rate
        below = self.theta_22 - m * phi_1 + excess / (self.length - x)
        return np.where(x < self.middle, above, below)


@dataclass(frozen=True)
class SimplifiedSteadyState(SteadyState):
    """The paper's forms for equal volumes and r << L: Eqs. (simple-up) and (simple-down)."""

    @classmethod
    def of(cls, state: SteadyState) -> Self:
        """The simplified form of `state`. Raises :class:`NotApplicableError` for R1_0 != R2_0."""
        if state.inflow[0] != state.inflow[1]:
            raise NotApplicableError(
                f"feed.inflow = {list(state.inflow)}: the simplified forms hold for equal inflows"
            )
        return cls(**{field.name: getattr(state, field.name) for field in fields(state)})

    def small_share(self, x: Floats) -> Floats:
        """U = R_1 / R (cell,)."""
        below = 2.0 * self.mixing_length / self.length * self._decay(x)
        return np.where(x < self.middle, super().small_share(x), below)

    def surface_fraction(self, x: Floats) -> Floats:
        """phi_1 and phi_2 (cell, species)."""
        phi_1 = np.where(x < self.middle, 1.0, self._decay(x))
        return np.stack([phi_1, 1.0 - phi_1], axis=-1)

    def slope(self, x: Floats) -> Floats:
        """Theta, or s for l > 0, (cell,), for 0 <= x < L."""
        m = self.theta_22 - self.theta_11 + self.psi
        below = self.theta_22 - m * self._decay(x) - self.velocity / (self.rate * (self.length - x))
        return np.where(x < self.middle, super().slope(x), below)

    def _decay(self, x: Floats) -> Floats:
        return np.asarray(np.exp(-np.maximum(x - self.middle, 0.0) / self.mixing_length))


def steady_state_of(experiment: Experiment) -> SteadyState:
    """The closed form for `experiment`; :class:`NotApplicableError` says where there is none."""
    mixture = experiment.mixture
    rates = mixture.collision_rate
    if mixture.species != 2 or rates is None:
        raise NotApplicableError("mixture: the steady state needs two species with collision rates")
    (theta_11, theta_12), (theta_21, theta_22) = mixture.repose_slope
    velocity = mixture.drift_velocity[0]
    r1, r2 = experiment.feed.inflow
    length = experiment.cell.length
    conditions = steady_silo(experiment) | {
        "mixture.drift_velocity: equal for both species": mixture.drift_velocity[1] == velocity,
        "mixture.collision_rate: gamma_11 = gamma_22": rates[0][0] == rates[1][1],
        "mixture.repose_slope: theta_12 - theta_11 = theta_22 - theta_21": np.isclose(
            theta_12 - theta_11, theta_22 - theta_21
        ),
        "mixture.repose_slope: psi = theta_11 - theta_21 > 0": theta_11 > theta_21,
        "mixture.dispersion: 0": mixture.dispersion == 0,
        "mixture.smoothing: 0": mixture.smoothing == 0,
        "mixture.cross_amplification: none": not np.any(mixture.cross_amplification or 0),
    }
    refuse_unless(conditions, "the steady state")
    state = SteadyState(
        length=length,
        inflow=(r1, r2),
        velocity=velocity,
        rate=rates[0][0],
        cross_rate=rates[1][0],
        theta_11=theta_11,
        theta_22=theta_22,
        psi=theta_11 - theta_21,
    )
    if state.middle <= 0:
        raise NotApplicableError(
            f"feed.inflow = {[r1, r2]}: too few small grains for a region A "
            f"(x_m = {state.middle:.3g} cm; it should be greater than 0)"
        )
    return state
