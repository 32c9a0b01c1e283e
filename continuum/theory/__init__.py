"""What the equations say before anything is poured: closed forms, and which disturbances grow."""

from continuum.theory.bcre import ClimbingWave, poured_step, spread_step
from continuum.theory.boutreux_de_gennes import MinimalModel, minimal_model_of
from continuum.theory.collisions import collision_matrix
from continuum.theory.de_gennes import Drum, Silo, drum_of, silo_of
from continuum.theory.kinks import (
    wavelength_of_kink,
    wavelength_of_period,
    wavelength_of_velocities,
)
from continuum.theory.perturbation import Perturbation, perturbation_of
from continuum.theory.spectrum import (
    Spectrum,
    critical_delta,
    growth_rates,
    leading_growth_rate,
    spectrum_of,
)
from continuum.theory.steady_state import SimplifiedSteadyState, SteadyState, steady_state_of
from continuum.theory.well_posedness import (
    UniformFlow,
    growth_rate,
    rise_velocity,
    short_wave_growth_rate,
    uniform_flows,
    wave_rates,
)

__all__ = [
    "ClimbingWave",
    "Drum",
    "MinimalModel",
    "Perturbation",
    "Silo",
    "SimplifiedSteadyState",
    "Spectrum",
    "SteadyState",
    "UniformFlow",
    "collision_matrix",
    "critical_delta",
    "drum_of",
    "growth_rate",
    "growth_rates",
    "leading_growth_rate",
    "minimal_model_of",
    "perturbation_of",
    "poured_step",
    "rise_velocity",
    "short_wave_growth_rate",
    "silo_of",
    "spectrum_of",
    "spread_step",
    "steady_state_of",
    "uniform_flows",
    "wave_rates",
    "wavelength_of_kink",
    "wavelength_of_period",
    "wavelength_of_velocities",
]
