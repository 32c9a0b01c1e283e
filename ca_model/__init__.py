"""The lattice model of rolling and captured grains (Makse, Cizeau and Stanley's rule)."""

from ca_model.lattice import Ground, Lattice, RateRule, Rule, Settings, TopplingRule, lattice_of
from ca_model.run import begin, check, pour, pour_many
from ca_model.stream import pour_to_disk, read_section

__all__ = [
    "Ground",
    "Lattice",
    "RateRule",
    "Rule",
    "Settings",
    "TopplingRule",
    "begin",
    "check",
    "lattice_of",
    "pour",
    "pour_many",
    "pour_to_disk",
    "read_section",
]
