"""What a set-up promises: it says what it means, survives TOML, and refuses nonsense by name."""

import math
from pathlib import Path

import numpy as np
import pytest

from experiment import (
    Experiment,
    Mixture,
    SetupError,
    load,
    preset_names,
    two_species_slopes,
)

GRAINS = {"names": ["small", "large"], "grain_diameter": [0.1, 0.2], "drift_velocity": 1.0}


def test_presets_are_those_of_the_design() -> None:
    assert set(preset_names()) >= {
        "glass-sugar",
        "lattice-segregation",
        "lattice-stratification",
        "makse-profile",
        "makse-segregation",
        "makse-stratification",
    }


@pytest.mark.parametrize("name", preset_names())
def test_a_set_up_survives_toml(name: str) -> None:
    experiment = load(name)
    assert Experiment.from_toml(experiment.to_toml()) == experiment


def test_section_v_has_the_papers_numbers() -> None:
    mixture = load("makse-stratification").mixture
    assert mixture.repose_slope == pytest.approx(np.array([[1.0, 1.55], [0.7, 1.25]]))
    assert mixture.collision_rate == ((1.0, 0.1), (0.1, 1.0))
    assert (mixture.psi, mixture.delta) == pytest.approx((0.3, 0.25))
    assert load("makse-segregation").mixture.delta == pytest.approx(-0.1)


def test_glass_and_sugar_have_their_measured_angles_and_mean_diameter() -> None:
    mixture = load("glass-sugar").mixture
    assert mixture.repose_slope[0][0] == pytest.approx(math.tan(math.radians(26)))
    assert mixture.repose_slope[1][1] == pytest.approx(math.tan(math.radians(39)))
    assert mixture.psi == pytest.approx(0.3)
    assert mixture.surface_depth == mixture.curvature_length == pytest.approx(0.0535)


def test_one_mixture_may_be_said_in_three_ways() -> None:
    slopes = two_species_slopes(0.6, 0.2, -0.1)
    by_matrix = Mixture.parse({"repose_slope": slopes, **GRAINS})
    by_parameters = Mixture.two_species(0.6, 0.2, -0.1, **GRAINS)
    angles = [[math.degrees(math.atan(slope)) for slope in row] for row in slopes]
    by_degrees = Mixture.from_degrees(angles, **GRAINS)
    assert by_matrix == by_parameters
    assert by_degrees.repose_slope == pytest.approx(np.array(slopes))


def test_changing_delta_of_a_matrix_keeps_psi_and_the_difference_of_m1_and_m2() -> None:
    matrix = {"repose_slope": [[1.0, 1.7], [0.7, 1.25]], **GRAINS}
    changed = Mixture.parse({**matrix, "delta": 0.1})
    assert (changed.psi, changed.delta) == pytest.approx((0.3, 0.1))
    (t11, t12), (t21, t22) = changed.repose_slope
    assert (t12 - t11) - (t22 - t21) == pytest.approx(0.7 - 0.55)


def test_three_species_need_no_special_words() -> None:
    mixture = Mixture.parse(
        {
            "names": ["a", "b", "c"],
            "grain_diameter": [0.3, 0.1, 0.2],
            "drift_velocity": [1.0, 2.0, 3.0],
            "repose_slope": [[0.5] * 3] * 3,
        }
    )
    assert (mixture.species, mixture.smallest) == (3, 1)
    assert mixture.surface_depth == pytest.approx(0.2)


def test_a_setting_changes_one_field_and_nothing_else() -> None:
    changed = load("makse-stratification", ["mixture.delta=0.1", "feed.inflow.1=0.25"])
    assert changed.mixture.delta == pytest.approx(0.1)
    assert changed.feed.inflow == (0.5, 0.25)
    assert changed.cell == load("makse-stratification").cell


