"""The instrument: kinks, layers and regimes from archives, models side by side, the command line.

Measurements and pictures see archives only; only the command line runs the models.
"""

from compare.accessor import Strata
from compare.convergence import converge
from compare.deposit import layers, layers_of
from compare.figure import draw
from compare.kymograph import cycle_period, fronts, kinks
from compare.measurement import compare, measure
from compare.regimes import regime

__all__ = [
    "Strata",
    "compare",
    "converge",
    "cycle_period",
    "draw",
    "fronts",
    "kinks",
    "layers",
    "layers_of",
    "measure",
    "regime",
]
