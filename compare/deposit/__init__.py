"""The deposit: layers along the vertical, zones along the slope."""

from compare.deposit.layers import layers, layers_of
from compare.deposit.profiles import settled_coarseness

__all__ = ["layers", "layers_of", "settled_coarseness"]
