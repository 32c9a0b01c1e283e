"""Large grains caught on the upper, small-grained half: Makse, section IV, Eqs. (r2)-(solutionr2).

A patch of large grains lies in region A of the steady state; large grains that roll over it see the
repose slope theta_22 on the unchanged slope of the steady state, so that

    dR_2/dt = - v dR_2/dx - (gamma delta + (v + v') / (l - x)) R_2
    v' = psi gamma_21 L R2_0 / R0,     l = L (R1_0 + R2_0 gamma_21 / gamma) / R0

    R_2 = (l - x)^omega exp(-gamma delta t),     omega = (v + v') / v

For delta > 0 the flow over the patch fades: it is caught, and the patch grows. That reads the sign
of gamma delta alone; but what is caught at x is all of the bracket, gamma (theta_22 - theta(x)),
for the steady slope falls along region A. So for delta < 0, too, a patch is caught below the place

    x* = l - (v + v') / (gamma |delta|)     where theta(x*) = theta_22

which lies in region A for delta > -psi. In pours of the continuum no layers begin above it.
"""

from dataclasses import dataclass

import numpy as np

from continuum.theory.steady_state import SteadyState
from experiment.arrays import Floats

__all__ = ["Perturbation", "perturbation_of"]


@dataclass(frozen=True)
class Perturbation:
    """The flow of large grains over a patch of their own kind."""

    velocity: float  #: v, cm/s
    added_velocity: float  #: v', cm/s
    reach: float  #: l, cm
    growth_rate: float  #: -gamma delta, 1/s; of the flow over the patch

    @property
    def exponent(self) -> float:
        """Omega."""
        return (self.velocity + self.added_velocity) / self.velocity

    def loss_rate(self, x: Floats) -> Floats:
        """Gamma delta + (v + v') / (l - x) (cell,) [1/s]: how fast the flow is caught at x [cm]."""
        return (self.velocity + self.added_velocity) / (self.reach - x) - self.growth_rate

    @property
    def highest_capture(self) -> float:
        """x* [cm], 0 where a patch is caught all along the slope."""
        if self.growth_rate <= 0:
            return 0.0
        return max(0.0, self.reach - (self.velocity + self.added_velocity) / self.growth_rate)

    def rolling_thickness(self, x: Floats, time: float) -> Floats:
        """R_2 (cell,), but for a factor, at distances x [cm] < l and a time [s]."""
        return np.asarray((self.reach - x) ** self.exponent * np.exp(self.growth_rate * time))


def perturbation_of(state: SteadyState) -> Perturbation:
    """The perturbation of a steady state."""
    small, large = state.inflow
    scale = state.length / state.total_inflow
    return Perturbation(
        velocity=state.velocity,
        added_velocity=state.psi * state.cross_rate * scale * large,
        reach=scale * (small + large * state.cross_rate / state.rate),
        growth_rate=-state.rate * (state.theta_22 - state.theta_11),
    )
