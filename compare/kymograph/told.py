"""What is told of the lines of one kind: plain arrays, and the Dataset that they make."""

from typing import Any, NamedTuple

import xarray as xr
from numpy.typing import NDArray

from compare.kymograph.cycles import Seen
from compare.quantities import named
from experiment.arrays import Floats

__all__ = ["Rows", "Told", "compared"]

UNPAIRED = 3, 1 / 3  # kinks more than fronts, or fewer, and which share, so that it is remarked

Rows = dict[str, tuple[Any, Any, str, str]]  # dims, values, units and meaning by name


class Told(NamedTuple):
    """Lines on the columns `x`, and what is told of each of them."""

    x: Floats  # (x,) [cm]
    measured: NDArray[Any]  # (x,) whether velocities are taken there
    rows: Rows
    attributes: dict[str, Any]  # of the Dataset

    @property
    def seen(self) -> Seen:
        """The lines in the measured columns."""
        return Seen(
            self.rows["passage"][1][:, self.measured],
            self.rows["velocity"][1],
            self.rows["velocity_error"][1],
            self.attributes["sampling_s"],
            bool(self.attributes["aliased"]),
        )

    @property
    def comment(self) -> str:
        """What the records cannot tell, or is amiss; empty where there is nothing to say."""
        return str(self.attributes.get("comment", ""))

    def dataset(self) -> xr.Dataset:
        """The same as a Dataset over `event` and `x`."""
        coordinates: Rows = {
            "x": ("x", self.x, "cm", "distance from the pouring point"),
            "measured": ("x", self.measured, "", "whether velocities are taken here"),
        }
        return xr.Dataset(_variables(self.rows), _variables(coordinates), self.attributes)


def compared(kinks: Told, fronts: Told) -> tuple[Told, Told]:
    """Both, with a comment if not every front has its kink, as in a sound pour."""
    up, down = len(kinks.rows["velocity"][1]), len(fronts.rows["velocity"][1])
    least, share = UNPAIRED
    if abs(up - down) < least or abs(up - down) <= share * max(up, down):
        return kinks, fronts
    remark = f"{up} kinks and {down} fronts: some lines are missed, invented or broken"

    def remarked(lines: Told) -> Told:
        comment = "; ".join(filter(None, (lines.comment, remark)))
        return lines._replace(attributes=lines.attributes | {"comment": comment})

    return remarked(kinks), remarked(fronts)


def _variables(rows: Rows) -> dict[str, tuple[Any, Any, dict[str, str]]]:
    return {
        name: (dims, values, named(meaning, units))
        for name, (dims, values, units, meaning) in rows.items()
    }
