"""The instrument: kinks, layers and regimes from archives, models side by side, the command line.

Measurements and pictures see archives only; only the command line runs the models.
"""

from compare.convergence import converge
from compare.deposit import layers
from compare.figure import draw
from compare.kymograph import cycle_period, fronts, kinks
from compare.measurement import compare, measure
from compare.regimes import regime, segregation

__all__ = [
    "compare",
    "converge",
    "cycle_period",
    "draw",
    "fronts",
    "kinks",
    "layers",
    "measure",
    "regime",
    "segregation",
]
