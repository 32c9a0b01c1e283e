"""The minimal model of Boutreux and de Gennes in a silo, near its wall.

Two species of one size: theta_ab does not depend on b, amplification is cross-amplification at the
constant rate mu, gamma_11 = gamma_22 = gamma, theta_1 - theta_2 = psi > 0. Far down, where species
2 makes the surface, dh/dt = v R0 / L gives gamma (theta_2 - theta) = v / (L y), y = (L - x) / L,
and phi_1 dh/dt = - Gamma_1 then

    d ln R_1 / d ln y = (1 + A y) / (1 + B y),     A = psi gamma L / v,  B = mu L / v
    R_1 ~ y (1 + B y)^(A/B - 1)

a power law y^(A/B) where B y >> 1: the other species vanishes completely at the low edge.
"""

from dataclasses import dataclass

import numpy as np

from continuum.theory.applicability import refuse_unless, steady_silo
from experiment import Experiment, NotApplicableError
from experiment.arrays import Floats
from experiment.law import law_of

__all__ = ["MinimalModel", "minimal_model_of"]


@dataclass(frozen=True)
class MinimalModel:
    """How the steeper species thins out towards the wall."""

    length: float  #: L, cm
    size_drive: float  #: A = psi gamma L / v
    exchange: float  #: B = mu L / v

    @property
    def exponent(self) -> float:
        """A / B, of the power law."""
        return self.size_drive / self.exchange

    def profile(self, x: Floats) -> Floats:
        """R_1 (cell,), but for a factor, at distances x [cm] near the wall."""
        y = (self.length - x) / self.length
        return np.asarray(y * (1.0 + self.exchange * y) ** (self.exponent - 1.0))


def minimal_model_of(experiment: Experiment) -> MinimalModel:
    """The profile for `experiment`; :class:`NotApplicableError` says where there is none."""
    mixture, law = experiment.mixture, law_of(experiment.mixture)
    if mixture.species != 2:
        raise NotApplicableError("mixture: the minimal model needs two species")
    gamma, theta, mu = map(
        np.array, (law.collision_rate, law.repose_slope, law.cross_amplification)
    )
    conditions = steady_silo(experiment) | {
        "mixture.repose_slope: the same on either surface": bool(
            (theta[:, 0] == theta[:, 1]).all()
        ),
        "mixture.repose_slope: theta_1 > theta_2": theta[0, 0] > theta[1, 0],
        "mixture.collision_rate: gamma_11 = gamma_22, none across": (
            gamma[0, 0] == gamma[1, 1] and gamma[0, 1] == gamma[1, 0] == 0
        ),
        "mixture.cross_amplification: mu_12 = mu_21 > 0": mu[0, 1] == mu[1, 0] > 0,
        "mixture.drift_velocity: equal for both species": len(set(mixture.drift_velocity)) == 1,
        "mixture.smoothing: 0": law.smoothing == 0,
        "mixture.dispersion: 0": law.dispersion == 0,
    }
    refuse_unless(conditions, "the minimal model")
    crossing = experiment.cell.length / mixture.drift_velocity[0]
    return MinimalModel(
        length=experiment.cell.length,
        size_drive=float((theta[0, 0] - theta[1, 0]) * gamma[0, 0] * crossing),
        exchange=float(mu[0, 1] * crossing),
    )
