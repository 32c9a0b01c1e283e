"""From centimetres to grains and back: what a set-up is on a lattice.

Columns are w wide, heights come in units u; a grain of species a is w wide and H_a u high.

    H_a = round(d_a / u)          s_ab = theta_ab w / u        one step = w / v
    grains of a per step = R_a^0 / (H_a u)                     columns = round(L / w)

By default u is the smallest diameter and w = 10 u. A lattice slope s is an integer, so s < s_ab is
s < ceil(s_ab): thresholds between the same integers act alike. By the rate rule grains may have
their true volumes between two plates, a gap g apart: H_a = round(d_a^3 / (w g u)), by default with
the smallest grain one unit high and w = 10 smallest diameters.
"""

from typing import Annotated, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, field_validator, model_validator

from ca_model.arrivals import ArrivalKind
from ca_model.kernel.log import MOST_RANKS
from ca_model.rates.kernel import COURANT
from experiment import Experiment, Mixture, NotApplicableError, SetupError
from experiment.arrays import Floats, Ints
from experiment.fields import SMALLEST, NonNegative, Part, Positive
from experiment.law import Law, law_of
from experiment.species import Values

__all__ = [
    "MANY",
    "Ground",
    "Lattice",
    "RateRule",
    "Rule",
    "RuleName",
    "Settings",
    "TopplingRule",
    "lattice_of",
]


RuleName = Literal["threshold", "rate", "toppling"]

ROUND_OFF = 1e-9
MANY = 2**62
MOST_COLUMNS = 10_000_000
HIGHEST = 2**40  # u
MOST_GRAINS = 1_000_000  # a step
MOST_SUBSTEPS = 100_000
VARIANTS = {
    "contacts": ("threshold", "rate"),
    "percolation": ("threshold",),
    "sharpness": ("rate",),
    "amplification": ("rate",),
    "gap": ("rate",),
    "threshold_spread": ("toppling",),
}


class Settings(Part):
    """The `[ca_model]` table of a set-up: the lattice and its rule.

    Grains roll past thresholds; are captured and set rolling at the continuum's rates; or topple
    one by one where a random number up to `threshold_spread` is added to thresholds. The variants
    of one rule do not apply to the others.
    """

    unit: Positive | None = None  #: cm; u, of heights; default: the smallest diameter
    column_width: Positive | None = None  #: cm; w; default: 10 u
    rule: RuleName = "threshold"  #: which automaton
    arrivals: ArrivalKind = "fixed"  #: what of the feed is left to chance
    #: how often a column may touch a flow in a step, from 1 up; by the rate rule, how many
    #: grains of a flow touch a column in a sub-step; not for the toppling rule
    contacts: int | Literal["all"] = "all"
    #: whether only the smallest species in a column touches the pile; threshold rule only
    percolation: bool = True
    #: k, how many times faster than by its law grains are captured; rate rule only
    sharpness: Annotated[float, Field(strict=True, ge=SMALLEST, le=1e12)] = 1.0
    #: cm between the plates that hold the pile, of which a grain takes d_a^3; default: grains are
    #: slabs, as wide as a column, d_a high, and as deep as the pile; rate rule only
    gap: Positive | None = None
    #: share of the law's amplification that there is; rate rule only
    amplification: Annotated[NonNegative, Field(le=1.0)] = 1.0
    #: largest random number that is added to a threshold; toppling rule only
    threshold_spread: Annotated[int, Field(strict=True, ge=0, le=1000)] = 0

    @field_validator("contacts", mode="before")
    @classmethod
    def _check_contacts(cls, given: object) -> object:
        if given == "all":
            return given
        if isinstance(given, int) and not isinstance(given, bool) and 1 <= given <= MANY:
            return given
        raise ValueError("it should be a whole number from 1 up, or 'all'")

    @property
    def most_contacts(self) -> int:
        """Contacts as a number."""
        return MANY if self.contacts == "all" else self.contacts

    @model_validator(mode="after")
    def _check_that_the_variant_applies(self) -> Self:
        for name, rules in VARIANTS.items():
            if name in self.model_fields_set and self.rule not in rules:
                allowed = " or ".join(map(repr, rules))
                value = getattr(self, name)
                raise ValueError(f"{name} = {value!r}: only where rule = {allowed} it applies")
        return self


class Rule(NamedTuple):
    """What decides on capture, in lattice units; species are numbered as in the mixture."""

    grain_height: Ints  #: (species,) H_a
    threshold: Ints  #: (species, surface_species): captured where s < threshold
    smallest_first: Ints  #: (species,) the species in the order in which they touch the pile
    contacts: int  #: how often a column may touch each flow in a step
    percolation: bool  #: whether only the smallest species present touches the pile


class TopplingRule(NamedTuple):
    """What decides on toppling, in lattice units; species are numbered as in the mixture."""

    grain_height: Ints  #: (species,) H_a
    threshold: Ints  #: (species, surface_species) s_ab
    spread: int  #: what is added to it is 0 ... spread, all alike


