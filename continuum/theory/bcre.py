"""One species in time: exact solutions of the BCRE equations.

    dR/dt = - v dR/dx + D d2R/dx2 + gamma y R      dy/dt = gamma d(y R)/dx      y = theta - theta_r

Where the slope is that of repose, y = 0, rolling grains drift and spread: :func:`spread_step` of a
step far from the ends, :func:`poured_step` of a feed that starts at t = 0 and brings in v R0.

Without dispersion a wave of fixed shape climbs at any speed c: in xi = x + c t the second equation
is integrated, y = K / (1 - gamma R / c), and then the first,

    ln(gamma R / c) - gamma R / c = gamma K xi / (c + v) - 1 - g,

so R = - (c / gamma) W(-exp(gamma K xi / (c + v) - 1 - g)) with Lambert's W. For K < 0 the flow dies
out downhill, as below a kink; for K > 0 it grows downhill and digs the slope away.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from experiment.arrays import Floats

__all__ = ["ClimbingWave", "poured_step", "spread_step"]


def spread_step(distance: Floats, dispersion: float, time: float) -> Floats:
    """R / R0 at distances [cm] downhill from where a step of R has drifted to after `time` [s]."""
    return np.asarray(0.5 * scipy.special.erfc(distance / np.sqrt(4.0 * dispersion * time)))


def poured_step(x: Floats, velocity: float, dispersion: float, time: float) -> Floats:
    """R / R0 at distances x [cm] from a feed that started `time` [s] ago.

    Solves the drift and spread for R = 0 at t = 0 and v R - D dR/dx = v R0 at x = 0.
    """
    width = np.sqrt(4.0 * dispersion * time)
    ahead, behind = (x - velocity * time) / width, (x + velocity * time) / width
    bell = np.exp(-(ahead**2))
    image = 0.5 * (1.0 + velocity * (x + velocity * time) / dispersion)
    return np.asarray(
        0.5 * scipy.special.erfc(ahead)
        + bell * velocity * np.sqrt(time / (np.pi * dispersion))
        - bell * image * scipy.special.erfcx(behind)
    )


@dataclass(frozen=True)
class ClimbingWave:
    """A wave of fixed shape; it exists where :meth:`thickness` is below c / gamma."""

    climb: float  #: c, cm/s
    velocity: float  #: v, cm/s
    rate: float  #: gamma, 1/s
    faint_excess: float  #: K: theta - theta_r where R vanishes
    gap: float  #: g > 0: how far the wave stays below c / gamma at xi = 0

    def thickness(self, x: Floats, time: float) -> Floats:
        """R (cell,) [cm]; NaN where there is no such wave."""
        xi = x + self.climb * time
        decay = self.rate * self.faint_excess / (self.climb + self.velocity)
        exponent = decay * xi - 1.0 - self.gap
        branch = scipy.special.lambertw(-np.exp(np.minimum(exponent, -1.0))).real
        return np.where(exponent < -1.0, -self.climb / self.rate * branch, np.nan)

    def excess_slope(self, x: Floats, time: float) -> Floats:
        """Theta - theta_r (cell,)."""
        share = self.rate * self.thickness(x, time) / self.climb
        return self.faint_excess / (1.0 - share)
