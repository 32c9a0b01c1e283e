"""One pour, described once for both models, and its TOML form.

    title = "..."
    [mixture]    grains and their law            [feed]  what is poured
    [cell]       what is filled                  [pour]  for how long, what is recorded
    [published]  numbers to compare with         [ca_model], [continuum]  each model's own table
    [uncertain]  what is not well known: "mixture.psi" = [lowest, highest]

The two models' tables are carried unread: each model validates its own.
"""

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
import tomli_w
from pydantic import Field, model_validator

from experiment.arrays import Floats
from experiment.cell import Cell
from experiment.errors import SetupError
from experiment.feed import Feed
from experiment.fields import Number, Part, Positive
from experiment.mixture import Mixture
from experiment.schedule import Table

__all__ = ["Experiment", "Pour", "Published", "parse_toml", "put", "set_values", "value_of"]


class Pour(Part):
    """How long the feed runs, how many records are kept, and the seed of what is random.

    Pours of one seed are piles of one ensemble: each `pile` has random numbers of its own.
    """

    duration: Positive  #: s; how long the feed runs
    #: intervals between records, which are one more
    records: Annotated[int, Field(strict=True, ge=1, le=1_000_000)] = 600
    seed: Annotated[int, Field(strict=True, ge=0, lt=2**63)] = 0  #: of what is random
    pile: Annotated[int, Field(strict=True, ge=0, lt=2**62)] = 0  #: which of the seed's ensemble


class Published(Part):
    """Values measured by others for this mixture, and a note on where and how."""

    wavelength: Positive | None = None  #: cm; of the layers, along the vertical
    kink_velocity: Positive | None = None  #: cm/s; of kinks, uphill
    note: str = ""  #: where and how they were measured


def _no_feed(part: dict[str, Any]) -> Feed:
    mixture: Mixture = part["mixture"]
    return Feed(inflow=(0.0,) * mixture.species)


class Experiment(Part):
    """A mixture, the cell it is poured into, its feed, and the two models' own tables."""

    title: str = Field(min_length=1)  #: what tables and pictures call it
    mixture: Mixture  #: the grains and the law of their flow
    cell: Cell  #: what is filled
    feed: Feed = Field(default_factory=_no_feed)  #: what is poured; only a drum does without
    pour: Pour  #: for how long, what is recorded
    published: Published | None = None  #: numbers to compare with
    #: lowest and highest value of a field that is not well known, by its path
    uncertain: dict[str, tuple[Number, Number]] = Field(default_factory=dict)
    ca_model: dict[str, Any] = Field(default_factory=dict)  #: the lattice model's own table
    continuum: dict[str, Any] = Field(default_factory=dict)  #: the continuum's own table

    @classmethod
    def from_toml(cls, text: str, settings: Sequence[str] = ()) -> Self:
        """The experiment that `text` describes, changed by `settings` (KEY=VALUE each).

        Raises :class:`SetupError` with one line where the text or a setting is wrong.
        """
        return cls.parse(set_values(parse_toml(text), settings))

    @classmethod
    def from_file(cls, path: Path, settings: Sequence[str] = ()) -> Self:
        """Read a set-up from a TOML file; see :meth:`from_toml`."""
        try:
            text = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            reason = getattr(error, "strerror", None) or "it is not text"
            raise SetupError(f"set-up {str(path)!r} cannot be read: {reason}") from None
        return cls.from_toml(text, settings)

    def to_toml(self) -> str:
        """The whole set-up, defaults included, so that it alone can be run again."""
        return tomli_w.dumps(self.model_dump(exclude_none=True))

    @model_validator(mode="after")
    def _check_species(self) -> Self:
        n = self.mixture.species
        schedule = self.feed.schedule
        name, inflow = "feed.inflow", self.feed.inflow
        if isinstance(schedule, Table):
            name, inflow = "feed.schedule.inflow[0]", schedule.inflow[0]
        if len(inflow) != n:
            raise ValueError(f"{name} = {list(inflow)}: it should have {n} values, one a species")
        start = self.cell.start_composition
        if start is not None and (len(start) != n or abs(sum(start) - 1) > 1e-9):
            raise ValueError(
                f"cell.start_composition = {list(start)}: "
                f"it should be {n} fractions, one a species, that add up to 1"
            )
        return self

    @model_validator(mode="after")
    def _check_feed(self) -> Self:
        drum = self.cell.shape == "drum"
        inflow = self.feed.largest_inflow
        if drum and inflow.any():
            raise ValueError(f"feed.inflow = {inflow.tolist()}: it should be 0 in a drum")
        if not drum and "feed" not in self.model_fields_set:
            raise ValueError("feed: missing; only a drum does without")
        if not drum and not inflow.any():
            raise ValueError(
                f"feed.inflow = {inflow.tolist()}: at least one should be greater than 0"
            )
        return self

    @model_validator(mode="after")
    def _check_source(self) -> Self:
        source, cell = self.feed.source, self.cell
        if source is None:
            return self
        if cell.shape != "heap":
            raise ValueError(f"feed.source: only over a heap it moves, not over a {cell.shape}")
        if max(map(abs, source.x)) > cell.length:
            raise ValueError(
                f"feed.source.x = {list(source.x)}: it should be from {cell.left:g} to "
                f"{cell.right:g}, above the cell"
            )
        return self

    @model_validator(mode="after")
    def _check_uncertain(self) -> Self:
        known = self.model_dump(exclude_none=True, exclude={"uncertain"}) if self.uncertain else {}
        for key, (low, high) in self.uncertain.items():
            given = f"uncertain {key} = [{low:g}, {high:g}]"
            if not low < high:
                raise ValueError(f"{given}: the first should be less than the second")
            for end in (low, high):
                try:
                    type(self).parse(put(known, key, end))
                except SetupError as error:
                    raise ValueError(f"{given}: {error}") from None
        return self

    def with_values(self, values: Mapping[str, object]) -> Self:
        """A set-up in which each KEY has the value given and nothing is uncertain any more.

        Keys are those of :func:`set_values`. Raises :class:`SetupError` as :meth:`from_toml`.
        """
        tables = self.model_dump(exclude_none=True, exclude={"uncertain"})
        for key, value in values.items():
            tables = put(tables, key, value)
        return type(self).parse(tables)

    @property
    def mean_inflow(self) -> Floats:
        """R_a (species,) [cm], averaged over the pour."""
        mean: Floats = self.feed.mean_thickness(np.array([0.0, self.pour.duration]))[0]
        return mean

    @property
    def mean_growth(self) -> float:
        """Thickness [cm] of all that is poured, if it lay evenly on each slope."""
        flux = float(self.mean_inflow @ np.array(self.mixture.drift_velocity))
        return flux * self.pour.duration / self.cell.length

    @property
    def start_composition(self) -> tuple[float, ...]:
        """Composition of the grains before pouring, unless it is given.

        The rigid surface of a silo or heap is all of the smallest species; the grains in a drum
        are equal parts of all.
        """
        if self.cell.start_composition is not None:
            return self.cell.start_composition
        n = self.mixture.species
        if self.cell.shape == "drum":
            return (1 / n,) * n
        return tuple(float(a == self.mixture.smallest) for a in range(n))


