"""The instrument: kinks, layers and regimes from archives, models side by side, the command line.

Measurements and pictures see archives only; only campaigns, the validation and the command line
run the models.
"""

from compare.accessor import Strata
from compare.campaign import campaign
from compare.convergence import converge
from compare.deposit import layers, layers_of
from compare.ensemble import draws, piles, piles_mean, predict
from compare.kymograph import cycle_period, fronts, kinks
from compare.measurement import compare, measure
from compare.phase import phase
from compare.pictures import animate, draw, draw_scaling
from compare.regimes import regime
from compare.scaling import fit_wavelength, over_inflow

__all__ = [
    "Strata",
    "animate",
    "campaign",
    "compare",
    "converge",
    "cycle_period",
    "draw",
    "draw_scaling",
    "draws",
    "fit_wavelength",
    "fronts",
    "kinks",
    "layers",
    "layers_of",
    "measure",
    "over_inflow",
    "phase",
    "piles",
    "piles_mean",
    "predict",
    "regime",
]
