"""The desk behind the page: what knobs do to both models, and what a prediction is worth."""

import math
import socket
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from random import Random

import numpy as np
import pytest
from bokeh.document import Document
from bokeh.io.doc import patch_curdoc
from bokeh.models import Scatter, VArea
from click.testing import CliRunner

import ca_model
from compare import measure
from compare.campaign import CHECK
from compare.cli import explore as command
from compare.cli.explore import explore
from compare.explore import page as explore_page
from compare.explore import words
from compare.explore.clock import Clock
from compare.explore.controls import PREDICT
from compare.explore.desk import RATE, THRESHOLD, Desk, Stage, presets
from compare.explore.knobs import KNOBS, turned
from compare.explore.page import Page
from compare.explore.pours import Numbers, Pours
from compare.explore.prediction import Guess, Try, judge, score
from compare.explore.view import LARGE, NOTHING, SHADES, SMALL, Pile, Window, image_of
from compare.regimes import LAYERED_REGIMES
from experiment import Experiment, SetupError, load, preset_names


@pytest.fixture(scope="module")
def pours() -> Pours:
    return Pours(Desk("glass-sugar").setup)


def regimes(desk: Desk) -> set[str]:
    return {numbers.regime for numbers in Pours(desk.setup).measure(1.0).values()}


def test_presets_are_those_of_two_species_that_both_models_pour_in_a_silo() -> None:
    offered = presets()
    for setup in offered.values():
        for check in CHECK.values():
            check(setup)
    assert {"glass-sugar", "makse-stratification", "makse-segregation"} <= offered.keys()
    others = {name: load(name) for name in preset_names() if name not in offered}
    assert {"heap", "ternary", "lattice-stratification", "pulsed-feed"} <= others.keys()


@pytest.mark.parametrize("preset", sorted(presets()))
@pytest.mark.parametrize("name", KNOBS)
def test_a_knob_does_what_it_says_and_nothing_else(preset: str, name: str) -> None:
    setup = presets()[preset]
    low, _, step = KNOBS[name].range_of(setup)
    wanted = KNOBS[name].read(setup) - step
    assert wanted >= low
    changed = turned(setup, {name: wanted})
    for other, knob in KNOBS.items():
        expected = wanted if other == name else knob.read(setup)
        assert knob.read(changed) == pytest.approx(expected), other


def test_a_knob_turned_back_is_the_preset_again() -> None:
    desk = Desk("glass-sugar")
    there = desk.knob("angle_2")
    desk.turn("angle_2", 30.0)
    assert desk.setup.published is None
    assert desk.setup.title.endswith("changed")
    desk.turn("angle_2", there + 1e-9)
    assert desk.setup == desk.presets["glass-sugar"]


def test_however_fast_the_same_volume_is_poured() -> None:
    setup = presets()["glass-sugar"]
    for inflow in (0.05, 0.5, 1.0):
        assert turned(setup, {"total_inflow": inflow}).mean_growth == pytest.approx(
            setup.mean_growth
        )


def test_sizes_act_on_both_models() -> None:
    setup = presets()["glass-sugar"]
    larger = turned(setup, {"diameter_1": 0.54, "diameter_2": 1.6})
    assert larger.mixture.surface_depth == pytest.approx(2 * setup.mixture.surface_depth)
    assert larger.mixture.curvature_length == pytest.approx(2 * setup.mixture.curvature_length)
    lattices = [ca_model.lattice_of(one) for one in (setup, larger)]
    assert lattices[1].unit == pytest.approx(2 * lattices[0].unit)
    assert ca_model.lattice_of(turned(setup, {"diameter_2": 1.35})).rule.grain_height[1] == 5
    profile = presets()["makse-profile"]
    assert turned(profile, {"diameter_2": 0.9}).mixture.curvature_length == 0.0


