"""Fronts and kinks: lines in the kymograph R(t, x) of the rolling grains.

At a place x the flow sets in when an avalanche front comes down and stops when a kink comes up.
`flow` finds these crossings in each column, `link` joins those of neighbouring columns to lines,
`fit` draws curves through them, `profile` averages R beside them, `sampling` says what the records
resolve, and `lines` puts it all into Datasets, from which `cycles` takes period and velocity.
"""

from compare.kymograph.cycles import cycle_period, mean_velocity, median_and_error
from compare.kymograph.lines import fronts, kinks, kinks_and_fronts

__all__ = [
    "cycle_period",
    "fronts",
    "kinks",
    "kinks_and_fronts",
    "mean_velocity",
    "median_and_error",
]
