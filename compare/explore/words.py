"""What the page says, as HTML: delta and its meaning, a pile's numbers, a verdict, the scores."""

import math
from collections.abc import Sequence
from html import escape

from compare.explore.pours import Numbers, Poured
from compare.explore.prediction import Guess, Try, Verdict, score
from compare.explore.view import LARGE, SMALL
from compare.pictures.style import FRONT, KINK, MODEL_NAMES
from experiment import Experiment

__all__ = ["delta_told", "key_told", "numbers_told", "scores_told", "sizes_told", "verdict_told"]

SAID = {
    "stratified": "layers",
    "layered-and-segregated": "layers, and segregated",
    "segregated": "segregated",
    "mixed": "mixed",
    "unsettled": "not yet",
}
NOT_YET = "not yet"
HIDDEN = "hidden"
NONE = "none"


def delta_told(setup: Experiment) -> str:
    """delta, large, and what the paper says of its sign."""
    delta = setup.mixture.delta
    if delta > 0:
        meaning = "Large grains alone pile steeper than small ones: layers are expected."
        sign = "positive"
    else:
        meaning = (
            "Large grains alone do not pile steeper than small ones: no layers, two zones are "
            "expected. Just below 0 some may be left where the zones meet."
        )
        sign = "negative"
    return (
        f'<div class="delta {sign}"><output class="value">δ = {_signed(delta)}</output>'
        f'<div><p class="formula">δ = tan θ<sub>22</sub> &minus; tan θ<sub>11</sub></p>'
        f'<p class="meaning">{meaning}</p></div></div>'
    )


def numbers_told(pile: Poured, numbers: Numbers | None, *, hidden: bool, over: bool) -> str:
    """The name of a model, and what is measured of its pile so far."""
    word, wavelength, kinks = HIDDEN, HIDDEN, HIDDEN
    if not hidden:
        found = numbers or Numbers()
        word = SAID[found.regime]
        nothing = NONE if over or found.regime in ("segregated", "mixed") else NOT_YET
        wavelength = _with_error(found.wavelength, found.wavelength_error, "cm", nothing)
        kinks = _with_error(found.kink_velocity, found.kink_velocity_error, "cm/s", nothing)
    regime = "hidden" if hidden else (numbers or Numbers()).regime
    model = pile.archive.attrs["model"]
    acts = f"acts as δ = {_signed(pile.delta)}" if model == "ca_model" else "solved as it is"
    return (
        f'<section class="numbers {regime}" aria-label="{MODEL_NAMES[model]}">'
        f'<h2>{MODEL_NAMES[model]}</h2><output class="regime">{word}</output>'
        f"<dl><div><dt>wavelength</dt><dd class='wavelength'>{wavelength}</dd></div>"
        f"<div><dt>kinks climb at</dt><dd class='kinks'>{kinks}</dd></div></dl>"
        f'<p class="acts">{acts}</p></section>'
    )


def key_told(setup: Experiment, exaggeration: int) -> str:
    """What the colours are."""
    small, large = map(escape, setup.mixture.names)
    if small != "small":
        small, large = f"{small} (small)", f"{large} (large)"
    return (
        '<p class="key">'
        f'<i style="background:{SMALL}"></i>{small} <i style="background:{LARGE}"></i>{large} '
        f'<b style="color:{KINK["color"]}">▲</b> kink, climbs '
        f'<b style="color:{FRONT["color"]}">●</b> avalanche front, runs down '
        f"<span>what rolls is drawn {exaggeration} times as thick</span></p>"
    )


def sizes_told(setup: Experiment, lattice: Poured | None) -> str:
    """What sizes do in either model."""
    if lattice is None:
        return ""
    small, large = lattice.archive.attrs["grain_height"]
    mixture = setup.mixture
    return (
        f'<p class="note">Sizes. Lattice: a large grain is {large / small:.3g} small ones high, '
        f"a column {10 * lattice.archive.attrs['column_width_cm']:.3g} mm wide. "
        f"Continuum: surface layer {10 * mixture.surface_depth:.2g} mm, curvature length "
        f"{10 * mixture.curvature_length:.2g} mm. What sizes do to slopes is ψ: turn that, too.</p>"
    )


def verdict_told(one: Try) -> str:
    """How a guess stands beside each pile, in a line each."""
    lines = [
        f'<p class="{"right" if verdict.pattern else "wrong"}">'
        f"{_mark(verdict.pattern)} {MODEL_NAMES[model]}: {_sentence(one.guess, verdict)}</p>"
        for model, verdict in one.verdicts.items()
    ]
    return f'<div class="verdict" role="status">{"".join(lines)}</div>'


def scores_told(tries: Sequence[Try]) -> str:
    """The table of all tries, the last one first."""
    if not tries:
        return ""
    points, possible = score(list(tries))
    rows = [
        f"<tr><td>{number}</td><td>{_signed(one.delta)}</td><td>{_guessed(one.guess)}</td>"
        + "".join(f"<td>{_found(verdict)}</td>" for verdict in one.verdicts.values())
        + "</tr>"
        for number, one in enumerate(tries, 1)
    ]
    return (
        f'<div class="scores"><h2>Score: {points} of {possible}</h2>'
        "<table><thead><tr><th></th><th>δ</th><th>predicted</th>"
        + "".join(f"<th>{MODEL_NAMES[model]}</th>" for model in tries[0].verdicts)
        + f"</tr></thead><tbody>{''.join(reversed(rows))}</tbody></table></div>"
    )


def _sentence(guess: Guess, verdict: Verdict) -> str:
    found = verdict.found
    laid = f"it laid {_laid(found)}"
    if not verdict.pattern:
        return f"{laid}, not {guess.pattern}."
    if verdict.wavelength is None:
        return f"{laid}."
    off = guess.wavelength / found.wavelength - 1.0
    near = "within a fifth" if verdict.wavelength else "more than a fifth off"
    return f"{laid}; {guess.wavelength:.3g} cm was {off:+.0%}: {near}."


def _laid(found: Numbers) -> str:
    if not math.isfinite(found.wavelength):
        return {"mixed": "a mixture", "segregated": "two zones"}.get(found.regime, "too little")
    return f"{SAID[found.regime]} of {_with_error(found.wavelength, found.wavelength_error, 'cm')}"


def _guessed(guess: Guess) -> str:
    told = math.isfinite(guess.wavelength) and guess.pattern == "layers"
    return f"{guess.pattern}, {guess.wavelength:.3g} cm" if told else guess.pattern


def _found(verdict: Verdict) -> str:
    found = verdict.found
    size = f", {found.wavelength:.2g} cm" if math.isfinite(found.wavelength) else ""
    points = f"{verdict.points}/{verdict.possible}"
    return f"{_mark(verdict.pattern)} {SAID[found.regime]}{size} <b>{points}</b>"


def _mark(right: bool) -> str:
    return "✓" if right else "✗"


def _signed(value: float) -> str:
    """With a minus that is as wide as a plus; 0 has no sign."""
    rounded = f"{value:+.2f}"
    return "0.00" if float(rounded) == 0 else rounded.replace("-", "&minus;")


def _with_error(value: float, error: float, unit: str, nothing: str = NONE) -> str:
    """As many digits as the error allows."""
    if not math.isfinite(value):
        return nothing
    if not (math.isfinite(error) and error > 0):
        return f"{value:.2g} {unit}"
    digits = min(max(0, 1 - math.floor(math.log10(error))), 3)
    return f"{value:.{digits}f} <small>± {error:.{digits}f}</small> {unit}"
