"""The lattice model of rolling and captured grains (Makse, Cizeau and Stanley's rule)."""

from ca_model.lattice import Ground, Lattice, Rule, Settings, TopplingRule, lattice_of
from ca_model.run import check, pour, pour_many

__all__ = [
    "Ground",
    "Lattice",
    "Rule",
    "Settings",
    "TopplingRule",
    "check",
    "lattice_of",
    "pour",
    "pour_many",
]
