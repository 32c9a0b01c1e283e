"""Short waves on an endless slope: whether the equations themselves choose a shortest length.

A uniform flow of thicknesses R_a on a surface of composition phi_a and slope s that keeps its
composition while it rises by w = - sum_a Gamma_a, on a deposit of its own composition,

    Gamma_a = phi_a sum_b Gamma_b                    (paper: phi_a dh/dt = - Gamma_a)

is disturbed by waves exp(i k x + sigma t). With q = - i k + l k^2, ds = q dh and
dGamma_a = sum_b (A_ab dR_b + B_ab dphi_b) + c_a ds,

    sigma dR_a     = - (i k v_a + D k^2) dR_a + dGamma_a
    sigma dh       = - sum_a dGamma_a
    sigma d dphi_a = - dGamma_a + phi_a sum_b dGamma_b - max(w, 0) dphi_a

Where w = 0 this is exact; else R_a falls as the grains settle, and sigma holds for waves that grow
faster than that, w / R (coefficients frozen).

Short waves, l = D = 0: dh climbs at C = sum_a c_a and leaves dphi_a = (c_a / C - phi_a) dh / d and
dR_a = - c_a dh / (C + v_a) behind it, which act back on it as

    sigma -> i k C + sum_ab A_ab c_b / (C + v_b) - (1 / d) sum_ab B_ab (c_b / C - phi_b)

and so at a rate that does not depend on k: nothing chooses a shortest length. Where two species are
both captured this is gamma m R (phi_1 - R_1 / R) / d less the settling. Dispersion takes the second
term away and leaves the third. Curvature adds - C l k^2, which cuts waves off; so does the
upwind slope (h_i - h_{i+1}) / dx of Godunov's scheme, which adds dx / 2 to l, at the grid's length.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from experiment import NotApplicableError
from experiment.arrays import Floats
from experiment.law import Law, interaction

__all__ = [
    "UniformFlow",
    "growth_rate",
    "rise_velocity",
    "short_wave_growth_rate",
    "uniform_flows",
    "wave_rates",
]

COMPOSITIONS = 2001  # scanned for the balance of two species


class UniformFlow(NamedTuple):
    """A uniform flow on an endless slope; arrays are (species,)."""

    rolling: Floats  #: R_a, cm
    fraction: Floats  #: phi_a, 1
    slope: float  #: s, 1


class Response(NamedTuple):
    """How Gamma_a answers to R_b, phi_b (a, b) and the slope (a,)."""

    to_rolling: Floats  # A, 1/s
    to_fraction: Floats  # B, cm/s
    to_slope: Floats  # c, cm/s


def uniform_flows(law: Law, rolling: Floats, slope: float) -> list[UniformFlow]:
    """The flows of `rolling` (species,) [cm] at `slope` that keep their composition.

    For one or two species, ordered by the share of the first; between theta_21 and theta_22 there
    may be several, which is where stratification comes from. Only those that rise or rest: what an
    eroding surface is made of lies below it.
    """
    thickness = np.asarray(rolling, dtype=np.float64)
    if thickness.size == 1:
        found = [UniformFlow(thickness, np.ones(1), slope)]
    elif thickness.size == 2:
        shares = _balanced_shares(law, thickness, slope)
        found = [UniformFlow(thickness, np.array([u, 1.0 - u]), slope) for u in shares]
    else:
        raise NotApplicableError(
            f"mixture: {thickness.size} species; flows are found for one or two"
        )
    return [flow for flow in found if rise_velocity(flow, law) >= -1e-12 * thickness.sum()]


def rise_velocity(flow: UniformFlow, law: Law) -> float:
    """W = - sum_a Gamma_a [cm/s], at which the surface rises."""
    return -float(_interaction(flow, law).sum())


def wave_rates(
    flow: UniformFlow, law: Law, velocity: Floats, wavenumber: Floats, dispersion: float = 0.0
) -> NDArray[np.complexfloating[Any]]:
    """All sigma [1/s] (k, mode) at `wavenumber` (k,) [1/cm]; velocity (species,) [cm/s]."""
    species = len(flow.rolling)
    a, b, c = response(flow, law)
    b = b[:, :-1] - b[:, -1:]  # dphi of the last species is less the sum of the others
    k = np.asarray(wavenumber, dtype=np.float64)
    q = -1j * k + law.curvature_length * k**2
    change = np.zeros((k.size, species, 2 * species), dtype=np.complex128)  # of Gamma, per k
    change[:, :, :species] = a
    change[:, :, species] = q[:, np.newaxis] * c
    change[:, :, species + 1 :] = b
    total = change.sum(axis=1)
    matrix = np.zeros((k.size, 2 * species, 2 * species), dtype=np.complex128)
    matrix[:, :species] = change
    matrix[:, species] = -total
    mixed = flow.fraction[:-1, np.newaxis] * total[:, np.newaxis]
    matrix[:, species + 1 :] = (mixed - change[:, :-1]) / law.surface_depth
    rolls, holds = np.arange(species), np.arange(species + 1, 2 * species)
    matrix[:, rolls, rolls] -= np.outer(1j * k, velocity) + dispersion * k[:, np.newaxis] ** 2
    matrix[:, holds, holds] -= max(rise_velocity(flow, law), 0.0) / law.surface_depth
    return np.linalg.eigvals(matrix)


def growth_rate(
    flow: UniformFlow, law: Law, velocity: Floats, wavenumber: Floats, dispersion: float = 0.0
) -> Floats:
    """The largest Re sigma [1/s] (k,) at `wavenumber` (k,) [1/cm]; velocity (species,) [cm/s]."""
    rates = wave_rates(flow, law, velocity, wavenumber, dispersion)
    return np.asarray(rates.real.max(axis=1))


def short_wave_growth_rate(flow: UniformFlow, law: Law, velocity: Floats) -> float:
    """Re sigma [1/s] of climbing waves of the slope as k grows, for l = D = 0."""
    a, b, c = response(flow, law)
    climb = c.sum()
    from_rolling = a.sum(axis=0) @ (c / (climb + velocity))
    from_fraction = b.sum(axis=0) @ (c / climb - flow.fraction) / law.surface_depth
    return float(from_rolling - from_fraction)


def response(flow: UniformFlow, law: Law) -> Response:
    """The derivatives of Gamma_a; on a kink of P(z), z = 0, the mean of both sides."""
    rolling, phi = flow.rolling, flow.fraction
    gamma, theta = np.array(law.collision_rate), np.array(law.repose_slope)
    own, mu = np.diag(gamma), np.array(law.cross_amplification)
    excess = flow.slope - theta @ phi  # s - theta_a
    width = np.hypot(excess, law.smoothing)
    steep = 0.5 * (1.0 + np.divide(excess, width, out=np.zeros_like(excess), where=width > 0))
    captured = own * 0.5 * (width - excess)
    push = mu + gamma * 0.5 * (width + excess)[:, np.newaxis]  # (b, a)
    pushed = gamma * (steep * rolling)[:, np.newaxis]  # (b, a): change of push_ba R_b with s
    capturable = own * (1.0 - steep) * rolling
    return Response(
        to_rolling=phi[:, np.newaxis] * push.T - np.diag(captured),
        to_fraction=np.diag(rolling @ push)
        - phi[:, np.newaxis] * (pushed.T @ theta)
        - capturable[:, np.newaxis] * theta,
        to_slope=phi * pushed.sum(axis=0) + capturable,
    )


def _interaction(flow: UniformFlow, law: Law) -> Floats:
    columns = flow.rolling[:, np.newaxis], flow.fraction[:, np.newaxis]
    return interaction(*columns, np.array([flow.slope]), law)[:, 0]


def _balanced_shares(law: Law, rolling: Floats, slope: float) -> list[float]:
    """The phi_1 in [0, 1] at which Gamma_1 = phi_1 (Gamma_1 + Gamma_2)."""

    def missed(share: float) -> float:
        gamma = _interaction(UniformFlow(rolling, np.array([share, 1.0 - share]), slope), law)
        return float(share * gamma[1] - (1.0 - share) * gamma[0])

    shares = np.linspace(0.0, 1.0, COMPOSITIONS)
    balance = np.array([missed(share) for share in shares])
    crossed = np.flatnonzero(balance[:-1] * balance[1:] < 0.0)
    between = [brentq(missed, shares[i], shares[i + 1], xtol=1e-14) for i in crossed]
    return sorted([*map(float, shares[balance == 0.0]), *between])