@pytest.mark.parametrize(
    ("knob", "value", "named"),
    [
        ("psi", 0.6, "mixture.psi = 0.6: it makes a repose slope of -0.112267"),
        ("diameter_1", 0.9, "mixture.grain_diameter = [0.09, 0.08]: the large grains should not"),
        ("angle_2", math.nan, "theta_22 = nan"),
    ],
)
def test_what_cannot_be_poured_is_said_in_a_line_and_the_last_good_set_up_stays(
    knob: str, value: float, named: str
) -> None:
    desk = Desk("glass-sugar")
    desk.turn("share_2", 0.4)
    before = desk.setup
    desk.turn(knob, value)
    assert named in desk.complaint
    assert "\n" not in desk.complaint
    assert desk.setup is before
    desk.turn(knob, KNOBS[knob].read(before))
    assert desk.complaint == ""
    assert desk.setup == before


def test_the_rule_of_the_lattice_can_be_chosen_and_stays_whatever_else_is_turned() -> None:
    desk = Desk("glass-sugar")
    preset = desk.setup
    desk.follow(RATE)
    desk.turn("psi", 0.2)
    assert (desk.setup.ca_model["rule"], desk.setup.mixture.psi) == (RATE, pytest.approx(0.2))
    desk.choose("makse-segregation")
    assert desk.setup.ca_model["rule"] == RATE
    desk.choose("glass-sugar")
    told = words.numbers_told(Pours(desk.setup).of["ca_model"], words.HIDDEN)
    assert "at the continuum's rates" in told
    desk.follow(THRESHOLD)
    assert desk.setup == preset


def test_what_cannot_be_poured_is_poured_once_and_the_last_good_pours_stay(pours: Pours) -> None:
    desk = Desk("glass-sugar")
    desk.refuse(desk.setup, "no sand")
    assert (desk.complaint, desk.wanted) == ("no sand", None)
    desk.take(pours)
    desk.turn("angle_2", 30.0)
    desk.refuse(desk.setup, "no sand")
    assert desk.complaint == "no sand"
    assert desk.setup == pours.setup


def test_who_has_gone_on_does_not_hear_of_a_pour_that_failed(pours: Pours) -> None:
    desk = Desk("glass-sugar")
    desk.take(pours)
    desk.turn("angle_2", 30.0)
    left = desk.setup
    desk.turn("angle_2", 20.0)
    desk.refuse(left, "no sand")
    assert desk.complaint == ""
    assert desk.wanted is desk.setup
    assert desk.knob("angle_2") == 20.0


@pytest.mark.parametrize("preset", ["glass-sugar", "makse-stratification"])
def test_delta_below_zero_ends_the_layers_and_above_they_are_back(preset: str) -> None:
    desk = Desk(preset)
    steep, large = desk.knob("angle_1"), desk.knob("angle_2")
    assert regimes(desk) <= set(LAYERED_REGIMES)
    desk.turn("angle_2", steep - 10.0)
    assert desk.setup.mixture.delta < 0
    assert regimes(desk) == {"segregated"}
    desk.turn("angle_2", large)
    assert regimes(desk) <= set(LAYERED_REGIMES)


def test_the_set_up_that_is_saved_pours_the_same_pile(pours: Pours) -> None:
    saved = Experiment.from_toml(Desk("glass-sugar").toml)
    again = ca_model.pour(saved)
    laid = pours.of["ca_model"].archive["deposit_fraction"]
    np.testing.assert_array_equal(again["deposit_fraction"], laid)


def test_numbers_are_those_of_the_pour_so_far_and_at_the_end_those_of_its_archive(
    pours: Pours,
) -> None:
    assert pours.known(0.3) is None
    for model, pile in pours.of.items():
        whole = measure(pile.archive)
        told = pours.measure(1.0)[model]
        assert pile.known(1.0) is told
        assert told.regime == whole["regime"].item()
        assert told.wavelength == float(whole["wavelength"])
        assert pile.measure(0.0) == pytest.approx(Numbers(), nan_ok=True)
        assert pile.measure(0.5).wavelength_error > told.wavelength_error


