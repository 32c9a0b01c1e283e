"""The figures of Makse, PRE 56, 7008 (1997), drawn from the code: a file for each, by its label.

Each file has a function that gives the figure's data as a Dataset, and one that draws it.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import xarray as xr

from compare.pictures.paper.angles import draw_repose_angles, repose_angles
from compare.pictures.paper.functions import collision_functions, draw_collision_functions
from compare.pictures.paper.onset import draw_onset, onset
from compare.pictures.paper.phase import draw_regimes, regimes_over_size_and_shape
from compare.pictures.paper.profiles import draw_profiles, profiles
from experiment.pouring import Progress

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["FIGURES", "PaperFigure"]


class PaperFigure(NamedTuple):
    """A figure of the paper."""

    data: Callable[[Progress], xr.Dataset]  # told how far it is, where that takes long
    draw: Callable[[xr.Dataset], "Figure"]


FIGURES = {  # by their labels, in the paper's order
    "angles": PaperFigure(lambda _: repose_angles(), draw_repose_angles),
    "functions": PaperFigure(lambda _: collision_functions(), draw_collision_functions),
    "profiles": PaperFigure(lambda _: profiles(), draw_profiles),
    "onset": PaperFigure(lambda _: onset(), draw_onset),
    "phase": PaperFigure(
        lambda progress: regimes_over_size_and_shape(progress=progress), draw_regimes
    ),
}
