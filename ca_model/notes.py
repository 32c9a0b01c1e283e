"""What an archive says of the lattice: its numbers, and where they limit what the run can tell."""

from collections.abc import Iterator
from itertools import groupby

import numpy as np

from ca_model.lattice import MANY, Lattice, RateRule, TopplingRule
from experiment import Mixture
from experiment.arrays import Ints
from experiment.pouring import Sliced

__all__ = ["notes"]

LATE = 10  # the last tenth of the records


def notes(mixture: Mixture, lattice: Lattice, height: Sliced) -> dict[str, object]:
    """Attributes of the archive: what the lattice made of the set-up, in lattice units and in cm.

    A `comment` says which repose slopes act alike, because they lie between the same integers, and
    whether the feed exceeds what the surface can capture, from the heights (time, x) [cm].
    """
    rule, unit = lattice.rule, lattice.unit
    told: dict[str, object] = {
        "unit_cm": unit,
        "column_width_cm": lattice.column_width,
        "time_step_s": lattice.step,
        "grain_height": rule.grain_height,
        "grains_per_step": lattice.grains_per_step,
    }
    if isinstance(rule, RateRule):
        told["effective_surface_depth_cm"] = rule.depth * unit
        comments = [*_walls_that_outgrew(mixture, lattice, height)]
    else:
        threshold = rule.threshold
        told["effective_threshold"] = threshold.ravel()
        told["effective_repose_slope"] = threshold.ravel() * unit / lattice.column_width
        comments = [
            *_slopes_that_act_alike(mixture, threshold),
            *_walls_that_outgrew(mixture, lattice, height),
        ]
    if comments:
        told["comment"] = "; ".join(comments)
    return told


def _slopes_that_act_alike(mixture: Mixture, thresholds: Ints) -> Iterator[str]:
    slope = np.array(mixture.repose_slope)
    places = sorted(np.ndindex(slope.shape), key=lambda place: thresholds[place])
    for threshold, alike in groupby(places, key=lambda place: thresholds[place]):
        same = list(alike)
        if np.ptp([slope[place] for place in same]) > 0:
            names = ", ".join(f"theta_{a + 1}{b + 1} = {slope[a, b]:.4g}" for a, b in same)
            yield f"{names} act alike: on the lattice each is a slope of {threshold}"


def _walls_that_outgrew(mixture: Mixture, lattice: Lattice, height: Sliced) -> Iterator[str]:
    """From the heights (time, x) [cm]; for a moment a wall's column may be above its neighbour.

    At rates it is so for ever: half of what reaches the neighbour goes on where theta - s is
    ln 2 v / (gamma w).
    """
    rule = lattice.rule
    if lattice.ground.lips is not None or isinstance(rule, TopplingRule):
        return
    late = max(1, len(height) // LATE)

    def outgrown(wall: slice) -> float:
        grown = np.array(height[-late:, wall]).mean(axis=0) - height[0, wall]
        return float(np.diff(grown)[0])

    outgrowth = max([outgrown(np.s_[-2:]), -outgrown(np.s_[:2])][: lattice.ground.sides])
    allowed = np.max(mixture.repose_slope) * lattice.column_width
    if isinstance(rule, RateRule):
        slowest = min(rates[a] for a, rates in enumerate(rule.law.collision_rate))
        allowed += rule.width / rule.step / (rule.sharpness * slowest)
    if outgrowth > allowed:
        contacts = "all" if rule.contacts == MANY else rule.contacts
        yield (
            f"the wall column outgrew the pile by {outgrowth:.3g} cm: the feed "
            f"exceeds what the surface can capture with ca_model.contacts = {contacts}"
        )