def test_on_the_lattice_delta_acts_in_steps_of_a_grain_on_a_column(pours: Pours) -> None:
    assert pours.of["continuum"].delta == pytest.approx(pours.setup.mixture.delta)
    assert pours.of["ca_model"].delta == pytest.approx(0.4)


def test_the_clock_runs_as_long_as_it_is_told_and_stops_at_the_end() -> None:
    clock = Clock(lasts=20.0)
    assert not clock.tick(5.0)
    clock.play()
    assert clock.tick(5.0)
    assert clock.share == 0.25
    clock.toggle()
    clock.tick(5.0)
    assert clock.share == 0.25
    clock.toggle()
    clock.tick(100.0)
    assert (clock.share, clock.playing) == (1.0, False)
    clock.play()
    assert (clock.share, clock.playing) == (0.0, True)


def test_a_knob_leaves_the_clock_where_it_is_and_a_preset_begins_anew() -> None:
    desk = Desk("glass-sugar")
    desk.clock.turn(0.7)
    desk.clock.play()
    desk.turn("total_inflow", 0.5)
    assert (desk.clock.share, desk.clock.playing) == (0.7, True)
    desk.choose("makse-segregation")
    assert desk.clock.share == 0.0


LAYERS = Numbers("stratified", 1.0, 0.01, 5.0, 0.1)
ZONES = Numbers("segregated")
BOTH = Numbers("layered-and-segregated", 1.0, 0.01)


@pytest.mark.parametrize(
    ("guess", "found", "right", "points", "possible"),
    [
        (Guess("layers", 1.19), LAYERS, True, 2, 2),
        (Guess("layers", 0.79), LAYERS, True, 1, 2),
        (Guess("layers"), LAYERS, True, 1, 1),
        (Guess("layers", 1.0), ZONES, False, 0, 1),
        (Guess("segregated", 1.0), ZONES, True, 1, 1),
        (Guess("segregated"), BOTH, True, 1, 1),
        (Guess("layers", 1.0), BOTH, True, 2, 2),
        (Guess("mixed"), BOTH, False, 0, 1),
        (Guess("mixed"), Numbers("mixed"), True, 1, 1),
        (Guess("mixed"), Numbers("unsettled"), False, 0, 0),
    ],
)
def test_a_guess_is_right_where_the_pile_is_what_was_said(
    guess: Guess, found: Numbers, *, right: bool, points: int, possible: int
) -> None:
    verdict = judge(guess, {"continuum": found})["continuum"]
    assert verdict.pattern == right
    assert (verdict.points, verdict.possible) == (points, possible)


def test_the_score_counts_every_try_of_both_models() -> None:
    found = {"ca_model": LAYERS, "continuum": ZONES}
    tries = [
        Try(0.1, guess, judge(guess, found)) for guess in (Guess("layers", 1.0), Guess("mixed"))
    ]
    assert score(tries) == (2, 5)
    told = words.scores_told(tries)
    assert "Score: 2 of 5" in told
    assert told.index("mixed") < told.index("layers, 1 cm")


def test_a_pile_that_is_unclear_to_its_end_is_not_counted(pours: Pours) -> None:
    [verdict] = judge(Guess("mixed"), {"continuum": Numbers("unsettled")}).values()
    pile = pours.of["continuum"]
    assert words.UNCLEAR in words.numbers_told(pile, verdict.found, verdict)
    assert words.UNCLEAR in words.scores_told([Try(0.1, verdict.guess, {"continuum": verdict})])


def test_layers_are_expected_where_delta_is_positive_and_something_sorts_the_grains() -> None:
    setup = presets()["glass-sugar"]
    meant = {
        words.MEANING["positive"]: {},
        words.MEANING["unsorted"]: {"psi": 0.0},
        words.MEANING["negative"]: {"angle_2": 20.0, "psi": 0.0},
    }
    for meaning, knobs in meant.items():
        assert meaning in words.delta_told(turned(setup, knobs), hidden=False)
        assert meaning not in words.delta_told(turned(setup, knobs), hidden=True)


