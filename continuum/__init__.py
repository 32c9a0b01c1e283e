"""The continuum: surface-flow equations of granular mixtures, their theory and their solver."""

from continuum.law import Law, interaction, law_of
from continuum.run import Resolution, check, pour
from continuum.theory.steady_state import SteadyState, steady_state_of

__all__ = [
    "Law",
    "Resolution",
    "SteadyState",
    "check",
    "interaction",
    "law_of",
    "pour",
    "steady_state_of",
]