def parse_toml(text: str) -> dict[str, Any]:
    """The tables of a TOML text. Raises :class:`SetupError` where it is no TOML."""
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise SetupError(f"set-up is not TOML: {error}") from None


def set_values(tables: Mapping[str, Any], settings: Sequence[str]) -> dict[str, Any]:
    """A copy of `tables` with each KEY=VALUE of `settings` put in its place.

    KEY is a path such as `mixture.delta` or `mixture.grain_diameter.1`; VALUE is TOML, and what is
    not is taken as a string. Raises :class:`SetupError` where a path leads nowhere.
    """
    changed = dict(tables)
    for setting in settings:
        key, equals, text = setting.partition("=")
        if not equals or not all(key.strip().split(".")):
            raise SetupError(f"--set {setting!r}: it should be KEY=VALUE, as in mixture.delta=0.1")
        changed = put(changed, key.strip(), value_of(text))
    return changed


def put(tables: Mapping[str, Any], key: str, value: object) -> dict[str, Any]:
    """A copy of `tables` with `value` at the path `key`; see :func:`set_values`."""
    changed: dict[str, Any] = _as_lists(tables)
    *path, last = key.split(".")
    place: Any = changed
    for step in path:
        place = place.setdefault(step, {}) if isinstance(place, dict) else _item(place, step, key)
    if isinstance(place, dict):
        place[last] = value
    else:
        _item(place, last, key)
        place[int(last)] = value
    return changed


def _as_lists(tables: Any) -> Any:
    """A copy all the way down in which tuples are lists, as in TOML."""
    if isinstance(tables, Mapping):
        return {name: _as_lists(value) for name, value in tables.items()}
    if isinstance(tables, (list, tuple)):
        return [_as_lists(value) for value in tables]
    return tables


def _item(place: Any, step: str, key: str) -> Any:
    numbers = step.isascii() and step.isdecimal()
    if not isinstance(place, list) or not numbers or int(step) >= len(place):
        raise SetupError(f"{key}: there is no {step!r} to set")
    return place[int(step)]


def value_of(text: str) -> Any:
    """The value that a TOML text says; what is not TOML is a word."""
    try:
        parsed = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        return text.strip()
    return parsed["value"] if len(parsed) == 1 else text.strip()
