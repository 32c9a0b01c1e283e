"""What the kernel of the rate rule works on; species are numbered by rank, the smallest is 0."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ca_model.draws import RandomState
from ca_model.kernel.bits import Word
from experiment.arrays import Floats, Ints
from experiment.law import Law
from experiment.species import Values

__all__ = ["LANES", "LEFT", "RIGHT", "Draws", "Exchange", "FlowingPile", "bare_draws"]

RIGHT, LEFT = 0, 1
LANES = Word(8)  # whole registers of columns are done sooner than a few columns less


class Exchange(NamedTuple):
    """The rule by the rank of its species; their number is known when it is compiled."""

    law: Law
    grain_height: tuple[int, ...]  # (rank,) u
    fastest: Values  # (rank,) 1/s; the largest rate of each
    rigid_fraction: Values  # (rank,) composition of the ground
    contacts: int
    sharpness: float  # k
    amplification: float  # c
    depth: int  # of the surface layer, u
    tallest: int  # of the grains, u
    unit: float  # cm
    width: float  # cm
    step: float  # s


class FlowingPile(NamedTuple):
    """A pile between two ends, changed in place."""

    wall: bool  # whether walls stand at the ends; else grains fall over lips
    height: Ints  # (1 + column + 1,) in u, with the lips
    rolling: Ints  # (side, rank, 1 + column + 1) grains, with those that leave
    layer: Ints  # (rank, column) grains of the surface layer
    stack: NDArray[np.int8]  # (column, place) ranks of the grains below it, lowest first
    grains: Ints  # (column,) how many places of the stack are taken
    handed_on: Ints  # (column,) how many grains there were below those
    at_rest: Ints  # (rank,) grains of all layers and stacks, and below
    outflow: Ints  # (rank,) grains that fell over the lips
    random: RandomState


class Draws(NamedTuple):
    """The draws of a sub-step: how many grains of each rank are captured, then how many loosened.

    Those of a column are drawn in this order, one column after the other.
    """

    grains: Ints  # (draw, column) n, of which some are drawn
    chance: Floats  # (draw, column) p, that of each
    none: Floats  # (draw, column) (1 - p)^n, that of none, or NEVER or OTHERWISE
    power: Floats  # (column,) 1 - p, squared again and again


def bare_draws(ranks: int, columns: int) -> Draws:
    """Room for them, and for as many more columns as fill the last of the registers."""
    whole = -(-columns // int(LANES)) * int(LANES)
    each = (2 * ranks, whole)
    return Draws(np.zeros(each, dtype=np.int64), np.zeros(each), np.zeros(each), np.zeros(whole))
