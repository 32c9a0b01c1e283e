"""The cell that is filled: a silo of length L, poured into at x = 0, with its wall at x = L."""

from experiment.arrays import Floats
from experiment.fields import Fraction, Part, Positive, Slope

__all__ = ["Cell"]


class Cell(Part):
    """A Hele-Shaw cell, and the rigid surface in it before pouring starts."""

    length: Positive  # cm
    start_slope: Slope = 0.0  # 1
    start_composition: tuple[Fraction, ...] | None = None  # 1; default: all of the smallest species

    def base_height(self, x: Floats) -> Floats:
        """Height of the surface before pouring [cm] at distances x [cm]; 0 at the wall."""
        return self.start_slope * (self.length - x)
