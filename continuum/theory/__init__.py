"""What the equations say before anything is poured: which disturbances grow, and how fast."""

from continuum.theory.spectrum import (
    Spectrum,
    critical_delta,
    growth_rates,
    leading_growth_rate,
    spectrum_of,
)
from continuum.theory.well_posedness import (
    UniformFlow,
    growth_rate,
    rise_velocity,
    short_wave_growth_rate,
    uniform_flows,
    wave_rates,
)

__all__ = [
    "Spectrum",
    "UniformFlow",
    "critical_delta",
    "growth_rate",
    "growth_rates",
    "leading_growth_rate",
    "rise_velocity",
    "short_wave_growth_rate",
    "spectrum_of",
    "uniform_flows",
    "wave_rates",
]
