"""Real grains: what a lattice grain stands for, and that smaller ones lie more regularly."""

import numpy as np
import pytest

from ca_model.lattice import RateRule, lattice_of
from compare.bridge.grains import SIZES, grains, grains_table, mean_volume, poured_as
from compare.bridge.irregular import kink_scatter
from compare.kymograph.cycles import Seen
from experiment import load

BY_NAME = {size.name: size for size in SIZES}


def seen(velocity: list[float], error: float) -> Seen:
    """Kinks of these velocities."""
    many = len(velocity)
    return Seen(np.zeros((many, 1)), np.array(velocity), np.full(many, error), 0.0, False)


def test_a_grain_of_the_default_lattice_is_a_slab_of_hundreds_of_beads() -> None:
    bead, cube = BY_NAME["true"].volume
    assert bead == pytest.approx(3.435e-5, rel=1e-3)
    assert cube == pytest.approx(1.7067e-3, rel=1e-3)
    slab = BY_NAME["slab, 10 d x d"].volume
    assert slab[0] / bead == pytest.approx(212, abs=1)
    assert slab[1] / cube == pytest.approx(12.7, abs=0.1)


@pytest.mark.parametrize("name", ["true", "true, w / 2", "row, d x d", "slab, 10 d x d"])
def test_grains_have_the_volume_that_they_are_said_to_have(name: str) -> None:
    size = BY_NAME[name]
    lattice = lattice_of(poured_as(size, 60.0))
    assert lattice.grain_volume == pytest.approx(np.array(size.volume), rel=0.02)
    assert lattice.column_width == size.width
    assert isinstance(lattice.rule, RateRule)
    assert lattice.rule.depth * lattice.unit == pytest.approx(0.0535, abs=lattice.unit / 2)
    assert lattice.rule.law.curvature_length == pytest.approx(0.0535)


def test_the_preset_of_real_grains_pours_them() -> None:
    preset, true = load("glass-sugar-grains"), poured_as(BY_NAME["true"], 180.0)
    assert preset.mixture.grain_diameter == pytest.approx(true.mixture.grain_diameter, rel=1e-4)
    assert preset.cell == true.cell
    assert preset.feed == true.feed
    diameters = {"mixture.grain_diameter": true.mixture.grain_diameter}
    assert preset.with_values(diameters).mixture == true.mixture
    assert lattice_of(preset).grain_volume == pytest.approx(BY_NAME["true"].volume, rel=0.02)


def test_kinks_scatter_by_what_their_errors_do_not_tell() -> None:
    scattered = np.random.default_rng(5).normal(3.0, 0.3, 4000).tolist()
    assert kink_scatter(seen(scattered, 0.0)) == pytest.approx(0.1, rel=0.05)
    assert kink_scatter(seen(scattered, 0.24)) == pytest.approx(0.06, rel=0.1)
    assert kink_scatter(seen(scattered, 1.0)) == 0.0
    assert kink_scatter(seen([*scattered[:50], 900.0], 0.0)) < 0.15, "one that is broken"
    assert np.isnan(kink_scatter(seen([3.0, np.nan], 0.1)))


def test_smaller_grains_lay_more_regular_layers() -> None:
    sizes = tuple(BY_NAME[name] for name in ("continuum, dx = w", "sugar of 3 beads", "true"))
    found = grains(2, 1, lambda _: None, sizes=sizes, duration=240.0, drawn=2)
    scatter = found["layer_scatter"].values[1:]
    assert scatter[0] < 0.6 * scatter[1]
    assert 0.02 < scatter[1] < 0.12
    assert (found["layered"] == 1).all()
    fewer_beads = mean_volume(sizes[2]) / mean_volume(sizes[1])
    exponent = np.log(scatter[1] / scatter[0]) / np.log(fewer_beads)
    assert found["layer_scatter_exponent"].item() == pytest.approx(exponent)
    assert np.isfinite(found["deposit"].values).any(axis=(1, 2)).all()
    assert np.isfinite(found["wavelength_pile"].values).sum(axis=1).tolist() == [1, 2, 2]
    assert grains_table(found).row_count == len(sizes)