def test_a_prediction_hides_the_pile_runs_it_and_is_judged_at_its_end(pours: Pours) -> None:
    desk = Desk("glass-sugar")
    desk.take(pours)
    desk.clock.turn(1.0)
    desk.predict(on=True)
    assert (desk.stage, desk.clock.share) == (Stage.OPEN, 0.0)
    desk.run(Guess("layers", 1.2))
    desk.clock.tick(0.95 * desk.clock.lasts)
    assert not desk.due
    assert desk.judge() == []
    desk.clock.tick(desk.clock.lasts)
    (only,) = desk.judge()
    assert desk.stage is Stage.JUDGED
    assert only.verdicts["continuum"].points == 2
    assert only.verdicts["ca_model"].points == 1
    desk.turn("angle_2", 20.0)
    assert (desk.stage, desk.clock.share, desk.due) == (Stage.OPEN, 0.0, False)
    assert desk.wanted is desk.setup


def test_what_is_hidden_is_not_told(pours: Pours) -> None:
    pile, found = pours.of["continuum"], pours.measure(1.0)["continuum"]
    shown = words.numbers_told(pile, found)
    assert "1.216" in shown
    assert "layers" in shown
    hidden = words.numbers_told(pile, words.HIDDEN)
    assert hidden.count(">hidden<") == 3
    assert "1.2" not in hidden
    pouring = words.numbers_told(pours.of["ca_model"], words.POURING)
    assert "acts as" in words.numbers_told(pours.of["ca_model"], words.HIDDEN)
    assert "acts as" not in pouring
    assert pouring.count(">…<") == 2
    assert "expected" not in words.delta_told(pours.setup, hidden=True)


@pytest.mark.parametrize("preset", sorted(presets()))
def test_a_set_up_that_is_drawn_can_be_poured(preset: str) -> None:
    desk, random = Desk(preset), Random(1)
    signs = set()
    for _ in range(12):
        desk.draw(random)
        assert desk.complaint == ""
        signs.add(desk.setup.mixture.delta > 0)
    assert signs == {True, False}


def test_the_picture_sent_is_the_deposit(pours: Pours) -> None:
    for pile in pours.of.values():
        image = image_of(pile)
        laid = image != NOTHING
        fraction = pile.archive["deposit_fraction"].isel(species=1)
        assert image[laid].mean() / (SHADES - 1) == pytest.approx(float(fraction.mean()), abs=0.01)
        assert laid.mean() == pytest.approx(float(fraction.notnull().mean()), abs=0.01)
        assert (laid[5, -1], laid[-5, -1]) == (True, False)  # from the floor up


def test_the_key_names_the_colours_of_the_picture(pours: Pours) -> None:
    key = words.key_told(pours.setup, 5)
    order = [key.index(one) for one in (SMALL, "glass (small)", LARGE, "sugar (large)")]
    assert order == sorted(order)


def test_sizes_are_told_in_millimetres(pours: Pours) -> None:
    told = words.sizes_told(pours.setup, pours.of["ca_model"])
    assert "3 small ones high, a column 2.7 mm wide" in told
    assert "surface layer 0.54 mm, curvature length 0.54 mm" in told


class Later:
    """Workers who do what they are asked to once they are told."""

    def __init__(self) -> None:
        self.asked: list[tuple[Future[object], Callable[[], object]]] = []

    def submit(self, work: Callable[[], object]) -> Future[object]:
        future: Future[object] = Future()
        self.asked.append((future, work))
        return future

    def work(self) -> None:
        asked, self.asked = self.asked, []
        for future, work in asked:
            try:
                future.set_result(work())
            except Exception as error:
                future.set_exception(error)


@pytest.fixture
def visit(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Page, Later]]:
    """A page that nobody looks at, and its workers."""
    workers = Later()
    monkeypatch.setattr(explore_page, "WORKERS", workers)
    document = Document()
    with patch_curdoc(document):
        yield Page(), workers


def ticks(page: Page, workers: Later) -> None:
    """Until all that was asked for is there."""
    for _ in range(3):
        page.tick()
        workers.work()
        page.tick()


