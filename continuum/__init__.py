"""The continuum: surface-flow equations of granular mixtures, their theory and their solver."""

from continuum.law import Law, interaction, law_of
from continuum.run import Resolution, pour

__all__ = ["Law", "Resolution", "interaction", "law_of", "pour"]
