"""What a pour did, from two numbers that the deposit gives.

    layering     strength of what repeats along the vertical (:mod:`compare.deposit`)
    segregation  standard deviation over x of the column's mean coarseness, over its largest
                 possible value sqrt(f (1 - f)), f the coarseness of all: 1 where species lie apart

segregated where segregation >= SEGREGATED; else stratified where layering >= STRATIFIED; else
mixed.
A segregated pile may have weak stripes where its species meet: `layering` tells.
"""

import numpy as np
import xarray as xr

from compare.deposit import settled_profiles

__all__ = ["regime", "segregation"]

STRATIFIED = 0.25
SEGREGATED = 0.5


def segregation(archive: xr.Dataset) -> float:
    """How far the species lie apart along x in the settled part of the deposit, from 0 to 1."""
    profiles = settled_profiles(archive)
    means = np.array([profile.mean() for profile in profiles if len(profile)])
    if not len(means):
        return 0.0
    overall = means.mean()
    largest = np.sqrt(overall * (1.0 - overall))
    return float(means.std() / largest) if largest > 0 else 0.0


def regime(layering: float, segregated: float) -> str:
    """`stratified`, `segregated` or `mixed`, from `layering` and degree of segregation."""
    if segregated >= SEGREGATED:
        return "segregated"
    return "stratified" if layering >= STRATIFIED else "mixed"