class RateRule(NamedTuple):
    """What decides on capture and amplification; species are numbered as in the mixture."""

    grain_height: Ints  #: (species,) H_a, u
    smallest_first: Ints  #: (species,) the species in the order in which they touch the pile
    law: Law  #: the continuum's
    rigid_fraction: Values  #: (species,) composition of the surface before pouring
    contacts: int  #: how many grains of a flow touch a column in a sub-step
    sharpness: float  #: k, how many times faster than by the law grains are captured
    amplification: float  #: share of the law's amplification that there is
    depth: int  #: d of the surface layer, u
    unit: float  #: u, cm
    width: float  #: w, cm
    step: float  #: w / v, s


class Ground(NamedTuple):
    """What is poured onto, in lattice units."""

    height: Ints  #: (column,) before pouring
    species: int  #: what the surface before pouring is made of
    lips: tuple[int, int] | None = None  #: heights of the open ends on the left and right; or walls
    sides: int = 1  #: 1: grains roll to the right only; 2: to the left as well


class Lattice(NamedTuple):
    """A set-up on the lattice, and what a lattice unit is in cm and s."""

    rule: Rule | RateRule | TopplingRule  #: what decides on capture, or on toppling
    ground: Ground  #: what is poured onto
    left: float  #: where the first column begins, cm
    grains_per_step: Floats  #: (species,) of the mean feed, to each side
    unit: float  #: u, cm
    column_width: float  #: w, cm
    step: float  #: w / v, s
    arrivals: ArrivalKind  #: what of the feed is left to chance

    @property
    def columns(self) -> int:
        """Number of columns."""
        return len(self.ground.height)

    @property
    def x(self) -> Floats:
        """Middles of the columns (column,) [cm]."""
        return self.left + (np.arange(self.columns) + 0.5) * self.column_width

    @property
    def grain_thickness(self) -> Floats:
        """Rolling thickness H_a u [cm] of one grain a column (species,)."""
        return self.rule.grain_height * self.unit

    @property
    def grain_volume(self) -> Floats:
        """Volume w H_a u per unit gap [cm2] of a grain (species,)."""
        return self.grain_thickness * self.column_width

    @property
    def row(self) -> int:
        """How many units a row of the archived deposit is high.

        A single one, but for grains that are small beside the surface layer: then half of that.
        """
        return max(1, self.rule.depth // 2) if isinstance(self.rule, RateRule) else 1

    @property
    def column_below_rest(self) -> int:
        """The column that begins below a source at rest, at x = 0."""
        return int(self.column_after(np.zeros(1))[0])

    def column_after(self, x: Floats) -> Ints:
        """The column that begins at the edge nearest to x [cm]; past the end, their number."""
        edge = np.rint((x - self.left) / self.column_width).astype(np.int64)
        return np.asarray(np.clip(edge, 0, self.columns))


def lattice_of(experiment: Experiment) -> Lattice:
    """The lattice of a set-up.

    Raises :class:`SetupError` for a wrong `[ca_model]` table and :class:`NotApplicableError` for
    what the rule does not know: drums, dispersion, species of different speeds, and a surface of
    mixed grains before pouring.
    """
    settings = Settings.parse(experiment.ca_model, "ca_model")
    mixture = experiment.mixture
    _check_that_the_rule_applies(experiment, settings.rule)
    unit, width, heights = _sizes(settings, np.array(mixture.grain_diameter))
    slopes = np.array(mixture.repose_slope) * width / unit
    corners = [0.0, *(x for x, _ in experiment.cell.start_surface or ())]
    base = experiment.cell.base_height(np.array(corners)) / unit
    highest = max(slopes.max(), heights.max(), base.max())
    if highest > HIGHEST:
        raise SetupError(
            f"ca_model.unit = {unit:g}: heights and thresholds come to {highest:.2g} of it; "
            f"at most {HIGHEST:.2g} are allowed"
        )
    threshold = np.ceil(slopes - ROUND_OFF).astype(np.int64)
    _check_the_feed(experiment.feed.largest_inflow, heights * unit)
    ground, left = _ground(experiment, unit, width)
    return Lattice(
        rule=_rate_rule(settings, experiment, heights, unit, width)
        if settings.rule == "rate"
        else _rule(settings, mixture, heights, threshold),
        ground=ground,
        left=left,
        grains_per_step=experiment.mean_inflow / (heights * unit),
        unit=unit,
        column_width=width,
        step=width / mixture.drift_velocity[0],
        arrivals=settings.arrivals,
    )


def _sizes(settings: Settings, diameter: Floats) -> tuple[float, float, Ints]:
    """U and w [cm], and H_a (species,)."""
    slab = settings.gap is None
    width = settings.column_width or 10 * (
        settings.unit if slab and settings.unit else diameter.min()
    )
    if settings.gap is not None and settings.gap < diameter.max():
        raise SetupError(
            f"ca_model.gap = {settings.gap:g}: it should be no less than the largest diameter"
        )
    thickness = diameter if settings.gap is None else diameter**3 / (width * settings.gap)
    unit = settings.unit or float(thickness.min())
    if unit > thickness.min():
        least = (
            "smallest diameter" if slab else f"height of the smallest grain, {thickness.min():.3g}"
        )
        raise SetupError(f"ca_model.unit = {unit:g}: it should not exceed the {least}")
    return unit, width, np.rint(thickness / unit).astype(np.int64)


def _rule(
    settings: Settings, mixture: Mixture, heights: Ints, threshold: Ints
) -> Rule | TopplingRule:
    if settings.rule == "toppling":
        return TopplingRule(heights, threshold, settings.threshold_spread)
    return Rule(
        grain_height=heights,
        threshold=threshold,
        smallest_first=_smallest_first(mixture),
        contacts=settings.most_contacts,
        percolation=settings.percolation,
    )


def _rate_rule(
    settings: Settings, experiment: Experiment, heights: Ints, unit: float, width: float
) -> RateRule:
    mixture, law = experiment.mixture, law_of(experiment.mixture)
    step = width / mixture.drift_velocity[0]
    touching = settings.most_contacts * (int(heights.max()) * unit)
    _check_the_substeps(law, np.minimum(experiment.feed.largest_inflow, touching), width, step)
    return RateRule(
        grain_height=heights,
        smallest_first=_smallest_first(mixture),
        law=law,
        rigid_fraction=experiment.start_composition,
        contacts=settings.most_contacts,
        sharpness=settings.sharpness,
        amplification=settings.amplification,
        depth=max(1, round(mixture.surface_depth / unit)),
        unit=unit,
        width=width,
        step=step,
    )


def _check_the_substeps(law: Law, thickness: Floats, width: float, step: float) -> None:
    """Refuse rates at which a flow as thick as the feed, or as touches, takes for ever."""
    rates = np.array(law.collision_rate)
    climb = float(rates.max(axis=1) @ thickness) * (1 + 2 * law.curvature_length / width)
    substeps = climb * step / (COURANT * width)
    if substeps > MOST_SUBSTEPS:
        raise SetupError(
            f"mixture.collision_rate = {rates.tolist()}: each step of {step:.2g} s needs "
            f"{substeps:.2g} sub-steps; at most {MOST_SUBSTEPS} are allowed "
            f"(ca_model.column_width = {width:g}, "
            f"mixture.curvature_length = {law.curvature_length:g})"
        )


def _smallest_first(mixture: Mixture) -> Ints:
    return np.argsort(mixture.grain_diameter, kind="stable").astype(np.int64)


def _ground(experiment: Experiment, unit: float, width: float) -> tuple[Ground, float]:
    """The surface before pouring, and where its first column begins [cm]."""
    cell = experiment.cell
    columns = round(cell.length / width)
    if not 3 <= columns <= MOST_COLUMNS:
        raise SetupError(
            f"ca_model.column_width = {width:g}: it should fit into cell.length = "
            f"{cell.length:g} from 3 to {MOST_COLUMNS} times"
        )
    sides = 2 if cell.shape == "heap" else 1
    whole = cell.model_copy(update={"length": columns * width})
    x = whole.left + (np.arange(sides * columns) + 0.5) * width
    ends = np.rint(whole.base_at_end / unit).astype(int)
    ground = Ground(
        height=np.rint(whole.base_height(x) / unit).astype(np.int64),
        species=int(np.argmax(experiment.start_composition)),
        lips=(int(ends[0]), int(ends[-1])) if cell.end == "open" else None,
        sides=sides,
    )
    return ground, whole.left


def _check_the_feed(largest: Floats, grain_thickness: Floats) -> None:
    most = (largest / grain_thickness).sum()
    if most > MOST_GRAINS:
        raise SetupError(
            f"feed.inflow = {largest.tolist()}: it makes {most:.2g} grains a step; "
            f"at most {MOST_GRAINS} are allowed"
        )


def _check_that_the_rule_applies(experiment: Experiment, rule: str) -> None:
    cell, mixture = experiment.cell, experiment.mixture
    speeds, start = list(mixture.drift_velocity), list(experiment.start_composition)
    limits = {
        f"cell.shape = {cell.shape!r}: the lattice pours silos and heaps": cell.shape != "drum",
        f"cell.shape = {cell.shape!r}: the toppling rule pours silos only": (
            cell.shape == "silo" or rule != "toppling"
        ),
        f"mixture.dispersion = {mixture.dispersion:g}: lattice grains roll without dispersion": (
            mixture.dispersion == 0
        ),
        f"mixture.drift_velocity = {speeds}: the lattice rolls all species at one speed": (
            min(speeds) == max(speeds)
        ),
        f"cell.start_composition = {start}: a lattice surface is of one species": (
            max(start) == 1 or rule == "rate"
        ),
        f"mixture.names: {mixture.species} species; the lattice knows at most {MOST_RANKS}": (
            mixture.species <= MOST_RANKS
        ),
    }
    for reason, applies in limits.items():
        if not applies:
            raise NotApplicableError(reason)
