"""The continuum: surface-flow equations of granular mixtures and their solver.

What they say in closed form, and which disturbances grow, is in :mod:`continuum.theory`.
"""

from continuum.run import Resolution, begin, check, pour
from experiment.law import Law, interaction, law_of

__all__ = ["Law", "Resolution", "begin", "check", "interaction", "law_of", "pour"]
