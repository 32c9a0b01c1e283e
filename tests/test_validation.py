"""The validation: every check is told, a wrong model is caught, and the page says when and by what.

What the checks calculate is shared with the tests of the physics, which hold it to the same or
wider bounds; here it is that they can fail, and how they are told.
"""

import json
import math
import re
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner
from test_command_line import refused, stratify

import compare.validation.steady
from compare.cli import cli
from compare.validation import Check, integrated, page, record, table, validate
from compare.validation import report as reports
from compare.validation.lattice import drawn_setup, kernels_agree
from compare.validation.report import Made, made, tally
from compare.validation.subjects import GROUPS, SUBJECTS, Finding
from continuum.theory import steady_state_of
from experiment import Experiment, SetupError, load
from experiment.archive.provenance import made_by

Poured = Callable[..., xr.Dataset]

QUICK = ("continuum.profile", "continuum.patch", "continuum.stratification", "lattice.patterns")
BY = Made("2001-02-03", "stratify 9.9 with numpy 1", "abcdef", "Python 3.99", "x86_64")
RED = Check("a thing", "Nobody, eq. (1)", 1.0, 1.5, 0.1, "made up")
GREEN = Check("a | thing", "Somebody", "stratified", "stratified")
SEEN = Check("v_k / v", "A film", 1.0, 0.3, 0.1, "told", observed=True)
ROOT = Path(__file__).parent.parent


def failing(subject: str, poured: Poured) -> list[str]:
    found = validate([subject], poured=poured)
    return [finding.check.what for finding in found if not finding.check.holds]


def changed(poured: Poured, *wrong: str) -> Poured:
    """Pours with settings that nobody asked for."""
    return lambda model, preset, *settings: poured(model, preset, *settings, *wrong)


@pytest.mark.parametrize("subject", QUICK)
def test_the_models_as_they_are_hold(subject: str, poured: Poured) -> None:
    assert failing(subject, poured) == []


@pytest.mark.parametrize(
    ("subject", "wrong", "caught"),
    [
        ("continuum.profile", "mixture.curvature_length=0.01", "mean |error| of theta"),
        ("continuum.profile", "mixture.collision_rate.1.0=10.4", "theta(dx)"),
        ("continuum.profile", "feed.inflow=[0.1251,0.1249]", "error of R_1 and R_2"),
        ("continuum.segregation", "mixture.delta=0.1", "kinks"),
        ("continuum.stratification", "mixture.delta=-0.1", "regime"),
        ("lattice.patterns", "mixture.repose_slope=[[0.4,0.4],[0.1,0.1]]", "regime"),
    ],
)
def test_another_mixture_than_that_of_the_theory_is_caught(
    subject: str, wrong: str, caught: str, poured: Poured
) -> None:
    state = steady_state_of(load("makse-profile"))
    assert state.middle == 12.5, "theory is that of the presets as they are"
    assert any(caught in what for what in failing(subject, changed(poured, wrong)))


