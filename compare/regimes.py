"""What a pour did, in a word, from what its deposit gives.

    layered_share  share of the slope where there are layers (:mod:`compare.deposit.zones`)
    segregation    standard deviation over x of the column's mean coarseness, over its largest
                   possible value sqrt(f (1 - f)), f the coarseness of all: 1 for species apart

                                   segregation < SEGREGATED   >= SEGREGATED
    layered_share >= LAYERED_SHARE     stratified             layered-and-segregated
                  <                    mixed                  segregated

unsettled where less than THINNEST R0 was laid after the transient, some two cycles: too little to
tell. The two thresholds were read off pours that had been labelled by eye (tests/labelled).
"""

import numpy as np
import xarray as xr

from compare.deposit import settled_profiles

__all__ = ["LAYERED_REGIMES", "regime", "segregation"]

LAYERED_SHARE = 0.2
SEGREGATED = 0.5
THINNEST = 5.0  # R0
LAYERED_REGIMES = ("stratified", "layered-and-segregated")


def segregation(archive: xr.Dataset) -> float:
    """How far the species lie apart along x in the settled part of the deposit, from 0 to 1."""
    profiles = settled_profiles(archive)
    means = np.array([profile.mean() for profile in profiles if len(profile)])
    if not len(means):
        return 0.0
    overall = means.mean()
    largest = np.sqrt(overall * (1.0 - overall))
    return float(means.std() / largest) if largest > 0 else 0.0


def regime(layered_share: float, segregated: float, thickness: float) -> str:
    """`stratified`, `segregated`, `layered-and-segregated`, `mixed` or `unsettled`.

    `segregated` is the degree of segregation, `thickness` that of the settled deposit over R0.
    """
    if thickness < THINNEST:
        return "unsettled"
    apart = segregated >= SEGREGATED
    if layered_share >= LAYERED_SHARE:
        return "layered-and-segregated" if apart else "stratified"
    return "segregated" if apart else "mixed"
