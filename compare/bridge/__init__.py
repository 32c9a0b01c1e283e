"""The bridge between the models: a lattice that takes the continuum's law grain by grain.

Each study pours what it needs, in as many piles as chance wants, and is a file of its name: what
it finds is a Dataset, which :mod:`compare.pictures.bridge` draws.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import xarray as xr
from rich.table import Table

from compare.bridge.between import between, between_table
from compare.bridge.grains import grains, grains_table
from compare.bridge.limit import limit
from compare.bridge.limit_table import limit_table
from compare.pictures.bridge.between import draw_between
from compare.pictures.bridge.grains import draw_grains
from compare.pictures.bridge.limit import draw_limit
from experiment.pouring import Progress

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["STUDIES", "Study"]


class Study(NamedTuple):
    """A study of the bridge."""

    study: Callable[[int, int | None, Progress], xr.Dataset]  # of so many seeds, by so many workers
    draw: Callable[[xr.Dataset], "Figure"]
    table: Callable[[xr.Dataset], Table]


STUDIES = {
    "between": Study(between, draw_between, between_table),
    "grains": Study(grains, draw_grains, grains_table),
    "limit": Study(limit, draw_limit, limit_table),
}
