"""The rolling layer beside a line: R averaged in the line's own moving frame.

At each column time counts from the line's passage there, tau = t - t(x), and reaches half-way to
the lines before and after. The average over columns goes from one level, in the flow, to the other,
at rest; each level is the mean from a quarter of the way to the end of its side.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from compare.kymograph.kernel import average_beside
from experiment.arrays import Floats

__all__ = ["Profile", "profiles"]

STEPS = 32  # of tau on either side
COLUMNS = 60  # at most, of those that are averaged


class Profile(NamedTuple):
    """What lies on both sides of several lines."""

    flowing: Floats  # (line, species) [cm] R_a on the side of the flow
    calm: Floats  # (line, species) [cm] R_a on the side at rest
    duration: Floats  # (line,) [s] in which R goes from 3/4 to 1/4 of the difference


def profiles(
    time: Floats,
    thickness: Floats,
    path: Floats,
    before: Floats,
    after: Floats,
    rising: NDArray[np.bool_],
) -> Profile:
    """Profiles of lines from `thickness` (time, x, species), along each `path` (line, x) [s].

    `before` and `after` (line, x) [s] tell how far away other lines are, NaN where a line is not.
    Of lines that are `rising` (line,) the flow comes after.
    """
    columns = path.shape[1]
    chosen = np.arange(0, columns, -(-columns // COLUMNS))
    path, before, after = path[:, chosen], before[:, chosen], after[:, chosen]
    early, late = _reach(before), _reach(after)
    side = np.linspace(0.0, 1.0, STEPS + 1) ** 2  # finest next to the line
    tau = np.concatenate([-early[:, None] * side[:0:-1], late[:, None] * side], axis=1)
    mean = average_beside(time, thickness[:, chosen], path, before, after, tau)
    mean = np.where(rising[:, None, None], mean[:, ::-1], mean)
    tau = np.where(rising[:, None], -tau[:, ::-1], tau)
    flowing, calm = mean[:, : STEPS // 2].mean(axis=1), mean[:, -STEPS // 2 :].mean(axis=1)
    low, high = calm.sum(axis=1)[:, None], flowing.sum(axis=1)[:, None]
    jump = np.where(high > low, high - low, np.inf)
    share_left = (mean.sum(axis=2) - low) / jump
    leaves = [_last_above(tau, share_left, level) for level in (0.75, 0.25)]
    return Profile(flowing, calm, np.where(np.isfinite(jump[:, 0]), leaves[1] - leaves[0], np.nan))


def _reach(distance: Floats) -> Floats:
    """Half of the median `distance` (line, x) [s], of those known."""
    ordered = np.sort(np.where(np.isfinite(distance), distance, np.nan), axis=1)
    number = np.isfinite(ordered).sum(axis=1)
    line = np.arange(len(ordered))
    middles = [ordered[line, np.maximum(k, 0)] for k in ((number - 1) // 2, number // 2)]
    return np.where(number > 0, np.mean(middles, axis=0) / 2, 0.0)


def _last_above(tau: Floats, profile: Floats, level: float) -> Floats:
    """When a falling `profile` (line, tau) comes below `level`, next to where it is half-way."""
    half = profile.shape[1] - 1 - np.argmax(profile[:, ::-1] > 0.5, axis=1)
    index = np.arange(profile.shape[1])
    if level > 0.5:
        above = (profile > level) & (index <= half[:, None])
        left = profile.shape[1] - 1 - np.argmax(above[:, ::-1], axis=1)
    else:
        below = (profile < level) & (index > half[:, None])
        left = np.maximum(np.argmax(below, axis=1) - 1, 0)
    left = np.minimum(left, profile.shape[1] - 2)
    line = np.arange(len(profile))
    a, b = profile[line, left], profile[line, left + 1]
    share = np.clip((a - level) / np.where(a == b, 1.0, a - b), 0.0, 1.0)
    found: Floats = tau[line, left] + share * (tau[line, left + 1] - tau[line, left])
    return found
