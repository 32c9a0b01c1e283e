"""Repose slopes in fewer numbers than their matrix has, so that each can be varied alone.

A matrix theta_ab reads [rolling species, surface species]. Of N species, `theta_11` to `theta_NN`
are the pure slopes, and `psi` is the step in slope from one species to the next:

    theta_ab = theta_bb + psi (b - a)

For two species the paper's parameters are

    psi   = theta_11 - theta_21            m1 = theta_12 - theta_11
    delta = theta_22 - theta_11            m2 = theta_22 - theta_21 = delta + psi

so (theta_11, psi, delta, m1) says the same as the matrix; the paper's m is m1 = m2, which is the
rule above. Beside a matrix, they change it:

    two species     theta_11, psi, delta and m1 - m2 stay but for what is given; theta_22 says
                    delta in another way, and so moves column 2 alone; m1 moves theta_12 alone
    three or more   theta_bb moves column b, what rolls on b, as a whole; psi makes all slopes but
                    the pure ones anew by the rule above
"""

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import TypeAdapter, ValidationError

from experiment.fields import STEEPEST, Matrix, SlopeMatrix, number_between

__all__ = ["resolve_slopes", "slope_names", "stepped_slopes", "two_species_slopes"]

STANDS_FOR_SLOPES = re.compile(r"theta_(\d+)\1|psi|delta|m1")
SLOPES: TypeAdapter[Matrix] = TypeAdapter(SlopeMatrix)


def two_species_slopes(
    theta_11: float, psi: float, delta: float, m1: float | None = None
) -> Matrix:
    """Repose slopes from the paper's parameters; m1 = m2 = delta + psi by default."""
    m1 = delta + psi if m1 is None else m1
    return (theta_11, theta_11 + m1), (theta_11 - psi, theta_11 + delta)


def stepped_slopes(pure: Sequence[float], psi: float) -> Matrix:
    """Repose slopes theta_bb + psi (b - a) from the N `pure` slopes."""
    n = len(pure)
    return tuple(tuple(pure[b] + psi * (b - a) for b in range(n)) for a in range(n))


def slope_names(fields: Mapping[str, Any]) -> list[str]:
    """What may be given in place of slopes in a mixture of so many species as `fields` names."""
    n = _species(fields)
    return [*_pure(n), *(["psi"] if n > 1 else []), *(["delta", "m1"] if n == 2 else [])]


def resolve_slopes(fields: dict[str, Any]) -> None:
    """Turn what stands for slopes among a mixture's `fields` into their `repose_slope`.

    Raises ValueError with one line where that cannot be. Species without names and a matrix that
    is none are left for the mixture to refuse.
    """
    n = _species(fields)
    allowed = slope_names(fields)
    for name in [name for name in fields if STANDS_FOR_SLOPES.fullmatch(str(name))]:
        if not allowed or not isinstance(fields.get("names"), (list, tuple)):
            del fields[name]
        elif name not in allowed:
            raise ValueError(
                f"{name} = {fields[name]!r}: not for {n} species; allowed: {', '.join(allowed)}"
            )
    if "repose_angle" in fields:
        _resolve_angles(fields, n)
    given = {name: _slope(name, fields.pop(name)) for name in allowed if name in fields}
    if not given:
        return
    old = None
    if "repose_slope" in fields:
        try:
            old = SLOPES.validate_python(fields["repose_slope"])
        except ValidationError:
            return
        if [len(row) for row in old] != [n] * n:
            return
    slopes = _of_two_species(given, old) if n == 2 else _of_species(_pure(n), given, old)
    _check_range(slopes, given)
    fields["repose_slope"] = slopes


def _species(fields: Mapping[str, Any]) -> int:
    names = fields.get("names")
    return len(names) if isinstance(names, (list, tuple)) else 2


def _pure(species: int) -> list[str]:
    return [f"theta_{a}{a}" for a in range(1, species + 1)]


