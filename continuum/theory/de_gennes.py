"""One species, steady: de Gennes' solutions of the BCRE equations without dispersion.

    v dR/dx = Gamma,  Gamma = gamma (theta - theta_r) R = - dh/dt (silo) or - w x (drum)

Silo of length L, fed R0 at x = 0, wall at x = L; the pile rises everywhere at v R0 / L:

    R = R0 (L - x) / L                        theta - theta_r = - v / (gamma (L - x))

Half-filled thin drum of radius a turning at w, x downhill from its axis; one surface for any w:

    R = w (a^2 - x^2) / (2 v)                 theta - theta_r = - (2 v / gamma) x / (a^2 - x^2)
    h = - theta_r x - (v / gamma) ln(1 - x^2 / a^2)

With a curvature length l all this holds of s = theta - l d2h/dx2 instead of theta.
"""

from dataclasses import dataclass

import numpy as np

from continuum.theory.applicability import refuse_unless, steady_silo
from experiment import Experiment
from experiment.arrays import Floats
from experiment.law import law_of

__all__ = ["Drum", "Silo", "drum_of", "silo_of"]


@dataclass(frozen=True)
class Silo:
    """A silo that fills; x (cell,) [cm] is the distance from the pouring point."""

    length: float  #: L, cm
    inflow: float  #: R0, cm
    velocity: float  #: v, cm/s
    rate: float  #: gamma, 1/s
    repose_slope: float  #: theta_r

    @property
    def rise_velocity(self) -> float:
        """dh/dt [cm/s], the same everywhere."""
        return self.velocity * self.inflow / self.length

    def rolling_thickness(self, x: Floats) -> Floats:
        """R (cell,) [cm]."""
        return self.inflow * (self.length - x) / self.length

    def slope(self, x: Floats) -> Floats:
        """Theta, or s for l > 0, (cell,), for x < L."""
        return np.asarray(self.repose_slope - self.velocity / (self.rate * (self.length - x)))


@dataclass(frozen=True)
class Drum:
    """A half-filled thin drum; x (cell,) [cm] is the distance downhill from its axis, |x| < a."""

    radius: float  #: a, cm
    turning_rate: float  #: w, 1/s
    velocity: float  #: v, cm/s
    rate: float  #: gamma, 1/s
    repose_slope: float  #: theta_r

    def rolling_thickness(self, x: Floats) -> Floats:
        """R (cell,) [cm]."""
        return self.turning_rate / (2 * self.velocity) * (self.radius**2 - x**2)

    def slope(self, x: Floats) -> Floats:
        """Theta, or s for l > 0, (cell,)."""
        reach = self.radius**2 - x**2
        return np.asarray(self.repose_slope - 2 * self.velocity / self.rate * x / reach)

    def height(self, x: Floats) -> Floats:
        """H (cell,) [cm] above the axis for l = 0: an S, with a logarithm at either rim."""
        bend = np.log1p(-((x / self.radius) ** 2))
        return np.asarray(-self.repose_slope * x - self.velocity / self.rate * bend)


def silo_of(experiment: Experiment) -> Silo:
    """The closed form for `experiment`; :class:`NotApplicableError` says where there is none."""
    velocity, rate, repose_slope = _one_species(experiment, steady_silo(experiment))
    return Silo(
        length=experiment.cell.length,
        inflow=float(experiment.mean_inflow[0]),
        velocity=velocity,
        rate=rate,
        repose_slope=repose_slope,
    )


def drum_of(experiment: Experiment) -> Drum:
    """The closed form for `experiment`; :class:`NotApplicableError` says where there is none."""
    velocity, rate, repose_slope = _one_species(
        experiment, {"cell.shape: drum": experiment.cell.shape == "drum"}
    )
    return Drum(
        radius=experiment.cell.length / 2,
        turning_rate=experiment.cell.turning_rate or 0.0,
        velocity=velocity,
        rate=rate,
        repose_slope=repose_slope,
    )


def _one_species(experiment: Experiment, conditions: dict[str, bool]) -> tuple[float, float, float]:
    """V, gamma and theta_r of the one species, where the conditions on its cell are met, too."""
    mixture, law = experiment.mixture, law_of(experiment.mixture)
    conditions = conditions | {
        "mixture: one species": mixture.species == 1,
        "mixture.smoothing: 0": law.smoothing == 0,
        "mixture.dispersion: 0": law.dispersion == 0,
    }
    refuse_unless(conditions, "de Gennes' solution")
    rate, repose_slope = law.collision_rate[0][0], law.repose_slope[0][0]
    return mixture.drift_velocity[0], float(rate), float(repose_slope)
