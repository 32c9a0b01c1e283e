"""What was found, as a table, as plain numbers, and as a page that says when and by what."""

import math
import platform
import shutil
import subprocess
from collections.abc import Sequence
from datetime import UTC, datetime
from inspect import cleandoc
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

from rich.markup import escape
from rich.table import Table

from compare.table import plain
from compare.validation.check import Check
from compare.validation.subjects import GROUPS, SUBJECTS, Finding
from experiment.archive.provenance import made_by

__all__ = ["Made", "made", "page", "record", "table", "tally"]

PACKAGES = ("experiment", "ca_model", "continuum", "compare")
COLUMNS = ("what", "source", "expected", "found", "difference", "bound", "what the bound is", "")
DIGITS = 2  # of a bound that are told
MOST_DIGITS = 6


class Made(NamedTuple):
    """When and by what."""

    date: str  # UTC
    version: str
    commit: str  # empty where it is not known
    python: str
    processor: str


def made() -> Made:
    """Here and now."""
    return Made(
        date=datetime.now(UTC).date().isoformat(),
        version=made_by(),
        commit=_commit(),
        python=f"Python {platform.python_version()}",
        processor=_processor(),
    )


def tally(found: Sequence[Finding]) -> str:
    """How many checks hold, and how many observations are within their bounds."""
    checks = [finding.check for finding in found if not finding.check.observed]
    seen = [finding.check for finding in found if finding.check.observed]
    parts = []
    if checks:
        parts.append(f"{sum(check.holds for check in checks)} of {len(checks)} checks hold")
    if seen:
        within = sum(check.holds for check in seen)
        parts.append(f"{within} of {len(seen)} comparisons that are not counted are within")
    return "; ".join(parts)


def table(found: Sequence[Finding]) -> Table:
    """A row for each check, and its source below it."""
    sheet = Table("what, and source", *COLUMNS[2:6], "")
    for subject, findings in groupby(found, lambda finding: finding.subject):
        sheet.add_section()
        sheet.add_row(f"[bold]{subject}[/bold]")
        for finding in findings:
            what, source, *numbers, _, verdict = _row(finding.check)
            sheet.add_row(f"{escape(what)}\n  [dim]{escape(source)}[/dim]", *numbers, verdict)
    return sheet


def record(found: Sequence[Finding], by: Made) -> dict[str, object]:
    """The same as plain values, for JSON; None where there is no number."""
    return by._asdict() | {
        "holds": all(finding.check.holds or finding.check.observed for finding in found),
        "checks": [
            {"subject": finding.subject}
            | {name: plain(value) for name, value in finding.check._asdict().items()}
            | {"difference": plain(finding.check.difference), "holds": finding.check.holds}
            for finding in found
        ],
    }


def page(found: Sequence[Finding], by: Made) -> str:
    """The page in Markdown."""
    commit = f", commit {by.commit}" if by.commit else ""
    parts = [
        "# Validation",
        f"Written by `stratify validate` on {by.date} (UTC): {by.version}{commit}; {by.python}, "
        f"{by.processor}.",
        f"**{tally(found)}.**",
        INTRODUCTION,
        *_beyond(found),
    ]
    for group, findings in groupby(found, lambda finding: finding.group):
        parts.append(f"## {GROUPS[group]}")
        parts += [OBSERVED] if group == "published" else []
        for subject, of_subject in groupby(findings, lambda finding: finding.subject):
            rows = [COLUMNS, ("---",) * len(COLUMNS)]
            rows += [tuple(map(_cell, _row(finding.check))) for finding in of_subject]
            sheet = "\n".join(f"| {' | '.join(row)} |" for row in rows)
            parts += [f"### {subject}", cleandoc(SUBJECTS[subject].__doc__ or ""), sheet]
    return "\n\n".join(parts) + "\n"


def _beyond(found: Sequence[Finding]) -> list[str]:
    """A list of what is not within its bound, first of all."""
    beyond = [finding.check for finding in found if not finding.check.holds]
    rows = [
        f"- {_verdict(check)}: {what}; {source}: {expected}, found {number}"
        for check in beyond
        for what, source, expected, number, *_ in [tuple(map(_cell, _row(check)))]
    ]
    return ["## Not within its bound", "\n".join(rows)] if rows else []


INTRODUCTION = """\
Every number below comes from a run that this command made. *Expected* is what the source says,
*bound* how far from it *found* may be, and *what the bound is* why: round-off, an error that
vanishes with the grid as O(dx), standard errors. Bounds of round-off and of O(dx) are a few times
what was found when they were set, so that a change for the worse shows. A row marked `within` or
`outside` is told but not counted."""

OBSERVED = """\
No experiment tells all that a pour needs: of `glass-sugar` the cross rates, d and l were never
measured, and the flux of the photograph is not stated. So these rows compare, and do not count.
Where one is outside, the model with these inputs does not do what was seen."""


def _row(check: Check) -> tuple[str, ...]:
    digits = _digits(check)
    unit = "" if check.unit == "1" else f" {check.unit}"
    words = isinstance(check.expected, str)
    return (
        check.what,
        check.source,
        _number(check.expected, digits, unit),
        _number(check.found, digits, unit),
        "" if words else f"{check.difference:.1e}" if check.difference else "0",
        "" if words else f"{check.bound:.2g}",
        check.why,
        _verdict(check),
    )


def _verdict(check: Check) -> str:
    if check.observed:
        return "within" if check.holds else "outside"
    return "holds" if check.holds else "DOES NOT HOLD"


def _digits(check: Check) -> int:
    """Decimals that show the bound's second digit."""
    if check.bound <= 0:
        return 0
    return min(max(0, DIGITS - 1 - math.floor(math.log10(check.bound))), MOST_DIGITS)


def _number(value: float | str, digits: int, unit: str) -> str:
    if isinstance(value, str):
        return value
    if value == 0 or abs(value) < 10.0 ** -(digits - 1):
        return f"{value:.2g}{unit}"
    return f"{value:.{digits}f}{unit}"


def _cell(text: str) -> str:
    """A cell of a Markdown table."""
    return text.replace("|", r"\|").replace("<", "&lt;").replace("_", r"\_").replace("*", r"\*")


def _commit() -> str:
    """The commit of these sources; empty where git does not know them."""
    git, here = shutil.which("git"), Path(__file__)
    if git is None:
        return ""

    def ask(*words: str) -> subprocess.CompletedProcess[str]:
        command = [git, "-C", str(here.parents[2]), *words]
        return subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603

    if ask("ls-files", "--error-unmatch", str(here)).returncode:
        return ""
    changed = ask("diff", "--quiet", "HEAD", "--", *PACKAGES).returncode
    commit = ask("rev-parse", "--short=10", "HEAD").stdout.strip()
    return f"{commit} with changes" if changed else commit


def _processor() -> str:
    """What kind of processor this is, as far as the system tells."""
    kind = platform.machine()
    told = Path("/proc/cpuinfo")
    if told.exists():
        for line in told.read_text().splitlines():
            name, _, value = line.partition(":")
            if name.strip() == "model name":
                return f"{kind} ({value.strip()})"
    return f"{kind} ({platform.processor()})" if platform.processor() else kind
