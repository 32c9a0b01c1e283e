"""How irregular pours are: single layers and single kinks, in many piles.

Layers scatter in place (`wavelength_spread` of :func:`compare.measure`), kinks by what their
velocities scatter beyond their errors; both are told over the mean.
"""

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass

import numpy as np
import xarray as xr

from compare.accessor import Strata
from compare.campaign import POUR, Outcome, Table, scheduler_of
from compare.deposit.picture import averaged
from compare.deposit.profiles import let_down
from compare.kymograph.cycles import Seen
from compare.measurement import numbers_of
from compare.quantities import cell_height, coarseness, quantity
from experiment import Experiment
from experiment.arrays import Floats
from experiment.pouring import Progress

__all__ = ["SHAPE", "Irregular", "kink_scatter", "pour_irregular"]

SHAPE = 240, 110  # rows and columns of a picture
MAD = 1.4826  # standard deviation over the median deviation


@dataclass(frozen=True)
class Irregular:
    """A pour of which single layers and kinks are told; a job of a campaign."""

    model: str
    experiment: Experiment
    picture: bool = False

    def __call__(self) -> Outcome:
        """Pour and measure."""
        archive = POUR[self.model](self.experiment)
        strata: Strata = archive.strata
        numbers, _ = numbers_of(archive)
        spread, wavelength = (numbers[name][1] for name in ("wavelength_spread", "wavelength"))
        deposit = _let_down(archive) if self.picture else np.full((1, 1), np.nan)
        found = numbers | {
            "layer_scatter": quantity(spread / wavelength, "1", "scatter of layers over the mean"),
            "kink_scatter": quantity(
                kink_scatter(strata.lines[0].seen), "1", "scatter of kink velocities over the mean"
            ),
            "picture_height": quantity(
                len(deposit) * cell_height(archive), "cm", "height of the picture"
            ),
        }
        return Outcome(
            {name: v if isinstance(v, str) else float(v) for name, (_, v, _) in found.items()},
            {name: attributes for name, (_, _, attributes) in found.items()},
            picture=averaged(deposit, SHAPE).astype(np.float32) if self.picture else None,
        )


def kink_scatter(kinks: Seen) -> float:
    """Standard deviation of velocities, less that of their errors, over the median velocity.

    Both by medians, for a line that is broken may seem to go at any speed; NaN for fewer than two.
    """
    told = np.isfinite(kinks.velocity)
    if told.sum() < 2:
        return np.nan
    velocity = kinks.velocity[told]
    middle = float(np.median(velocity))
    scatter = MAD * float(np.median(np.abs(velocity - middle)))
    own = float(np.median(kinks.velocity_error[told]))
    return float(np.sqrt(max(scatter**2 - own**2, 0.0))) / abs(middle)


def _let_down(archive: xr.Dataset) -> Floats:
    deposit = coarseness(archive["deposit_fraction"], archive).transpose("z", "x")
    return let_down(deposit.values.astype(np.float64)).coarse


def pour_irregular(
    jobs: Sequence[Sequence[Irregular]], workers: int | None, progress: Progress
) -> xr.Dataset:
    """What comes of `jobs`, piles of each set-up, over `setup` and `pile`; NaN where there is none.

    And picture(setup, row, column), of the pile of which one is taken.
    """
    places = [(setup, pile) for setup, piles in enumerate(jobs) for pile in range(len(piles))]
    every = [jobs[setup][pile] for setup, pile in places]
    told = Table(len(every))
    pictures = np.full((len(jobs), *SHAPE), np.nan, dtype=np.float32)
    with closing(scheduler_of(workers, None, len(every))(every)) as outcomes:
        for number, outcome in outcomes:
            told.put(number, outcome)
            if outcome.picture is not None:
                pictures[places[number][0]] = outcome.picture
            progress(told.told / len(every))
    variables = told.variables({"job": len(every)})
    setup, pile = np.transpose(places)
    found = xr.Dataset(variables, {"setup": ("job", setup), "pile": ("job", pile)})
    by_pile = found.set_index(job=["setup", "pile"]).unstack(
        "job", fill_value={"regime": "", "failure": ""}
    )
    return by_pile.assign(picture=(("setup", "row", "column"), pictures))
