"""What varies in a phase diagram: fields of a set-up, along axes that cross each other.

    mixture.delta=-0.3:0.5:64       64 values from -0.3 to 0.5, evenly spaced
    feed.total_inflow=0.1:3:16:log  16 values, each the same multiple of the one before
    ca_model.contacts=1,2,all       these values
    mixture.psi=0.02:0.5            drawn: a Latin hypercube, together with all that is drawn

Each field of the first three kinds has an axis of its own; those that are drawn share one, `draw`.
"""

import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from compare.ensemble import latin_hypercube, ranges
from experiment import SetupError
from experiment.experiment import value_of

__all__ = ["DRAW", "Axis", "axes_of", "varied"]

DRAW = "draw"
LOGARITHMIC = "log"
MOST = 100_000  # values of an axis
ROUND_OFF = 1e-12
TAKEN = ("wavelength", "kink_velocity", "model", "regime", "failure", DRAW)  # names of a diagram
HOW = (
    "it should be KEY=LOW:HIGH:COUNT, KEY=LOW:HIGH:COUNT:log, KEY=VALUE,VALUE,... "
    "or, to be drawn, KEY=LOW:HIGH"
)

UNITS = {  # by the word of a key that tells; all else is of unit 1 or a word
    "collision_rate": "s-1",
    "column_width": "cm",
    "cross_amplification": "s-1",
    "cross_rate": "s-1",
    "curvature_length": "cm",
    "dispersion": "cm2 s-1",
    "drift_velocity": "cm s-1",
    "duration": "s",
    "grain_diameter": "cm",
    "inflow": "cm",
    "length": "cm",
    "surface_depth": "cm",
    "total_inflow": "cm",
    "turning_rate": "s-1",
    "unit": "cm",
}

Listed = dict[str, Sequence[Any]]
Drawn = dict[str, tuple[float, float]]
Coordinates = dict[str, tuple[str, NDArray[Any], dict[str, str]]]


class Axis(NamedTuple):
    """A dimension of a diagram: the values of one field, or of several that vary together."""

    dim: str
    fields: Mapping[str, Sequence[Any]]  # by key; each of the same length
    names: Mapping[str, str]  # of the fields, in the diagram

    @property
    def size(self) -> int:
        """How many places there are along it."""
        return len(next(iter(self.fields.values())))

    def at(self, place: int) -> dict[str, Any]:
        """The values of the fields at a place along it."""
        return {key: values[place] for key, values in self.fields.items()}

    @property
    def units(self) -> dict[str, str]:
        """Those of each field that is of numbers."""
        words = {key: [word for word in key.split(".") if word in UNITS] for key in self.fields}
        return {key: UNITS[told[0]] if told else "1" for key, told in words.items()}

    @property
    def coordinates(self) -> Coordinates:
        """The values of each field along the axis; those that are no numbers are put in words."""
        found: Coordinates = {}
        for key, values in self.fields.items():
            said = {"long_name": key, "field": key}
            if all(type(value) in {int, float} for value in values):
                said["units"] = self.units[key]
                found[self.names[key]] = self.dim, np.array(values), said
            else:
                words = np.array([json.dumps(value, default=str) for value in values])
                found[f"{self.names[key]}_name"] = self.dim, words, said
        return found


def axes_of(
    listed: Mapping[str, Iterable[Any]],
    drawn: Mapping[str, tuple[float, float]] | None = None,
    draws: int = 0,
    seed: int = 0,
) -> tuple[Axis, ...]:
    """An axis for each field that is `listed` with its values, and one for all that are `drawn`.

    Of N `draws`, from the ranges of the latter, one lies in each N-th of every range. Raises
    :class:`SetupError` where nothing varies, or draws and ranges do not go together.
    """
    drawn = drawn or {}
    if drawn and draws < 1:
        raise SetupError(f"draws = {draws}: it should be at least 1 to draw {next(iter(drawn))}")
    if draws and not drawn:
        raise SetupError(f"draws = {draws}: there is no KEY=LOW:HIGH to draw from")
    twice = [key for key in listed if key in drawn]
    if twice:
        raise SetupError(f"{twice[0]}: it varies twice, listed and drawn")
    if not (listed or drawn):
        raise SetupError("vary: missing; at least one field should vary")
    names = _names([*listed, *drawn])
    axes = [
        Axis(names[key], {key: [_plain(value) for value in values]}, names)
        for key, values in listed.items()
    ]
    if drawn:
        columns = latin_hypercube(drawn, draws, seed).T.tolist()
        axes.append(Axis(DRAW, dict(zip(drawn, columns, strict=True)), names))
    for axis in axes:
        if not 1 <= axis.size <= MOST:
            raise SetupError(f"{axis.dim}: {axis.size} values; allowed: 1 to {MOST}")
    return tuple(axes)


def varied(texts: Iterable[str]) -> tuple[Listed, Drawn]:
    """The fields that texts such as those above list with their values, and those to be drawn.

    Raises :class:`SetupError` for a text that says neither, and where a field is named twice.
    """
    listed: Listed = {}
    drawn: Drawn = {}
    for text in texts:
        key, equals, told = (part.strip() for part in text.partition("="))
        if not equals or not told or not all(key.split(".")):
            raise SetupError(f"--vary {text!r}: {HOW}")
        if key in listed or key in drawn:
            raise SetupError(f"--vary {text!r}: {key} varies already")
        if told.count(":") == 1:
            drawn |= ranges([text])
        else:
            listed[key] = _spaced(text, told.split(":")) if ":" in told else _values(told)
    return listed, drawn


def _plain(value: Any) -> Any:
    """A value as TOML has it, of one of numpy's types."""
    return value.tolist() if isinstance(value, (np.generic, np.ndarray)) else value


def _spaced(text: str, told: Sequence[str]) -> Sequence[float]:
    """The values of LOW:HIGH:COUNT, evenly spaced, or their logarithms."""
    *numbers, spacing = told if told[-1] == LOGARITHMIC else [*told, ""]
    try:
        low, high, count = float(numbers[0]), float(numbers[1]), int(numbers[2])
    except (ValueError, IndexError):
        raise SetupError(f"--vary {text!r}: {HOW}") from None
    if len(numbers) > 3 or not 2 <= count <= MOST or not -np.inf < low < high < np.inf:
        raise SetupError(f"--vary {text!r}: LOW should be less than HIGH, COUNT from 2 to {MOST}")
    if spacing and low <= 0:
        raise SetupError(f"--vary {text!r}: LOW should be greater than 0 on a logarithmic axis")
    values = (np.geomspace if spacing else np.linspace)(low, high, count)
    values[np.abs(values) < ROUND_OFF * (high - low)] = 0.0
    return [float(f"{value:.12g}") for value in values]


def _values(told: str) -> Sequence[Any]:
    """The values of VALUE,VALUE,...: TOML, and what is not is taken as a word."""
    together = value_of(f"[{told}]")
    return together if isinstance(together, list) else [value_of(one) for one in told.split(",")]


def _names(keys: Sequence[str]) -> dict[str, str]:
    """A name for each field: the end of its key, or all of it where another has that name."""
    ends = {key: _end(key) for key in keys}
    number = Counter([*ends.values(), *TAKEN])
    return {key: end if number[end] == 1 else key.replace(".", "_") for key, end in ends.items()}


def _end(key: str) -> str:
    """The end of a key that is a word; `grain_diameter_1` for mixture.grain_diameter.1."""
    steps = key.split(".")
    last_word = max((k for k, step in enumerate(steps) if not step.isdecimal()), default=0)
    return "_".join(steps[last_word:])