@pytest.mark.parametrize(
    ("setting", "named"),
    [
        ("mixture.grain_diameter.1=-0.1", "mixture.grain_diameter[1] = -0.1"),
        ("mixture.grain_diameter=[0.1]", "mixture.grain_diameter = [0.1]: it should have 2"),
        ("mixture.grain_diameter=[]", "mixture.grain_diameter = []"),
        ("mixture.drift_velocity=0.0", "mixture.drift_velocity[0] = 0.0"),
        ("mixture.delta=nan", "mixture.delta = nan"),
        ("mixture.delta='steep'", "mixture.delta = 'steep'"),
        ("mixture.psi=3.0", "mixture.psi = 3: it makes a repose slope of -2"),
        ("mixture.repose_slope=3", "mixture.repose_slope = 3"),
        ("mixture.grain_diameter.²=1.0", "there is no '²'"),
        (f"mixture.theta_11=1{'0' * 400}", "mixture.theta_11 = 1000"),
        ("pour.duration=1e308", "pour.duration = 1e+308"),
        ("mixture.collision_rate=[[1.0, 0.1]]", "mixture.collision_rate = [[1.0, 0.1]]"),
        ("mixture.collision_rate=[[1.0, nan], [0.1, 1.0]]", "mixture.collision_rate[0][1] = nan"),
        ("mixture.collision_rate=[[0.0, 1.0], [0.1, 1.0]]", "mixture.collision_rate[0][0] = 0"),
        ("mixture.cross_amplification=[[1.0, 0.0], [0.0, 0.0]]", "mixture.cross_amplification[0]"),
        ("mixture.names=['a', 'a']", "mixture.names = ['a', 'a']"),
        ("mixture.smoothing=-1.0", "mixture.smoothing = -1.0"),
        ("mixture.surface_depth=0.0", "mixture.surface_depth = 0.0"),
        ("mixture.colour=1", "no field 'colour'; allowed: collision_rate"),
        ("cell.length=inf", "cell.length = inf"),
        ("cell.start_slope=-1.0", "cell.start_slope = -1.0"),
        ("cell.start_composition=[0.5, 0.6]", "cell.start_composition = [0.5, 0.6]"),
        ("feed.inflow=[0.0, 0.0]", "feed.inflow = [0.0, 0.0]"),
        ("feed.inflow=[1.0]", "feed.inflow = [1.0]: it should have 2"),
        ("pour.duration=true", "pour.duration = True"),
        ("pour.records=0", "pour.records = 0"),
        ("pour.seed=-1", "pour.seed = -1"),
        ("tilt=1", "no field 'tilt'; allowed: ca_model"),
        ("mixture.names.7=x", "mixture.names.7: there is no '7'"),
        ("mixture.delta", "it should be KEY=VALUE"),
    ],
)
def test_nonsense_is_refused_by_name_value_and_what_is_allowed(setting: str, named: str) -> None:
    with pytest.raises(SetupError) as refusal:
        load("makse-stratification", [setting])
    assert named in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    "angles", [[26.0, 39.0, 40.0], [26.0, 95.0], ["a", 3.0], 3.0, [[1.0], 2.0]]
)
def test_angles_that_are_none_are_refused(angles: object) -> None:
    with pytest.raises(SetupError, match="repose_angle"):
        Mixture.from_degrees(angles, psi=0.3, **GRAINS)


def test_slopes_and_angles_together_are_refused() -> None:
    with pytest.raises(SetupError, match="both given"):
        Mixture.from_degrees([[1.0] * 2] * 2, repose_slope=[[1.0] * 2] * 2, **GRAINS)


def test_a_missing_field_is_named() -> None:
    with pytest.raises(SetupError, match=r"mixture\.repose_slope: missing"):
        Mixture.parse(GRAINS, "mixture")
    with pytest.raises(SetupError, match=r"^mixture\.delta: missing"):
        Mixture.parse({"theta_11": 1.0, "psi": 0.1, **GRAINS}, "mixture")


def test_an_unknown_preset_names_the_presets() -> None:
    with pytest.raises(SetupError, match=r"'sand': no such preset or file; presets: .*glass-sugar"):
        load("sand")


def test_a_file_that_is_no_toml_or_not_there_is_refused(tmp_path: Path) -> None:
    (tmp_path / "torn.toml").write_text("[mixture\n")
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(SetupError, match="is not TOML"):
        load(str(tmp_path / "torn.toml"))
    with pytest.raises(SetupError, match="cannot be read"):
        load(str(tmp_path / "bytes.toml"))
    with pytest.raises(SetupError, match="cannot be read: No such file"):
        load(str(tmp_path / "gone.toml"))
