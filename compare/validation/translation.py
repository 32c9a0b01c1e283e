"""From centimetres and seconds to a lattice: worked out apart from `ca_model.lattice`.

    u = smallest d_a    w = 10 u    H_a = round(d_a / u)    s_ab = ceil(theta_ab w / u)
    columns round(L / w)    a step w / v    grains a step R_a^0 / (H_a u)    (DESIGN, section 3)

Kernels and reference take these numbers alike, so that they agree says nothing of them.
"""

import math

import numpy as np
import xarray as xr

from compare.quantities import values_of
from compare.validation.check import ROUND_OFF, Check, Checks, Poured
from experiment.arrays import Floats

__all__ = ["translation"]

SOURCE = "docs/models/lattice.md, worked out by hand"
BY_HAND = {  # glass-sugar: d = 0.027 and 0.08 cm, 26 and 39 degrees, psi = 0.3, L = 30 cm
    "grain heights H_1, H_2 (0.08 / 0.027 = 2.96)": ("grain_height", [1, 3]),
    "thresholds s_11, s_12, s_21, s_22 (4.88, 11.10, 1.88, 8.10)": (
        "effective_threshold",
        [5, 12, 2, 9],
    ),
}
COLUMNS, STEP = 111, 0.027  # 30 / 0.27 = 111.1; 0.27 cm / (10 cm/s)
GRAINS = np.array([0.125 / 0.027, 0.125 / 0.081])  # a step
VOLUME = np.array([0.027, 0.081]) * 0.27  # cm2, of a grain
ERRORS = 4.0


def translation(poured: Poured) -> Checks:
    """The lattice of `glass-sugar`: what a grain, a column, a threshold and a step become.

    Over a pour as many grains arrive as the feed says, whatever of it is left to chance.
    """
    archive = poured("ca_model", "glass-sugar")
    for what, (name, expected) in BY_HAND.items():
        found = np.ravel(archive.attrs[name]).tolist()
        yield Check(what, SOURCE, _told(expected), _told(found))
    yield Check("columns", SOURCE, float(COLUMNS), float(archive.sizes["x"]))
    step = float(archive.attrs["time_step_s"])
    yield Check("a step w / v", SOURCE, STEP, step, ROUND_OFF, "round-off", "s")
    yield from _arrived("fixed", archive, np.ones(2), "a grain of each species")
    drawn = poured("ca_model", "glass-sugar", "ca_model.arrivals=drawn")
    grains = GRAINS * _steps(drawn)
    spread = np.full(2, math.sqrt(grains[0] * grains[1] / grains.sum()))
    yield from _arrived("drawn", drawn, ERRORS * spread, "4 binomial standard errors")
    poisson = poured("ca_model", "glass-sugar", "ca_model.arrivals=poisson")
    spread = np.sqrt(GRAINS * _steps(poisson))
    yield from _arrived("poisson", poisson, ERRORS * spread, "4 standard errors of Poisson")


def _arrived(arrivals: str, archive: xr.Dataset, bound: Floats, why: str) -> Checks:
    """The grains of each species that were poured, to within `bound` (species,) grains."""
    found = values_of(archive, "poured_volume")[-1] / VOLUME
    expected = GRAINS * _steps(archive)
    for a, name in enumerate(values_of(archive, "species_name").tolist()):
        yield Check(
            f"grains of {name} that arrived, {arrivals}",
            "v R_a^0 T / (w H_a u)",
            float(expected[a]),
            float(found[a]),
            float(bound[a]),
            why,
        )


def _steps(archive: xr.Dataset) -> int:
    return round(float(values_of(archive, "time")[-1]) / STEP)


def _told(numbers: list[int]) -> str:
    return ", ".join(map(str, numbers))
