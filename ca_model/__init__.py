"""The lattice model of rolling and captured grains (Makse, Cizeau and Stanley's rule)."""

from ca_model.lattice import Lattice, Rule, Settings, lattice_of
from ca_model.run import check, pour

__all__ = ["Lattice", "Rule", "Settings", "check", "lattice_of", "pour"]
