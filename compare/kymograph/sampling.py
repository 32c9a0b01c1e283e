"""What the records of an archive can tell of lines, and what they cannot."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from compare.kymograph.cycles import intervals, median
from experiment.arrays import Floats

__all__ = ["Sampling", "hidden_growth"]

FEW = 8.0  # records a cycle, below which lines may be missed
RESOLVED = 2.0  # records that a line lasts, so that its velocity can be told
HIDDEN = 0.25  # share of the growth at rest that tells of cycles between records
NOISY = 0.25  # of R0, noise above which it is remarked
ROUGH = 0.02  # relative error of a velocity, above which it is remarked


class Sampling(NamedTuple):
    """How R was recorded, and how it was averaged."""

    interval: float  # s between records
    drift: float  # cm/s of the grains
    length: float  # cm of the slope
    width: float  # cm of a column
    smoothed: int  # columns over which R is averaged
    noise: float  # standard deviation of what is left, over R0
    hidden: float  # share of the growth of the pile that no record shows, hidden_growth

    @property
    def sparse(self) -> bool:
        """Whether a cycle might be so short that two records do not tell its flow from its rest.

        All that is known before is that it lasts longer than the grains' way down the slope, L / v.
        """
        return 2.0 * self.interval > self.length / self.drift

    @property
    def aliased(self) -> bool:
        """Whether whole cycles pass between two records and show as a slower one.

        Where records are sparse, the pile tells, which grows only where grains roll.
        """
        return self.sparse and self.hidden > HIDDEN

    @property
    def least(self) -> float:
        """Standard error [s] of a passage, if only records and columns limit it.

        A time may fall anywhere between two records, of which interpolation leaves a quarter, and
        a line anywhere in a column.
        """
        return float(np.hypot(self.interval / 4, self.width / self.drift) / np.sqrt(12.0))

    def resolve(self, passage: Floats) -> NDArray[np.bool_]:
        """Whether lines (line, x) [s] last long enough for a velocity."""
        early = np.where(np.isfinite(passage), passage, np.inf).min(axis=1, initial=np.inf)
        late = np.where(np.isfinite(passage), passage, -np.inf).max(axis=1, initial=-np.inf)
        lasting: NDArray[np.bool_] = late - early > RESOLVED * self.interval
        return np.zeros_like(lasting) if self.aliased else lasting

    def blur(self, speed: Floats, scatter: Floats) -> Floats:
        """Width [cm] that a sharp jump would seem to have in a line of this speed and scatter [s].

        Half a record of interpolation between its two sides, and half of a normal distribution,
        which lies within 1.35 standard deviations.
        """
        blurred: Floats = speed * np.hypot(0.5 * self.interval, 1.35 * scatter)
        return blurred

    def attributes(self, passage: Floats, velocity: Floats, error: Floats) -> dict[str, Any]:
        """Attributes of a Dataset of lines with `passage` (line, x) in the measured columns."""
        per_cycle = median(*intervals(passage)) / self.interval
        remarks = []
        if self.aliased:
            remarks.append(
                f"the pile grows where no record shows a flow: with records every "
                f"{self.interval:.3g} s cycles seem slower than they are, so neither "
                f"velocities nor periods are told"
            )
        elif self.sparse or per_cycle < FEW:
            remarks.append(
                f"records every {self.interval:.3g} s are few in a cycle, which may be as short as "
                f"{self.length / self.drift:.3g} s: lines may be missed"
            )
        if self.noise > NOISY:
            remarks.append(f"averaged over x, R / R0 still has a noise of {self.noise:.2g}")
        unresolved = int((~np.isfinite(velocity)).sum())
        if unresolved and not self.aliased:
            remarks.append(
                f"{unresolved} of {len(velocity)} lines last {RESOLVED:g} records or less in the "
                f"measured columns, or are not seen there: their velocities are not told"
            )
        rough = error > ROUGH * np.abs(velocity)
        if rough.sum() > len(rough) / 2:
            remarks.append(f"most velocities are uncertain by more than {ROUGH:.0%}")
        told = {
            "sampling_s": self.least,
            "records_per_cycle": per_cycle,
            "shortest_period_s": 2.0 * self.interval,
            "columns_averaged": self.smoothed,
            "noise": self.noise,
            "aliased": int(self.aliased),
        }
        return told | ({"comment": "; ".join(remarks)} if remarks else {})


def hidden_growth(height: Floats, rolling: NDArray[np.bool_]) -> float:
    """Share of the growth of `height` (time, x) while `rolling` (time, x) shows rest."""
    growth = np.maximum(np.diff(height, axis=0), 0.0)
    total = float(growth.sum())
    return float(growth[~(rolling[1:] | rolling[:-1])].sum()) / total if total > 0 else 0.0