def test_of_other_settings_than_those_asked_for_no_numbers_are_told(
    visit: tuple[Page, Later],
) -> None:
    page, workers = visit
    page.desk.clock.turn(1.0)
    ticks(page, workers)
    told = page.controls.numbers["continuum"]
    assert ">layers<" in told.object
    page.controls.knobs["angle_2"].value = 10.0
    page.tick()
    assert "&minus;0.31" in page.controls.delta.object
    assert "pouring" in told.object
    workers.work()  # the pour; it is not measured yet
    page.tick()
    assert "pouring" in told.object
    ticks(page, workers)
    assert ">segregated<" in told.object


def test_a_prediction_runs_only_what_is_poured(visit: tuple[Page, Later]) -> None:
    page, workers = visit
    ticks(page, workers)
    page.controls.mode.value = PREDICT
    page.controls.pattern.value = "layers"
    page.controls.knobs["angle_2"].value = 10.0
    page.tick()
    assert page.controls.run.disabled
    ticks(page, workers)
    assert not page.controls.run.disabled
    assert page.controls.numbers["continuum"].object.count(">hidden<") == 3


def test_a_pour_that_breaks_down_is_told_once_and_the_page_goes_on(
    visit: tuple[Page, Later], monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    page, workers = visit

    def broken(_: Experiment) -> Pours:
        raise ArithmeticError("no <sand>")

    with monkeypatch.context() as breaking:
        breaking.setattr(explore_page, "Pours", broken)
        ticks(page, workers)
    assert page.controls.complaint.visible
    assert "no &lt;sand&gt;" in page.controls.complaint.object
    assert len(caplog.records) == 1
    assert workers.asked == []
    page.controls.knobs["angle_2"].value = 10.0
    ticks(page, workers)
    assert not page.controls.complaint.visible
    assert page.desk.wanted is None


def test_what_rolls_lies_on_the_pile_small_grains_beneath_and_marks_where_they_are(
    pours: Pours,
) -> None:
    window, pile = Window(), pours.of["continuum"]
    window.fit([pile])
    shown = Pile(window, "continuum")
    shown.show(pile)
    share = next(one for one in np.linspace(0.5, 1, 50) if len(pile.at(one).kinks))
    moment = pile.at(share)
    shown.show_at(pile, moment, 0.0)
    drawn = {glyph.glyph: glyph.data_source.data for glyph in shown.figure.renderers}
    bands = {
        glyph.fill_color: data[glyph.y2] - data[glyph.y1]
        for glyph, data in drawn.items()
        if isinstance(glyph, VArea) and glyph.fill_color in (SMALL, LARGE)
    }
    assert shown.exaggeration > 1
    rolling = shown.exaggeration * moment.rolling
    np.testing.assert_allclose(bands[SMALL][1:-1], rolling[:, 0], atol=1e-12)
    np.testing.assert_allclose(bands[LARGE][1:-1], rolling.sum(axis=1), atol=1e-12)  # behind it
    marks = {
        glyph.marker: np.column_stack([data["x"], data["z"]])
        for glyph, data in drawn.items()
        if isinstance(glyph, Scatter)
    }
    np.testing.assert_array_equal(marks["triangle"], moment.kinks)
    np.testing.assert_array_equal(marks["circle"], moment.fronts)


def refused(*arguments: str) -> str:
    with pytest.raises(SetupError) as refusal:
        CliRunner().invoke(explore, arguments, catch_exceptions=False)
    assert "\n" not in str(refusal.value)
    return str(refusal.value)


def test_without_panel_the_command_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command, "find_spec", lambda _: None)
    assert "pip install 'stratify[explore]'" in refused("--no-browser")


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--address=127.0.0.1"], "nobody can listen there: address already in use; --address"),
        (["--address=203.0.113.7"], "--address 203.0.113.7 --port"),
    ],
)
def test_where_nobody_can_listen_is_one_line(arguments: list[str], named: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert named in refused("--no-browser", f"--port={port}", *arguments)
