"""The exchange between rolling and static grains, for a row of cells at one instant.

    theta_a(phi) = sum_b theta_ab phi_b                                generalised repose slope
    capture      = gamma_aa P(theta_a - s) R_a                         b_a of the paper
    amplification = phi_a sum_b [mu_ba + gamma_ba P(s - theta_b)] R_b  a_a (b = a), x_b (b != a)
    Gamma_a      = amplification - capture

Makse, PRE 56, 7008 (1997), Eqs. (canonical2), (dependence), (mcs-r), for N species; mu is the
constant cross-amplification of Boutreux and de Gennes. P(z) = (z + sqrt(z^2 + w^2)) / 2: without
smoothing (w = 0) this is max(z, 0) exactly. First index of a matrix: the rolling species.

Arrays are (species, cell), so that each loop runs along the cells; results go into the first one.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from experiment import Mixture, NotApplicableError
from experiment.arrays import Floats

__all__ = [
    "Law",
    "find_amplification_rate",
    "find_capture_rate",
    "find_push",
    "find_repose_slope",
    "interaction",
    "law_of",
    "positive_part",
]


class Law(NamedTuple):
    """The law of a mixture as arrays; matrices are (rolling species, surface species)."""

    repose_slope: Floats  # 1
    collision_rate: Floats  # 1/s
    cross_amplification: Floats  # 1/s
    smoothing: float  # 1
    surface_depth: float  # cm
    curvature_length: float  # cm


def law_of(mixture: Mixture) -> Law:
    """The law of `mixture`. Raises :class:`NotApplicableError` where it has no collision rates."""
    if mixture.collision_rate is None:
        raise NotApplicableError(
            "mixture.collision_rate: missing; the continuum needs it (a matrix of rates, 1/s)"
        )
    rates = np.array(mixture.collision_rate, dtype=np.float64)
    constant = mixture.cross_amplification
    return Law(
        repose_slope=np.array(mixture.repose_slope, dtype=np.float64),
        collision_rate=rates,
        cross_amplification=np.zeros_like(rates) if constant is None else np.array(constant),
        smoothing=mixture.smoothing,
        surface_depth=mixture.surface_depth,
        curvature_length=mixture.curvature_length,
    )


@njit(cache=True, inline="always")
def positive_part(z: float, smoothing: float) -> float:
    """P(z): max(z, 0), rounded off over a width `smoothing`."""
    if smoothing == 0.0:
        return max(z, 0.0)
    return 0.5 * (z + math.sqrt(z * z + smoothing * smoothing))


@njit(cache=True, error_model="numpy", forceinline=True)
def find_repose_slope(theta: Floats, phi: Floats, law: Law) -> None:
    """theta_a(phi): repose slope of each rolling species on surfaces of composition `phi`."""
    species, cells = phi.shape
    for a in range(species):
        for i in range(cells):
            theta[a, i] = law.repose_slope[a, 0] * phi[0, i]
        for b in range(1, species):
            for i in range(cells):
                theta[a, i] += law.repose_slope[a, b] * phi[b, i]


@njit(cache=True, error_model="numpy", forceinline=True)
def find_capture_rate(rate: Floats, theta: Floats, slope: Floats, law: Law) -> None:
    """gamma_aa P(theta_a - s) [1/s]: the chance per time that a rolling grain of a is captured."""
    species, cells = theta.shape
    for a in range(species):
        gamma = law.collision_rate[a, a]
        for i in range(cells):
            rate[a, i] = gamma * positive_part(theta[a, i] - slope[i], law.smoothing)


@njit(cache=True, error_model="numpy", forceinline=True)
def find_push(push: Floats, theta: Floats, slope: Floats, rolling: Floats, law: Law) -> None:
    """P(s - theta_b) R_b [cm]: by how much, and how thickly, b rolls on too steep a surface."""
    species, cells = theta.shape
    for b in range(species):
        for i in range(cells):
            push[b, i] = positive_part(slope[i] - theta[b, i], law.smoothing) * rolling[b, i]


@njit(cache=True, error_model="numpy", forceinline=True)
def find_amplification_rate(rate: Floats, push: Floats, rolling: Floats, law: Law) -> None:
    """sum_b gamma_ba P(s - theta_b) R_b + mu_ba R_b [cm/s]: static a set rolling, per phi_a."""
    species, cells = rate.shape
    for a in range(species):
        gamma = law.collision_rate[:, a]
        for i in range(cells):
            rate[a, i] = gamma[0] * push[0, i]
        for b in range(1, species):
            for i in range(cells):
                rate[a, i] += gamma[b] * push[b, i]
        for b in range(species):
            mu = law.cross_amplification[b, a]
            if mu > 0.0:
                for i in range(cells):
                    rate[a, i] += mu * rolling[b, i]


def interaction(rolling: Floats, phi: Floats, slope: Floats, law: Law) -> Floats:
    """Gamma_a (species, cell) [cm/s] of rolling thicknesses on surfaces `phi` at slopes (cell,)."""
    theta, captured, push, amplified = (np.empty_like(rolling) for _ in range(4))
    find_repose_slope(theta, phi, law)
    find_capture_rate(captured, theta, slope, law)
    find_push(push, theta, slope, rolling, law)
    find_amplification_rate(amplified, push, rolling, law)
    return phi * amplified - captured * rolling
