"""Between the rules: the ladder's rungs are what they say, and its end is the threshold rule."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import ca_model
from compare.bridge.between import (
    CORNERS,
    FACTORS,
    between,
    between_table,
    effects,
    ladder,
    lattice,
    set_up,
    sharpened,
)
from compare.convergence import QUANTITIES
from experiment import Experiment

SHORT = 600.0  # s
STEPS = (
    {"ca_model.contacts"},
    {"ca_model.contacts", "mixture.grain_diameter"},
    {"mixture.surface_depth"},
    {"ca_model.amplification"},
    {"ca_model.sharpness"},
)


def fields(experiment: Experiment) -> dict[str, Any]:
    """Every field by its path."""
    tables = experiment.model_dump(exclude_none=True)
    return {
        f"{table}.{field}": value
        for table, there in tables.items()
        if isinstance(there, dict)
        for field, value in there.items()
    }


def changed(one: Experiment, other: Experiment) -> set[str]:
    """The fields in which two set-ups are not alike."""
    here, there = fields(one), fields(other)
    return {key for key in here | there if here.get(key) != there.get(key)}


def same_grains(one: Experiment, other: Experiment) -> bool:
    """Whether two pours of the lattice are the same to the last grain, at all times."""
    here, there = ca_model.pour(one), ca_model.pour(other)
    names = ("height", "rolling_thickness", "deposit_fraction")
    return all(np.array_equal(here[name], there[name], equal_nan=True) for name in names)


def test_every_rung_of_the_lattice_changes_one_thing() -> None:
    rungs = ladder(set_up(SHORT), 16)[2:-1]
    assert [changed(*pair) for pair in pairwise(rungs)] == list(STEPS)


def test_what_touches_the_pile_is_as_thick_whatever_the_grains() -> None:
    base = set_up(SHORT)
    fine, whole = lattice(base, 16), lattice(base, 16, whole=True)
    touching = [
        setup.ca_model["contacts"] * setup.mixture.grain_diameter[0] for setup in (fine, whole)
    ]
    assert touching[0] == pytest.approx(touching[1])


def test_the_ladder_and_the_path_end_at_the_threshold_rule_grain_for_grain() -> None:
    base = set_up(SHORT)
    *_, last_rung, threshold_rule = ladder(base, 16)
    assert threshold_rule.ca_model.get("rule", "threshold") == "threshold"
    assert same_grains(last_rung, threshold_rule)
    assert same_grains(sharpened(base, 1e5, "none"), threshold_rule)


@pytest.mark.parametrize(("k", "amplified"), [(10.0, "none"), (1e5, "all")])
def test_capture_that_is_not_sharp_and_grains_that_are_set_rolling_are_not_the_threshold_rule(
    k: float, amplified: str
) -> None:
    base = set_up(SHORT)
    assert not same_grains(sharpened(base, k, amplified), ladder(base, 16)[-1])


def test_changes_that_do_not_depend_on_each_other_are_found_in_any_order() -> None:
    by = np.array([2.0, 0.5, 1.1, 0.2])
    values = np.array([np.prod(by[list(corner)]) for corner in CORNERS]).reshape((2,) * 4)
    found, errors = effects(values, 0.01 * values)
    assert found == pytest.approx(np.repeat(100 * (by - 1), 3).reshape(4, 3))
    first = 100 * by * 0.01 * math.sqrt(2)
    assert errors[:, 0] == pytest.approx(first)
    assert (errors[:, 1] < errors[:, 0]).all(), "a mean over orders is the more certain"


def test_mean_changes_make_up_the_whole_where_changes_depend_on_each_other() -> None:
    values = np.random.default_rng(1).uniform(0.5, 2.0, (2,) * 4)
    found, _ = effects(values, 0.0 * values)
    whole = values[1, 1, 1, 1] / values[0, 0, 0, 0]
    assert np.prod(1 + found[:, 1] / 100) == pytest.approx(whole)
    assert np.prod(1 + found[:, 0] / 100) != pytest.approx(whole)
    assert found[0, 0] == pytest.approx(100 * (values[1, 0, 0, 0] / values[0, 0, 0, 0] - 1))
    assert found[3, 2] == pytest.approx(100 * (values[1, 1, 1, 1] / values[1, 1, 1, 0] - 1))


def test_a_small_study_tells_what_thresholds_change() -> None:
    shares: list[float] = []
    found = between(
        1, 1, shares.append, fineness=2, sharpness=(1e5,), rates=(1.0,), duration=12_000.0
    )
    thresholds, rule = found.sel(rung="thresholds"), found.sel(rung="threshold rule")
    for name in QUANTITIES:
        assert thresholds[name].item() == rule[name].item()
        assert found[f"path_{name}"].sel(amplified="none", k=1e5).item() == rule[name].item()
    effect = found["effect_wavelength"].sel(factor="capture")
    assert (effect < -40).all(), "layers by thresholds are thinner by far"
    assert shares[-1] == 1.0
    told = between_table(found)
    assert told.row_count == found.sizes["rung"] + 3 * len(FACTORS)
