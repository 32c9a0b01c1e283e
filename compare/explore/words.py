"""What the page says, as HTML: delta and its meaning, a pile's numbers, a verdict, the scores."""

import math
from collections.abc import Sequence
from html import escape

from compare.explore.pours import Numbers, Poured
from compare.explore.prediction import Guess, Try, Verdict, score
from compare.explore.view import LARGE, SMALL
from compare.pictures.style import FRONT, KINK, MODEL_NAMES
from experiment import Experiment

__all__ = [
    "HIDDEN",
    "NO_KEY",
    "NO_TIME",
    "POURING",
    "WAITING",
    "complaint_told",
    "delta_told",
    "key_told",
    "numbers_told",
    "scores_told",
    "sizes_told",
    "time_told",
]

# As high as what takes its place.
WAITING = (
    '<section class="waiting" role="status"><h2>Pouring: a moment, or a minute where the kernels '
    'have to be compiled first.</h2><dl class="row"><div><dt>&nbsp;</dt>'
    '<dd class="value">&nbsp;</dd></div></dl></section>'
)
NO_TIME, NO_KEY = '<p class="clock">time</p>', '<p class="key">&nbsp;</p>'
MEANING = {
    "positive": "Large grains alone pile steeper than small ones: layers are expected.",
    "unsorted": (
        "Large grains alone pile steeper than small ones, but with ψ = 0 they roll no farther on "
        "small ones: nothing parts them, and no layers are expected."
    ),
    "negative": (
        "Large grains alone pile no steeper than small ones: two zones are expected, no layers. "
        "Near 0 both models still lay some."
    ),
    "hidden": "Large grains are number 2, small ones number 1. What will the pile look like?",
}
LEAST_PSI = 0.005  # 1; what is less is shown as 0
NOT_YET, NONE, HIDDEN, POURING = "not yet", "none", "hidden", "pouring"
UNCLEAR = "unclear to the end: not counted"
UNSEEN = {HIDDEN: HIDDEN, POURING: "…"}
SAID = {
    "stratified": "layers",
    "layered-and-segregated": "layers + zones",
    "segregated": "segregated",
    "mixed": "mixed",
    "unsettled": NOT_YET,
    HIDDEN: HIDDEN,
    POURING: "pouring …",
}


def delta_told(setup: Experiment, *, hidden: bool) -> str:
    """delta, large, and what the paper says of its sign, unless that is to be predicted."""
    delta = setup.mixture.delta
    sign = "hidden" if hidden else "positive" if delta > 0 else "negative"
    if sign == "positive" and setup.mixture.psi < LEAST_PSI:
        sign = "unsorted"
    return (
        f'<div class="delta {sign}"><output class="value">δ = {_signed(delta)}</output>'
        f'<div><p class="formula">δ = tan θ<sub>22</sub> &minus; tan θ<sub>11</sub></p>'
        f'<p class="meaning">{MEANING[sign]}</p></div></div>'
    )


def complaint_told(complaint: str) -> str:
    """Why what is asked for cannot be poured."""
    return f'<p class="complaint" role="alert">{escape(complaint)}</p>'


def numbers_told(pile: Poured, found: Numbers | str, verdict: Verdict | None = None) -> str:
    """The name of a model, and what is `found` in its pile so far; or HIDDEN, or POURING."""
    if isinstance(found, str):
        regime, wavelength, kinks, nothing = found, "", "", UNSEEN[found]
    else:
        regime, nothing = found.regime, NOT_YET if found.regime == "unsettled" else NONE
        wavelength = _with_error(found.wavelength, found.wavelength_error)
        kinks = _with_error(found.kink_velocity, found.kink_velocity_error)
    told = {
        "regime": ("it laid", SAID[regime]),
        "wavelength": ("wavelength (cm)", wavelength or nothing),
        "kinks": ("kinks climb at (cm/s)", kinks or nothing),
    }
    empty = {NOT_YET, NONE, *UNSEEN.values()}
    cells = "".join(
        f'<div><dt>{label}</dt><dd><output class="value {name}'
        f'{" nothing" if value in empty else ""}">{value}</output></dd></div>'
        for name, (label, value) in told.items()
    )
    model = pile.archive.attrs["model"]
    acts = ""
    if model == "ca_model" and found != POURING:
        acts = ": at the continuum's rates"
        if "effective_repose_slope" in pile.archive.attrs:
            acts = f": acts as δ = {_signed(pile.delta)}"
    return (
        f'<section class="numbers {regime}" aria-label="{MODEL_NAMES[model]}">'
        f"<h2>{MODEL_NAMES[model]}<small>{acts}</small>{_judged(verdict)}</h2>"
        f'<dl class="row">{cells}</dl></section>'
    )


