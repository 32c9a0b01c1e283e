"""Fronts and kinks: lines in the kymograph R(t, x) of the rolling grains.

At a place x the flow sets in when an avalanche front comes down and stops when a kink comes up.
`flow` finds these crossings in each column, `link` joins those of neighbouring columns to lines,
`fit` draws curves through them, `profile` averages R beside them, `sampling` says what the records
resolve, and `lines` puts it all together, from which `cycles` takes period and velocity, and `told`
makes Datasets.
"""

from compare.kymograph.cycles import cycle_period, mean_velocity, median_and_error
from compare.kymograph.lines import follow, fronts, kinks, kinks_and_fronts
from compare.kymograph.told import Told

__all__ = [
    "Told",
    "cycle_period",
    "follow",
    "fronts",
    "kinks",
    "kinks_and_fronts",
    "mean_velocity",
    "median_and_error",
]
