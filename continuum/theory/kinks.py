"""What the balance of volume says about a stratified pour, whatever the law of exchange.

Each cycle of period T lays one pair of layers of vertical thickness lambda on the whole slope:

    lambda = R0 v T / L

A cycle is an avalanche front going down at v_f and a kink coming up at v_k, T = L / v_f + L / v_k;
and a kink that stops a flow of thickness R0 lays what arrives while it passes, R0 (v + v_k) / v_k,
which is the same for v_f = v.
"""

__all__ = ["wavelength_of_kink", "wavelength_of_period", "wavelength_of_velocities"]


def wavelength_of_period(inflow: float, velocity: float, period: float, length: float) -> float:
    """Lambda = R0 v T / L [cm]."""
    return inflow * velocity * period / length


def wavelength_of_velocities(inflow: float, velocity: float, front: float, kink: float) -> float:
    """Lambda = R0 v (1 / v_f + 1 / v_k) [cm]; velocities [cm/s] are positive."""
    return inflow * velocity * (1.0 / front + 1.0 / kink)


def wavelength_of_kink(inflow: float, velocity: float, kink: float) -> float:
    """Lambda = R0 (v + v_k) / v_k [cm]: the front keeps pace with the grains."""
    return inflow * (velocity + kink) / kink
