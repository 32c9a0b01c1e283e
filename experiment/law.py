"""The exchange between rolling and static grains, for a row of cells at one instant.

    theta_a(phi) = sum_b theta_ab phi_b                                generalised repose slope
    capture      = gamma_aa P(theta_a - s) R_a                         b_a of the paper
    amplification = phi_a sum_b [mu_ba + gamma_ba P(s - theta_b)] R_b  a_a (b = a), x_b (b != a)
    Gamma_a      = amplification - capture

Makse, PRE 56, 7008 (1997), Eqs. (canonical2), (dependence), (mcs-r), for N species; mu is the
constant cross-amplification of Boutreux and de Gennes. P(z) = (z + sqrt(z^2 + w^2)) / 2: without
smoothing (w = 0) this is max(z, 0) exactly. First index of a matrix: the rolling species.

The exchange is local: the functions take the values of one cell, tuples with one number a species.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from experiment import Mixture, NotApplicableError
from experiment.arrays import Floats
from experiment.species import Rows, Values, at, put

__all__ = [
    "Law",
    "amplification_rates",
    "capture_rates",
    "interaction",
    "law_of",
    "positive_part",
    "repose_slopes",
]

Matrix = tuple[Values, ...]  # (rolling species, surface species)


class Law(NamedTuple):
    """The law of a mixture; matrices are tuples of rows (rolling species, surface species)."""

    repose_slope: Matrix  #: 1
    collision_rate: Matrix  #: 1/s
    cross_amplification: Matrix  #: 1/s
    smoothing: float  #: 1
    surface_depth: float  #: cm
    curvature_length: float  #: cm
    dispersion: float = 0.0  #: cm2/s


def law_of(mixture: Mixture) -> Law:
    """The law of `mixture`. Raises :class:`NotApplicableError` where it has no collision rates."""
    if mixture.collision_rate is None:
        raise NotApplicableError(
            "mixture.collision_rate: missing; the continuum and the lattice's rate rule need it "
            "(a matrix of rates, 1/s)"
        )
    none = ((0.0,) * mixture.species,) * mixture.species
    return Law(
        repose_slope=mixture.repose_slope,
        collision_rate=mixture.collision_rate,
        cross_amplification=mixture.cross_amplification or none,
        smoothing=mixture.smoothing,
        surface_depth=mixture.surface_depth,
        curvature_length=mixture.curvature_length,
        dispersion=mixture.dispersion,
    )


@njit(cache=True, inline="always")
def positive_part(z: float, smoothing: float) -> float:
    """P(z): max(z, 0), rounded off over a width `smoothing`."""
    if smoothing == 0.0:
        return max(z, 0.0)
    return 0.5 * (z + math.sqrt(z * z + smoothing * smoothing))


@njit(cache=True, inline="always")
def repose_slopes(phi: Values, law: Law) -> Values:
    """theta_a(phi): repose slope of each rolling species on a surface of composition `phi`."""
    theta = phi
    for a in range(len(phi)):
        slope = 0.0
        for b in range(len(phi)):
            slope += law.repose_slope[a][b] * phi[b]
        theta = put(theta, a, slope)
    return theta


@njit(cache=True, inline="always")
def capture_rates(theta: Values, slope: float, law: Law) -> Values:
    """gamma_aa P(theta_a - s) [1/s]: the chance per time that a rolling grain of a is captured."""
    rates = theta
    for a in range(len(theta)):
        gap = positive_part(theta[a] - slope, law.smoothing)
        rates = put(rates, a, law.collision_rate[a][a] * gap)
    return rates


@njit(cache=True, inline="always")
def amplification_rates(theta: Values, slope: float, rolling: Values, law: Law) -> Values:
    """sum_b [mu_ba + gamma_ba P(s - theta_b)] R_b [cm/s]: static a set rolling, per phi_a."""
    rates = theta
    for a in range(len(theta)):
        rate = 0.0
        for b in range(len(theta)):
            push = law.collision_rate[b][a] * positive_part(slope - theta[b], law.smoothing)
            rate += (law.cross_amplification[b][a] + push) * rolling[b]
        rates = put(rates, a, rate)
    return rates


def interaction(rolling: Floats, phi: Floats, slope: Floats, law: Law) -> Floats:
    """Gamma_a (species, cell) [cm/s] of rolling thicknesses on surfaces `phi` at slopes (cell,)."""
    gamma = np.empty_like(rolling)
    _interact(tuple(gamma), tuple(rolling), tuple(phi), slope, law)
    return gamma


@njit(cache=True, error_model="numpy")
def _interact(gamma: Rows, rolling: Rows, phi: Rows, slope: Floats, law: Law) -> None:
    like = law.repose_slope[0]
    for i in range(slope.size):
        flow, surface = at(rolling, i, like), at(phi, i, like)
        theta = repose_slopes(surface, law)
        captured = capture_rates(theta, slope[i], law)
        amplified = amplification_rates(theta, slope[i], flow, law)
        for a in range(len(gamma)):
            gamma[a][i] = surface[a] * amplified[a] - captured[a] * flow[a]
