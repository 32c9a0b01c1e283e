"""The kinds of numbers a set-up is made of, and how a wrong one is reported.

A set-up is a tree of frozen :class:`Part` objects. Whatever does not fit is refused with one line
that names the field, its value and what is allowed.
"""

import math
import re
from collections.abc import Mapping
from typing import Annotated, Any, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from experiment.errors import SetupError

__all__ = [
    "LARGEST",
    "SMALLEST",
    "STEEPEST",
    "Fraction",
    "Matrix",
    "NonNegative",
    "Number",
    "Part",
    "Positive",
    "RateMatrix",
    "Slope",
    "SlopeMatrix",
    "number_between",
]

STEEPEST = 100.0
SMALLEST, LARGEST = 1e-9, 1e9

Number = Annotated[float, Field(strict=True, ge=-LARGEST, le=LARGEST)]


def _not_vanishing(value: float) -> float:
    if value < SMALLEST:
        raise ValueError(f"it should be at least {SMALLEST:g}")
    return value


Positive = Annotated[float, Field(strict=True, gt=0, le=LARGEST), AfterValidator(_not_vanishing)]
NonNegative = Annotated[float, Field(strict=True, ge=0, le=LARGEST)]
Fraction = Annotated[float, Field(strict=True, ge=0, le=1)]
Slope = Annotated[float, Field(strict=True, ge=0, le=STEEPEST)]
SlopeMatrix = tuple[tuple[Slope, ...], ...]
RateMatrix = tuple[tuple[NonNegative, ...], ...]
Matrix = tuple[tuple[float, ...], ...]


def number_between(name: str, value: object, low: float, high: float) -> float:
    """`value`, where it is a number from `low` to `high`; else raises ValueError about `name`."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not low <= value <= high:
        raise ValueError(f"{name} = {value!r}: it should be a number from {low:g} to {high:g}")
    return value


class Part(BaseModel):
    """A frozen piece of a set-up; unknown fields and out-of-range values are refused."""

    model_config = ConfigDict(frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _refuse_unknown_fields(cls, given: Any) -> Any:
        if not isinstance(given, dict):
            return given
        known = cls.known_fields(given)
        unknown = [name for name in given if name not in known]
        if unknown:
            allowed = ", ".join(sorted(known))
            raise ValueError(f"no field {unknown[0]!r}; allowed: {allowed}")
        return given

    @classmethod
    def known_fields(cls, given: Mapping[str, Any]) -> set[str]:  # noqa: ARG003
        """Names that may be `given`; a part with shorthands adds them."""
        return set(cls.model_fields)

    @classmethod
    def parse(cls, given: object, within: str = "") -> Self:
        """Validate `given`; `within` is the path of this part inside a larger set-up.

        Raises :class:`SetupError` with one line about the first thing that is wrong.
        """
        try:
            return cls.model_validate(given)
        except ValidationError as error:
            raise SetupError(_first_complaint(error, within)) from None


def _first_complaint(error: ValidationError, within: str) -> str:
    complaint = error.errors(include_url=False)[0]
    path = within
    for step in complaint["loc"]:
        path += f"[{step}]" if isinstance(step, int) else f"{'.' if path else ''}{step}"
    reason = complaint["msg"].removeprefix("Value error, ").replace("Input should", "it should")
    reason = reason.replace("valid tuple", "list").replace("valid dictionary", "table")
    reason = reason.partition(" or instance of ")[0]
    if complaint["type"] == "missing":
        return f"{path}: missing; it has no default"
    if isinstance(complaint["input"], float) and math.isnan(complaint["input"]):
        reason = "it should be a number"
    if complaint["type"] == "too_short":
        reason = "it should not be empty"
    if complaint["type"] == "value_error" and not reason.startswith("it should"):
        names_a_field = re.match(r"\w+(\.\w+|\[\d+\])*( = |: missing)", reason)
        return f"{path}{'.' if names_a_field else ': '}{reason}" if path else reason
    return f"{path} = {complaint['input']!r}: {reason}"
