"""From centimetres to grains and back: what a set-up is on a lattice.

Columns are w wide, heights come in units u; a grain of species a is w wide and H_a u high.

    H_a = round(d_a / u)          s_ab = theta_ab w / u        one step = w / v
    grains of a per step = R_a^0 / (H_a u)                     columns = round(L / w)

By default u is the smallest diameter and w = 10 u. A lattice slope s is an integer, so s < s_ab is
s < ceil(s_ab): thresholds between the same integers act alike.
"""

from typing import Literal, NamedTuple

import numpy as np
from pydantic import field_validator

from ca_model.arrivals import ArrivalKind
from experiment import Experiment, NotApplicableError, SetupError
from experiment.arrays import Floats, Ints
from experiment.fields import Part, Positive

__all__ = ["Lattice", "Rule", "Settings", "lattice_of"]


ROUND_OFF = 1e-9
MANY = 2**62
MOST_COLUMNS = 10_000_000
MOST_GRAINS = 1_000_000  # a step


class Settings(Part):
    """The `[ca_model]` table of a set-up: the lattice and the variant of its rule."""

    unit: Positive | None = None  # u, cm; default: the smallest diameter
    column_width: Positive | None = None  # w, cm; default: 10 u
    contacts: int | Literal["all"] = "all"
    percolation: bool = True
    arrivals: ArrivalKind = "fixed"

    @field_validator("contacts", mode="before")
    @classmethod
    def _check_contacts(cls, given: object) -> object:
        if given == "all":
            return given
        if isinstance(given, int) and not isinstance(given, bool) and 1 <= given <= MANY:
            return given
        raise ValueError("it should be a whole number from 1 up, or 'all'")


class Rule(NamedTuple):
    """What decides on capture, in lattice units; species are numbered as in the mixture."""

    grain_height: Ints  # (species,) H_a
    threshold: Ints  # (species, surface_species): captured where s < threshold
    smallest_first: Ints  # (species,) the species in the order in which they touch the pile
    contacts: int  # how often a column may touch the flow in a step
    percolation: bool  # whether only the smallest species present touches the pile


class Lattice(NamedTuple):
    """A set-up on the lattice, and what a lattice unit is in cm and s."""

    rule: Rule
    base: Ints  # (column,) heights before pouring, in u
    base_species: int  # the species that the surface before pouring is made of
    grains_per_step: Floats  # (species,) of the mean feed
    unit: float  # u, cm
    column_width: float  # w, cm
    step: float  # w / v, s
    arrivals: ArrivalKind

    @property
    def x(self) -> Floats:
        """Middles of the columns (column,) [cm]."""
        return (np.arange(len(self.base)) + 0.5) * self.column_width

    @property
    def grain_thickness(self) -> Floats:
        """Rolling thickness H_a u [cm] of one grain a column (species,)."""
        return self.rule.grain_height * self.unit

    @property
    def grain_volume(self) -> Floats:
        """Volume w H_a u per unit gap [cm2] of a grain (species,)."""
        return self.grain_thickness * self.column_width


def lattice_of(experiment: Experiment) -> Lattice:
    """The lattice of a set-up.

    Raises :class:`SetupError` for a wrong `[ca_model]` table and :class:`NotApplicableError` for
    what the rule does not know: other cells than a silo with a wall, dispersion, species of
    different speeds, and a surface of mixed grains before pouring.
    """
    settings = Settings.parse(experiment.ca_model, "ca_model")
    mixture = experiment.mixture
    _check_that_the_rule_applies(experiment)
    unit = settings.unit or min(mixture.grain_diameter)
    width = settings.column_width or 10 * unit
    if unit > min(mixture.grain_diameter):
        raise SetupError(f"ca_model.unit = {unit:g}: it should not exceed the smallest diameter")
    columns = round(experiment.cell.length / width)
    if not 3 <= columns <= MOST_COLUMNS:
        raise SetupError(
            f"ca_model.column_width = {width:g}: it should fit into cell.length = "
            f"{experiment.cell.length:g} from 3 to {MOST_COLUMNS} times"
        )
    heights = np.rint(np.array(mixture.grain_diameter) / unit).astype(np.int64)
    slopes = np.array(mixture.repose_slope) * width / unit
    rule = Rule(
        grain_height=heights,
        threshold=np.ceil(slopes - ROUND_OFF).astype(np.int64),
        smallest_first=np.argsort(mixture.grain_diameter, kind="stable").astype(np.int64),
        contacts=MANY if settings.contacts == "all" else settings.contacts,
        percolation=settings.percolation,
    )
    largest = experiment.feed.largest_inflow
    most = (largest / (heights * unit)).sum()
    if most > MOST_GRAINS:
        raise SetupError(
            f"feed.inflow = {largest.tolist()}: it makes {most:.2g} grains a step; "
            f"at most {MOST_GRAINS} are allowed"
        )
    cell = experiment.cell.model_copy(update={"length": columns * width})
    x = (np.arange(columns) + 0.5) * width
    return Lattice(
        rule=rule,
        base=np.rint(cell.base_height(x) / unit).astype(np.int64),
        base_species=int(np.argmax(experiment.start_composition)),
        grains_per_step=experiment.mean_inflow / (heights * unit),
        unit=unit,
        column_width=width,
        step=width / mixture.drift_velocity[0],
        arrivals=settings.arrivals,
    )


def _check_that_the_rule_applies(experiment: Experiment) -> None:
    cell, mixture = experiment.cell, experiment.mixture
    speeds, start = list(mixture.drift_velocity), list(experiment.start_composition)
    limits = {
        f"cell.shape = {cell.shape!r}: the lattice pours silos only": cell.shape == "silo",
        f"cell.end = {cell.end!r}: the lattice has a wall at its end": cell.end == "wall",
        f"mixture.dispersion = {mixture.dispersion:g}: lattice grains roll without dispersion": (
            mixture.dispersion == 0
        ),
        f"mixture.drift_velocity = {speeds}: the lattice rolls all species at one speed": (
            min(speeds) == max(speeds)
        ),
        f"cell.start_composition = {start}: a lattice surface is of one species": max(start) == 1,
    }
    for reason, applies in limits.items():
        if not applies:
            raise NotApplicableError(reason)