def _slope(name: str, value: Any) -> float:
    return number_between(name, value, 0.0 if name.startswith("theta") else -STEEPEST, STEEPEST)


def _resolve_angles(fields: dict[str, Any], species: int) -> None:
    angles = fields.pop("repose_angle")
    if "repose_slope" in fields:
        raise ValueError("repose_slope and repose_angle are both given; one is allowed")
    try:
        fields["repose_slope"] = [[_tangent(angle) for angle in row] for row in angles]
    except TypeError:
        pure = isinstance(angles, (list, tuple)) and len(angles) == species
        if not pure or (species > 1 and "psi" not in fields):
            beside = " with psi beside them" if species > 1 else ""
            raise ValueError(
                f"repose_angle = {angles!r}: it should be a matrix in degrees, "
                f"or {species} pure species' angles{beside}"
            ) from None
        for name, angle in zip(_pure(species), angles, strict=True):
            if name != "theta_22" or "delta" not in fields:
                fields.setdefault(name, _tangent(angle))


def _tangent(angle: Any) -> float:
    if isinstance(angle, bool) or not isinstance(angle, (int, float)) or not 0 <= angle < 89.4:
        raise ValueError(f"repose_angle = {angle!r}: it should be a number from 0 to below 89.4")
    return math.tan(math.radians(angle))


def _of_two_species(given: Mapping[str, float], old: Matrix | None) -> Matrix:
    """Slopes by the paper's parameters; those of `old` where they are not `given`."""
    if "theta_22" in given and "delta" in given:
        raise ValueError(
            f"theta_22 = {given['theta_22']:g}: it should be left out, "
            f"for delta = {given['delta']:g} tells it"
        )
    before: dict[str, float] = {}
    if old is not None:
        (t11, t12), (t21, t22) = old
        before = {"theta_11": t11, "psi": t11 - t21, "delta": t22 - t11, "m1": t12 - t11}
    after = {**before, **given}
    if "theta_22" in after and "theta_11" in after:
        after["delta"] = after.pop("theta_22") - after["theta_11"]
    _check_complete(["theta_11", "psi", "delta"], after)
    if before and "m1" not in given:
        after["m1"] += sum(after[name] - before[name] for name in ("psi", "delta"))
    return two_species_slopes(**after)


def _of_species(pure: list[str], given: Mapping[str, float], old: Matrix | None) -> Matrix:
    """Slopes by the `pure` ones and psi; those of `old` where they are not `given`."""
    if old is None:
        _check_complete([*pure, "psi"] if len(pure) > 1 else pure, given)
        return stepped_slopes([given[name] for name in pure], given.get("psi", 0.0))
    diagonal = [given.get(name, old[b][b]) for b, name in enumerate(pure)]
    if "psi" in given:
        return stepped_slopes(diagonal, given["psi"])
    return tuple(
        tuple(
            diagonal[b] if a == b else slope + (diagonal[b] - old[b][b])
            for b, slope in enumerate(row)
        )
        for a, row in enumerate(old)
    )


def _check_complete(names: list[str], given: Mapping[str, float]) -> None:
    for name in names:
        if name not in given:
            together = f"{', '.join(names[:-1])} and {names[-1]}"
            raise ValueError(f"{name}: missing; {together} go together")


def _check_range(slopes: Matrix, given: Mapping[str, float]) -> None:
    """Name what was `given` and makes a slope that is none."""
    for a, row in enumerate(slopes):
        for b, slope in enumerate(row):
            across = [] if a == b else ["m1", "psi"] if b == 1 else ["psi"]
            pure = [f"theta_{b + 1}{b + 1}", *(["delta"] if b == 1 else []), "theta_11"]
            makers = [name for name in (*across, *pure) if name in given]
            if makers and not 0 <= slope <= STEEPEST:
                raise ValueError(
                    f"{makers[0]} = {given[makers[0]]:g}: it makes a repose slope of {slope:g}, "
                    f"which should be from 0 to {STEEPEST:g}"
                )
