"""What a pour did, from two numbers that the deposit gives.

    layering     strength of what repeats along the vertical (:mod:`compare.deposit`)
    segregation  standard deviation over x of the column's mean coarseness, over its largest
                 possible value sqrt(f (1 - f)), f the coarseness of all: 1 where species lie apart

unsettled where less than THINNEST R0 was laid after the transient, some two cycles: too little to
tell; else segregated where segregation >= SEGREGATED; else stratified where layering >= STRATIFIED;
else mixed.
A segregated pile may have weak stripes where its species meet: `layering` tells.
"""

import numpy as np
import xarray as xr

from compare.deposit import settled_profiles

__all__ = ["regime", "segregation"]

STRATIFIED = 0.25
SEGREGATED = 0.5
THINNEST = 5.0  # R0


def segregation(archive: xr.Dataset) -> float:
    """How far the species lie apart along x in the settled part of the deposit, from 0 to 1."""
    profiles = settled_profiles(archive)
    means = np.array([profile.mean() for profile in profiles if len(profile)])
    if not len(means):
        return 0.0
    overall = means.mean()
    largest = np.sqrt(overall * (1.0 - overall))
    return float(means.std() / largest) if largest > 0 else 0.0


def regime(layering: float, segregated: float, thickness: float) -> str:
    """`stratified`, `segregated`, `mixed` or `unsettled`.

    From `layering`, degree of segregation, and the thickness of the settled deposit over R0.
    """
    if thickness < THINNEST:
        return "unsettled"
    if segregated >= SEGREGATED:
        return "segregated"
    return "stratified" if layering >= STRATIFIED else "mixed"