def key_told(setup: Experiment, exaggeration: int) -> str:
    """What the colours are."""
    small, large = map(escape, setup.mixture.names)
    if small != "small":
        small, large = f"{small} (small)", f"{large} (large)"
    signs = {
        f'<i style="background:{SMALL}"></i>': small,
        f'<i style="background:{LARGE}"></i>': large,
        f'<b style="color:{KINK["color"]}">▲</b>': "kink, climbing",
        f'<b style="color:{FRONT["color"]}">●</b>': "front, running down (after a third)",
        "": f"rolling layer: {exaggeration} &times; as thick",
    }
    told = "".join(f"{sign}<span>{meaning}</span>" for sign, meaning in signs.items())
    return f'<p class="key">{told}</p>'


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
        f"{10 * mixture.curvature_length:.2g} mm. What sizes do to slopes is ψ: turn that, too. "
        "Each change pours both piles anew, the same volume however fast, onto the preset's "
        "slope.</p>"
    )


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


def time_told(share: float, duration: float) -> str:
    """The time that the clock shows."""
    digits = max(0, 2 - math.floor(math.log10(duration)))
    now, end = (f"{time:.{digits}f} s" for time in (share * duration, duration))
    return f'<p class="clock">time: <b>{now}</b> of {end}</p>'


def _judged(verdict: Verdict | None) -> str:
    """How a guess stands beside a pile, in a few words."""
    if verdict is None:
        return ""
    guess, found = verdict.guess, verdict.found
    if not verdict.possible:
        return f'<span class="verdict" role="status">{UNCLEAR}</span>'
    words = [(verdict.pattern, guess.pattern)]
    if verdict.wavelength is not None:
        off = guess.wavelength / found.wavelength - 1.0
        size = "" if abs(off) < 0.005 else f", {abs(off):.0%} too {'large' if off > 0 else 'small'}"
        words.append((verdict.wavelength, f"{guess.wavelength:.3g} cm{size}"))
    said = " ".join(
        f'<span class="{"right" if right else "wrong"}">{_mark(right)} {word}</span>'
        for right, word in words
    )
    return f'<span class="verdict" role="status">{said}</span>'


def _guessed(guess: Guess) -> str:
    told = math.isfinite(guess.wavelength) and guess.pattern == "layers"
    return f"{guess.pattern}, {guess.wavelength:.3g} cm" if told else guess.pattern


def _found(verdict: Verdict) -> str:
    found = verdict.found
    size = f", {found.wavelength:.2g} cm" if math.isfinite(found.wavelength) else ""
    if not verdict.possible:
        return UNCLEAR
    points = f"{verdict.points}/{verdict.possible}"
    return f"{_mark(verdict.pattern)} {SAID[found.regime]}{size} <b>{points}</b>"


def _mark(right: bool) -> str:
    return "✓" if right else "✗"


def _signed(value: float) -> str:
    """With a minus that is as wide as a plus; 0 has no sign."""
    rounded = f"{value:+.2f}"
    return "0.00" if float(rounded) == 0 else rounded.replace("-", "&minus;")


def _with_error(value: float, error: float) -> str:
    """As many digits as the error allows; empty where there is no value."""
    if not math.isfinite(value):
        return ""
    if not (math.isfinite(error) and error > 0):
        return f"{value:.2g}"
    digits = min(max(0, 1 - math.floor(math.log10(error))), 3)
    return f"{value:.{digits}f} <small>± {error:.{digits}f}</small>"
