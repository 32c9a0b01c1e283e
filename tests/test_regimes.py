"""Regimes, held against pours that were labelled by eye: tests/labelled and its pictures."""

from collections import Counter
from typing import Any

import numpy as np
import pytest
from labelled.draw import pour_run, read_runs

from compare import measure

WORDS = ("stratified", "segregated", "mixed", "layered-and-segregated")

Runs = list[dict[str, Any]]


@pytest.fixture(scope="module")
def judged() -> Runs:
    """Each labelled run with its numbers."""
    return [run | {"found": measure(pour_run(run))} for run in read_runs()]


def certain(runs: Runs) -> Runs:
    return [run for run in runs if run["certain"]]


def number(run: dict[str, Any], name: str) -> float:
    return float(run["found"][name])


def test_the_set_is_large_and_has_every_word_in_both_models(judged: Runs) -> None:
    assert len(certain(judged)) >= 60
    counts = Counter((run["model"], run["label"]) for run in certain(judged))
    assert min(counts[model, word] for model in ("ca_model", "continuum") for word in WORDS) >= 5


def test_every_pour_whose_picture_is_clear_is_given_its_label(judged: Runs) -> None:
    wrong = {
        run["index"]: (run["label"], run["found"]["regime"].item())
        for run in certain(judged)
        if run["found"]["regime"].item() != run["label"]
    }
    assert not wrong


def test_of_pours_whose_picture_is_doubtful_most_are_given_their_label(judged: Runs) -> None:
    doubtful = [run for run in judged if not run["certain"]]
    right = [run["found"]["regime"].item() == run["label"] for run in doubtful]
    assert np.mean(right) > 0.6


def test_no_clear_picture_lies_close_to_a_threshold(judged: Runs) -> None:
    """What was read off this set leaves room for the next one."""
    for name, low, high in (("layered_share", 0.13, 0.25), ("segregation", 0.47, 0.55)):
        between = [run["index"] for run in certain(judged) if low < number(run, name) < high]
        assert not between, name


def test_thresholds_read_off_one_half_of_the_set_hold_in_the_other(judged: Runs) -> None:
    """The middle of the gap between the words, over 50 random halves: 98 % are right."""
    random = np.random.default_rng(0)
    runs = np.array(certain(judged), dtype=object)
    right = []
    for _ in range(50):
        shuffled = random.permutation(runs)
        known, others = shuffled[::2], shuffled[1::2]
        for name, words in (
            ("layered_share", ("stratified", "layered-and-segregated")),
            ("segregation", ("segregated", "layered-and-segregated")),
        ):
            inside = [number(run, name) for run in known if run["label"] in words]
            outside = [number(run, name) for run in known if run["label"] not in words]
            threshold = (min(inside) + max(outside)) / 2
            right += [(number(run, name) > threshold) == (run["label"] in words) for run in others]
    assert np.mean(right) > 0.98


def test_the_numbers_stand_beside_the_word(judged: Runs) -> None:
    for run in judged:
        for name in ("layering", "layered_share", "segregation", "pure_share"):
            assert 0.0 <= number(run, name) <= 1.05


def test_layers_are_measured_where_the_word_says_there_are_some(judged: Runs) -> None:
    for run in certain(judged):
        there = run["label"] in ("stratified", "layered-and-segregated")
        assert np.isfinite(number(run, "wavelength")) == there, run["index"]
