"""The cell that is filled: a silo, a heap or a turning drum, between two plates.

    silo   poured into at x = 0, ends at x = L
    heap   poured onto at x = 0, in its middle; ends at x = -L and L; the feed R_a^0 goes to
           either side
    drum   of diameter L about x = 0; half full, turned and not fed

A silo and a heap end at walls, or are open: then grains fall off over a lip as high as the surface
was there before pouring.
"""

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from experiment.arrays import Floats
from experiment.fields import Fraction, NonNegative, Number, Part, Positive, Slope

__all__ = ["Cell"]

STEEPEST_DRUM = 1.5
Points = Annotated[tuple[tuple[Number, NonNegative], ...], Field(min_length=2)]


class Cell(Part):
    """A Hele-Shaw cell, and the rigid surface in it before pouring starts.

    In a drum the grains of the lower half are of `start_composition`, their surface is straight
    and falls towards positive x.
    """

    shape: Literal["silo", "heap", "drum"] = "silo"  #: what is filled, or turned
    length: Positive  #: cm; L, from the pouring point to an end, or a drum's diameter
    end: Literal["wall", "open"] = "wall"  #: of a silo, or both of a heap
    start_slope: Slope = 0.0  #: 1; of the surface before pouring
    start_surface: Points | None = None  #: cm; points (x, height), instead of a slope
    #: 1; of the grains before pouring; default: all of the smallest species, in a drum equal parts
    start_composition: tuple[Fraction, ...] | None = None
    turning_rate: Positive | None = None  #: 1/s; w, of a drum, which needs it

    @property
    def left(self) -> float:
        """The smallest x [cm] in the cell."""
        return {"silo": 0.0, "heap": -self.length, "drum": -self.length / 2}[self.shape]

    @property
    def right(self) -> float:
        """The largest x [cm] in the cell."""
        return self.length / 2 if self.shape == "drum" else self.length

    @property
    def base_at_end(self) -> Floats:
        """Height [cm] of the lip at a silo's end (1,), or at the left and right of a heap (2,)."""
        ends = [self.right] if self.shape == "silo" else [self.left, self.right]
        return self.base_height(np.array(ends))

    def base_height(self, x: Floats) -> Floats:
        """Height of the surface before pouring [cm] at x [cm].

        It counts from the ends of a slope, and in a drum from the lowest point.
        """
        if self.start_surface is not None:
            points = np.array(self.start_surface)
            return np.asarray(np.interp(x, points[:, 0], points[:, 1]))
        if self.shape == "drum":
            return self.length / 2 - self.start_slope * x
        return self.start_slope * (self.length - np.abs(x))

    @model_validator(mode="after")
    def _check_drum(self) -> Self:
        if self.shape != "drum":
            if self.turning_rate is not None:
                raise ValueError(f"turning_rate = {self.turning_rate:g}: only a drum turns")
            return self
        if self.turning_rate is None:
            raise ValueError("turning_rate: missing; a drum has to turn")
        if self.end == "open":
            raise ValueError("end = 'open': it should be 'wall' in a drum")
        if self.start_slope > STEEPEST_DRUM:
            raise ValueError(
                f"start_slope = {self.start_slope:g}: "
                f"it should be at most {STEEPEST_DRUM} in a drum"
            )
        if self.start_surface is not None:
            raise ValueError(f"{self._surface()}: a drum starts with a start_slope instead")
        return self

    @model_validator(mode="after")
    def _check_surface(self) -> Self:
        if self.start_surface is None:
            return self
        if self.start_slope != 0:
            raise ValueError(
                f"start_slope = {self.start_slope:g}: it should be 0 where a start_surface is given"
            )
        x = np.array(self.start_surface)[:, 0]
        if not (np.diff(x) > 0).all():
            raise ValueError(f"{self._surface()}: its x should grow from point to point")
        if x[0] > self.left or x[-1] < self.right:
            raise ValueError(
                f"{self._surface()}: it should reach from x = {self.left:g} to {self.right:g}"
            )
        return self

    def _surface(self) -> str:
        return f"start_surface = {[list(point) for point in self.start_surface or ()]}"