def test_a_pour_with_its_cross_rates_swapped_is_caught(
    poured: Poured, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both programs have one law: the other one is swapped here, for it needs no compilation."""
    right = integrated.exchange

    def swapped(experiment: Experiment, *there: Any) -> Any:
        rates = np.transpose(experiment.mixture.collision_rate).tolist()
        return right(experiment.with_values({"mixture.collision_rate": rates}), *there)

    settings = (*integrated.SMOOTH, *integrated.MIXTURES["canonical"], "continuum.cells=75")
    archive = poured("continuum", "canonical", *settings)
    assert max(integrated.errors_of(archive)) < 4 * integrated.BOUND  # on coarse cells
    monkeypatch.setattr(integrated, "exchange", swapped)
    assert max(integrated.errors_of(archive)) > 10 * integrated.BOUND


def test_grains_that_vanish_are_caught(poured: Poured) -> None:
    """One part in 10^11 of what lies at rest."""

    def leaking(model: str, preset: str, *settings: str) -> xr.Dataset:
        archive = poured(model, preset, *settings)
        lost = archive["deposited_volume"] * (1 - 1e-11)
        return archive.assign(deposited_volume=lost.assign_attrs(archive["deposited_volume"].attrs))

    assert len(failing("continuum.volumes", leaking)) == 2
    assert failing("lattice.patterns", leaking) == ["largest part of a species unaccounted for"]


def test_a_closed_form_that_is_wrong_is_caught(
    poured: Poured, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With gamma_21 one per cent too large in the theory alone."""

    def wrong(experiment):
        state = steady_state_of(experiment)
        return replace(state, cross_rate=1.01 * state.cross_rate)

    monkeypatch.setattr(compare.validation.steady, "steady_state_of", wrong)
    missed = failing("continuum.profile", poured)
    assert "closed form: theta(0)" in missed
    assert any(what.startswith("closed form in the equations") for what in missed)


def test_a_kernel_that_lays_another_grain_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    setups = [drawn_setup(np.random.default_rng(seed)) for seed in range(20)]
    assert all(map(kernels_agree, setups))
    monkeypatch.setattr("ca_model.reference.ReferencePile._is_captured", lambda *_: True)
    assert not all(map(kernels_agree, setups))


def test_random_set_ups_are_of_every_kind() -> None:
    setups = [drawn_setup(np.random.default_rng(seed)) for seed in range(200)]
    assert {len(setup.rule.grain_height) for setup in setups} == {1, 2, 3, 5}
    assert {setup.ground.sides for setup in setups} == {1, 2}
    assert {setup.rule.percolation for setup in setups} == {True, False}
    assert {setup.ground.lips is None for setup in setups} == {True, False}
    assert {bool((setup.source != setup.source[0]).any()) for setup in setups} == {True, False}


@pytest.mark.parametrize(
    ("expected", "found", "bound", "holds"),
    [
        (1.0, 1.1, 0.2, True),
        (1.0, 0.7, 0.2, False),
        (0.0, math.nan, 0.2, False),
        (0.0, math.inf, 0.2, False),
        (2.0, 2.0, 0.0, True),
        ("segregated", "segregated", 0.0, True),
        ("segregated", "mixed", 0.0, False),
        ("segregated", "mixed", 9.0, False),
    ],
)
def test_a_check_holds_within_its_bound_and_not_without_a_number(
    expected, found, bound, holds
) -> None:
    assert Check("", "", expected, found, bound).holds == holds


def test_the_page_has_every_check_with_its_source_and_says_when_and_by_what(poured: Poured) -> None:
    found = validate(QUICK, poured=poured)
    text = page(found, BY)
    assert all(word in text for word in BY)
    for finding in found:
        what, source = (
            part.replace("|", r"\|").replace("_", r"\_").replace("<", "&lt;")
            for part in (finding.check.what, finding.check.source)
        )
        assert f"| {what} | {source} |" in text
    assert f"**{len(found)} of {len(found)} checks hold.**" in text
    rows = [line for line in text.splitlines() if line.startswith("|")]
    assert {len(re.findall(r"(?<!\\)\|", row)) for row in rows} == {9}, "columns of every table"
    assert "Not within its bound" not in text


def test_what_does_not_hold_comes_first_on_the_page() -> None:
    found = [Finding(next(iter(SUBJECTS)), check) for check in (GREEN, RED, SEEN)]
    text = page(found, BY)
    assert "- DOES NOT HOLD: a thing; Nobody, eq. (1): 1.00, found 1.50" in text
    assert r"- outside: v\_k / v; A film: 1.00, found 0.30" in text
    assert text.index("DOES NOT HOLD") < text.index("Somebody")
    assert tally(found) == (
        "1 of 2 checks hold; 0 of 1 comparisons that are not counted are within"
    )


def test_here_and_now_is_a_date_the_versions_and_the_sources_commit() -> None:
    by = made()
    before = datetime.now(UTC).date()
    assert 0 <= (before - date.fromisoformat(by.date)).days <= 1
    assert by.version == made_by()
    assert by.python.startswith("Python 3.")
    assert by.processor
    known = (ROOT / ".git").exists()
    assert bool(re.fullmatch(r"[0-9a-f]{10}( with changes)?", by.commit)) == known


def test_without_git_the_commit_is_not_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reports.shutil, "which", lambda _: None)
    assert made().commit == ""


