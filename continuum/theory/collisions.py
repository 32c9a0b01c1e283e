"""The collision functions and the collision matrix: Makse, Eqs. (canonical)-(mcs-r), for N species.

    a_a = gamma_aa P(theta - theta_a(phi))       amplification of static a by rolling a
    b_a = gamma_aa P(theta_a(phi) - theta)       capture of rolling a
    x_b = mu_ba + gamma_ba P(theta - theta_b(phi))       amplification of static a by rolling b
    M_aa = a_a phi_a - b_a,  M_ab = x_b phi_a,  Gamma_a = sum_b M_ab R_b

First index of M: the static species; second: the rolling one, as in the paper.
"""

import numpy as np

from experiment.arrays import Floats
from experiment.law import Law, positive_part

__all__ = ["amplification", "capture", "collision_matrix", "generalised_repose_slope"]

_positive_part = np.vectorize(positive_part.py_func, otypes=[np.float64])


def generalised_repose_slope(phi: Floats, law: Law) -> Floats:
    """theta_a(phi) = sum_b theta_ab phi_b (species, cell)."""
    return np.asarray(np.array(law.repose_slope) @ phi)


def capture(phi: Floats, slope: Floats, law: Law) -> Floats:
    """b_a (species, cell) [1/s] on surfaces phi (species, cell) at slopes (cell,)."""
    gap = generalised_repose_slope(phi, law) - slope
    return np.asarray(
        np.diag(np.array(law.collision_rate))[:, None] * _positive_part(gap, law.smoothing)
    )


def amplification(phi: Floats, slope: Floats, law: Law) -> Floats:
    """a_a on the diagonal, x_b off it, (static a, rolling b, cell) [1/s]."""
    gap = slope - generalised_repose_slope(phi, law)
    push = np.array(law.collision_rate)[:, :, None] * _positive_part(gap, law.smoothing)[:, None]
    return np.asarray((np.array(law.cross_amplification)[:, :, None] + push).transpose(1, 0, 2))


def collision_matrix(phi: Floats, slope: Floats, law: Law) -> Floats:
    """M (static species, rolling species, cell) [1/s], of which Gamma = M R."""
    matrix = amplification(phi, slope, law) * phi[:, None]
    species = np.arange(len(phi))
    matrix[species, species] -= capture(phi, slope, law)
    return matrix
