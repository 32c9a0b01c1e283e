"""What a pour did, in a word, from what its deposit gives.

    layered_share  share of the slope where there are layers (:mod:`compare.deposit.zones`)
    segregation    how far the species lie apart along the slope (the same)

                                   segregation < SEGREGATED   >= SEGREGATED
    layered_share >= LAYERED_SHARE     stratified             layered-and-segregated
                  <                    mixed                  segregated

unsettled where less than THINNEST R0 was laid after the transient, some two cycles: too little to
tell. The two thresholds were read off pours that had been labelled by eye (tests/labelled).
"""

from compare.deposit.zones import LAYERED_SHARE

__all__ = ["LAYERED_REGIMES", "regime"]

SEGREGATED = 0.5
THINNEST = 5.0  # R0
LAYERED_REGIMES = ("stratified", "layered-and-segregated")


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