def test_the_record_is_json_with_nulls_where_there_is_no_number() -> None:
    lost = Check("lost", "", 1.0, math.nan, 0.1)
    found = [Finding("continuum.patch", check) for check in (GREEN, lost, SEEN)]
    told = json.loads(json.dumps(record(found, BY), allow_nan=False))
    assert told["holds"] is False
    assert told["version"] == BY.version
    green, lost_too, seen = told["checks"]
    assert (green["expected"], green["holds"]) == ("stratified", True)
    assert (lost_too["found"], lost_too["difference"], lost_too["holds"]) == (None, None, False)
    assert (seen["observed"], seen["holds"]) == (True, False)
    only_seen = record([found[0], found[2]], BY)
    assert only_seen["holds"] is True, "an observation does not count"


def test_what_numpy_found_is_json_too() -> None:
    found = Check("an order", "", 1.0, np.float64(1.01), 0.1)
    told = json.loads(json.dumps(record([Finding("continuum.bcre", found)], BY)))
    assert told["checks"][0]["holds"] is True


def test_the_table_has_a_row_for_each_subject_and_each_check(poured: Poured) -> None:
    found = validate(QUICK[:2], poured=poured)
    assert table(found).row_count == len(found) + 2


def test_every_subject_is_in_a_group_and_says_what_it_is_about() -> None:
    assert {subject.partition(".")[0] for subject in SUBJECTS} == set(GROUPS)
    assert all(run.__doc__ for run in SUBJECTS.values())


def test_names_that_are_no_subject_are_refused() -> None:
    with pytest.raises(SetupError, match=r"only = lattices: it should be one of continuum, contin"):
        validate(["lattice", "lattices"])


def test_the_command_writes_the_page_and_prints_json_for_programs(tmp_path: Path) -> None:
    options = ["--only=continuum.patch", "-o", "page.md"]
    done = stratify("validate", *options, "--json", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert [check["subject"] for check in told["checks"]] == ["continuum.patch"] * 3
    text = (tmp_path / "page.md").read_text()
    assert f"on {told['date']} (UTC)" in text
    assert told["version"] in text
    assert "wrote page.md" in done.stderr
    assert "page.md' exists already" in refused(stratify("validate", *options, folder=tmp_path))
    assert (tmp_path / "page.md").read_text() == text


def test_bad_names_are_refused_by_the_command_and_nothing_is_run(tmp_path: Path) -> None:
    done = stratify("validate", "--only=everything", "-o", "page.md", folder=tmp_path)
    assert "only = everything: it should be one of" in refused(done)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("checks", "status"), [([GREEN, SEEN], 0), ([GREEN, RED], 1)])
def test_the_exit_status_is_1_where_a_check_does_not_hold(
    checks, status: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(SUBJECTS, "continuum.patch", lambda _: iter(checks))
    done = CliRunner().invoke(cli, ["validate", "--only", "continuum.patch"])
    assert done.exit_code == status, done.output
    assert ("DOES NOT HOLD" in done.output) == bool(status)


def test_the_committed_page_has_every_subject_and_names_no_machine() -> None:
    text = (ROOT / "docs" / "validation.md").read_text()
    assert all(f"### {subject}\n" in text for subject in SUBJECTS)
    assert "DOES NOT HOLD" not in text
    assert not re.search(r"(^|[\s(`])/(?!s\b)\w+/", text), "no paths"
