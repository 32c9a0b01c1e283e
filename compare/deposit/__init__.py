"""The deposit: layers along the vertical, zones along the slope."""

from compare.deposit.laid import Laid
from compare.deposit.layers import layers, layers_of, look
from compare.deposit.profiles import settled_coarseness

__all__ = ["Laid", "layers", "layers_of", "look", "settled_coarseness"]
