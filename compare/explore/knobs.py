"""What can be turned on the page: each knob reads a number off a set-up and puts it back.

repose angles   degrees, of the pure species; their tangents are theta_11 and theta_22
psi             theta_11 - theta_21, as it is: in nature the difference in size gives it
sizes           mm; on the lattice grains are so high, and columns ten of the small ones wide;
                in the continuum the surface layer and the curvature length grow as their mean
R0, share_2     how much is poured, and what part of it is large; the pour lasts until the same
                volume is there, however fast
"""

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

from experiment import Experiment, SetupError

__all__ = ["KNOBS", "Knob", "turned"]

MM = 10.0  # in a cm


class Knob(NamedTuple):
    """A number of a set-up, and between what it can be turned."""

    name: str
    label: str
    read: Callable[[Experiment], float]
    low: float
    high: float
    step: float
    of_preset: bool = False  # whether low, high and step count in what the preset has

    def range_of(self, preset: Experiment) -> tuple[float, float, float]:
        """Lowest value, highest value and step, for the set-ups that begin with a preset."""
        scale = self.read(preset) if self.of_preset else 1.0
        return self.low * scale, self.high * scale, self.step * scale


def _angle(species: int) -> Callable[[Experiment], float]:
    return lambda setup: math.degrees(math.atan(setup.mixture.repose_slope[species][species]))


def _diameter(species: int) -> Callable[[Experiment], float]:
    return lambda setup: setup.mixture.grain_diameter[species] * MM


def _share_2(setup: Experiment) -> float:
    return setup.feed.inflow[1] / math.fsum(setup.feed.inflow)


KNOBS = {
    knob.name: knob
    for knob in (
        Knob("angle_1", "repose angle of small grains (°)", _angle(0), 5.0, 60.0, 0.5),
        Knob("angle_2", "repose angle of large grains (°)", _angle(1), 5.0, 60.0, 0.5),
        Knob("psi", "ψ, large on small (tangents)", lambda setup: setup.mixture.psi, 0, 0.6, 0.01),
        Knob("diameter_1", "size of small grains (mm)", _diameter(0), 0.5, 2.5, 0.05, True),
        Knob("diameter_2", "size of large grains (mm)", _diameter(1), 0.4, 2.0, 0.05, True),
        Knob(
            "total_inflow",
            "flux: what rolls in, R0 (cm)",
            lambda setup: math.fsum(setup.feed.inflow),
            0.2,
            4.0,
            0.1,
            True,
        ),
        Knob("share_2", "large grains in the feed", _share_2, 0.05, 0.95, 0.05),
    )
}


def turned(preset: Experiment, values: Mapping[str, float]) -> Experiment:
    """A preset with the knobs that are in `values` turned to these; the preset where none is.

    What was published for the preset is not for a mixture that is another. Raises
    :class:`SetupError` with one line where the set-up that is asked for is none.
    """
    if not values:
        return preset
    wanted = {name: knob.read(preset) for name, knob in KNOBS.items()} | dict(values)
    changes: dict[str, object] = {"title": f"{preset.title}, changed", "published": None}
    if values.keys() & {"angle_1", "angle_2", "psi"}:
        changes |= {
            "mixture.theta_11": math.tan(math.radians(wanted["angle_1"])),
            "mixture.theta_22": math.tan(math.radians(wanted["angle_2"])),
            "mixture.psi": wanted["psi"],
        }
    if values.keys() & {"diameter_1", "diameter_2"}:
        changes |= _of_sizes(preset, wanted["diameter_1"] / MM, wanted["diameter_2"] / MM)
    if "share_2" in values:
        changes["feed.share_2"] = wanted["share_2"]
    if "total_inflow" in values:
        thicker = wanted["total_inflow"] / KNOBS["total_inflow"].read(preset)
        changes["feed.total_inflow"] = wanted["total_inflow"]
        changes["pour.duration"] = preset.pour.duration / thicker
    return preset.with_values(changes)


def _of_sizes(preset: Experiment, small: float, large: float) -> dict[str, object]:
    if large < small:
        raise SetupError(
            f"mixture.grain_diameter = [{small:.3g}, {large:.3g}]: "
            "the large grains should not be the smaller ones"
        )
    mixture = preset.mixture
    larger = (small + large) / math.fsum(mixture.grain_diameter)
    return {
        "mixture.grain_diameter": [small, large],
        "mixture.surface_depth": mixture.surface_depth * larger,
        "mixture.curvature_length": mixture.curvature_length * larger,
    }
