"""The paper's figures: what they show is what the equations and the pours say."""

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from running import stratify

from compare.cli import main
from compare.pictures import save
from compare.pictures.paper import FIGURES
from compare.pictures.paper.angles import draw_repose_angles, repose_angles
from compare.pictures.paper.functions import (
    FUNCTIONS,
    collision_functions,
    draw_collision_functions,
)
from compare.pictures.paper.onset import onset
from compare.pictures.paper.phase import psi_of, ratio_of, regimes_over_size_and_shape
from compare.pictures.paper.profiles import LABELS, draw_profiles, profiles
from experiment import ArchiveError


def test_angles_are_the_straight_lines_of_the_paper() -> None:
    """theta_1 = m phi_2 + theta_11, theta_2 = m phi_2 + theta_21, psi apart at every phi_2."""
    found = repose_angles()
    phi_2 = found["phi_2"].values
    assert found["delta"].values == pytest.approx([0.25, -0.1])
    for delta, of in zip((0.25, -0.1), found["generalised_repose_slope"].values, strict=True):
        m = delta + 0.3
        np.testing.assert_allclose(of, [1.0 + m * phi_2, 0.7 + m * phi_2], rtol=1e-14)
    ends = [[[1.0, 1.55], [0.7, 1.25]], [[1.0, 1.2], [0.7, 0.9]]]
    np.testing.assert_allclose(found["repose_slope"].values, ends, rtol=1e-14)


def test_functions_are_sharp_or_bend_over_their_smoothing() -> None:
    """gamma = 20/s, gamma_12 = gamma_21 = 10/s; theta_1 = 0.65, theta_2 = 0.45 on equal shares."""
    found = collision_functions()
    assert found["generalised_repose_slope"].values == pytest.approx([0.65, 0.45])
    sharp, smooth = found.isel(form=0), found.isel(form=1)
    at = sharp.interp(theta=[0.35, 0.55, 0.75])
    np.testing.assert_allclose(at["capture"], [[6.0, 2.0, 0.0], [2.0, 0.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(at["amplification"], [[0, 0, 2.0], [0, 2.0, 6.0]], atol=1e-12)
    np.testing.assert_allclose(at["cross_amplification"], [[0, 0, 1.0], [0, 1.0, 3.0]], atol=1e-12)
    bent = 20.0 * float(smooth["smoothing"]) / 2
    for k, repose in enumerate((0.65, 0.45)):
        there = smooth.isel(species=k).sel(theta=repose, method="nearest")
        assert float(there["capture"]) == pytest.approx(bent, rel=0.1)
        assert float(there["amplification"]) == pytest.approx(bent, rel=0.1)
        assert float(there["cross_amplification"]) == pytest.approx(bent / 2, rel=0.1)


@pytest.fixture(scope="module")
def steady() -> xr.Dataset:
    return profiles()


def test_profiles_have_the_numbers_of_the_full_closed_form(steady: xr.Dataset) -> None:
    full = steady.isel(solution=0)
    assert steady.attrs["middle_cm"] == pytest.approx(12.5)
    slope = full["slope"].interp(x=[0.0, 12.4999, 12.5001])
    assert slope.values == pytest.approx([0.5111, 0.4, 0.4], abs=1e-4)
    phi_1 = full["surface_fraction"].isel(species=0).interp(x=[15.0, 17.5, 20.0, 25.0])
    assert phi_1.values == pytest.approx([0.3844, 0.1299, 0.0409, 0.0034], abs=5e-5)


def test_the_simplified_profile_is_the_papers_and_off_by_r_over_l(steady: xr.Dataset) -> None:
    simplified = steady.isel(solution=1)
    phi_1 = simplified["surface_fraction"].isel(species=0).interp(x=[15.0, 20.0, 25.0])
    assert phi_1.values == pytest.approx([0.3679, 0.0498, 0.0067], abs=5e-5)


def test_the_pile_of_the_profiles_has_their_slope(steady: xr.Dataset) -> None:
    """In region A the height is known: theta_11 x + b ln(1 - x / a), from Eq. (theta1)."""
    x = np.array([3.0, 6.0, 12.0])
    a, b = 30.0 * 0.75, 0.5 + 0.2 * 0.5 * 15.0
    known = -(0.6 * x + b * np.log(1.0 - x / a))
    height = steady["height"].isel(solution=0).interp(x=x)
    np.testing.assert_allclose(height, known, rtol=1e-6)


def test_the_solvers_points_lie_on_the_profiles(steady: xr.Dataset) -> None:
    full = steady.isel(solution=0)
    inside = steady["cell_edge"].values < 25.0
    edge, middle = steady["cell_edge"].values[inside], steady["cell_middle"].values[inside]
    for name, x, error in (
        ("rolling_thickness", edge, 1e-6),
        ("surface_fraction", middle, 1e-3),
        ("slope", edge, 2e-3),
        ("height", middle, 0.01),
    ):
        solved = steady[f"solved_{name}"].values[inside]
        assert np.abs(full[name].interp(x=x).values - solved).max() < error, name


def test_the_lines_that_are_drawn_are_the_data(steady: xr.Dataset) -> None:
    """Thick ones of the rolling grains, and of the full solution, in the caption's order."""
    angles, functions = repose_angles(), collision_functions()
    panels = {
        "angles": (draw_repose_angles(angles), angles["generalised_repose_slope"].values, 1.8),
        "functions": (
            draw_collision_functions(functions),
            np.stack([functions[n].isel(form=0) for n in FUNCTIONS], axis=1),
            2.0,
        ),
        "profiles": (
            draw_profiles(steady),
            [np.atleast_2d(steady[n].isel(solution=0).values.T) for n in LABELS],
            1.6,
        ),
    }
    for name, (figure, wanted, thick) in panels.items():
        for axes, data in zip(figure.axes, wanted, strict=True):
            lines = [line for line in axes.lines if line.get_linewidth() == thick]
            drawn = [line.get_ydata() for line in lines if len(line.get_xdata())]
            np.testing.assert_array_equal(drawn, data, err_msg=name)


@pytest.fixture(scope="module")
def begun() -> xr.Dataset:
    return onset()


def test_a_kink_climbs_where_large_grains_are_rougher_and_none_where_rounder(begun) -> None:
    stratified, segregated = begun.isel(mixture=0), begun.isel(mixture=1)
    assert (float(stratified["delta"]), float(segregated["delta"])) == pytest.approx((0.25, -0.1))
    assert int(stratified["kink_count"]) >= 3
    assert -1.0 < float(stratified["kink_velocity"]) < -0.3
    assert int(segregated["kink_count"]) == 0
    assert np.isfinite(stratified["kink"].sel(time=[710.0, 1480.0])).all()
    assert np.isnan(segregated["kink"]).all()


def highest_large_grains(begun: xr.Dataset, mixture: int, time: float) -> float:
    """Where, going down, the surface first is of large grains [cm]."""
    at = begun.isel(mixture=mixture).sel(time=time)
    top = (at["coarseness"].notnull().sum("z") - 1).clip(min=0)
    large = at["coarseness"].isel(z=top).values > 0.5
    return float(at["x"][large.argmax()])


def test_both_mixtures_begin_segregated_and_with_a_patch_on_the_upper_half(begun) -> None:
    """At first large grains lie lowest; then a patch climbs, to the top for delta > 0 only."""
    for mixture in (0, 1):
        assert highest_large_grains(begun, mixture, 180.0) > 40.0
        assert highest_large_grains(begun, mixture, 260.0) < 45.0
    assert highest_large_grains(begun, 0, 260.0) < 15.0 < highest_large_grains(begun, 1, 260.0)


def test_the_patch_recedes_and_segregation_stays_where_large_grains_are_rounder(begun) -> None:
    places = [highest_large_grains(begun, 1, time) for time in (260.0, 400.0, 710.0, 1480.0)]
    assert min(places) > 20.0
    assert places[1] < places[2] < places[3]
    assert 45.0 < places[3] < 55.0


def test_layers_lie_one_above_the_other_where_kinks_climbed(begun) -> None:
    """Half-way down, large and small grains alternate; for delta < 0 they do not."""
    last = begun.sel(time=1480.0).sel(x=30.0, method="nearest")["coarseness"]
    changes = [int(np.abs(np.diff(column.dropna("z") > 0.5)).sum()) for column in last]
    assert changes[0] >= 6
    assert changes[1] <= 2


def test_psi_comes_from_the_hollow_between_two_disks() -> None:
    """It vanishes for equal grains, grows with the ratio, and gives back the ratio."""
    assert psi_of(1.0) == pytest.approx(0.0, abs=1e-15)
    for ratio in (1.1, 2.0, 3.0):
        slope = np.tan(np.arcsin(1.0 / (1.0 + ratio)))
        assert psi_of(ratio) == pytest.approx(np.tan(np.pi / 6) - slope)
        assert ratio_of(psi_of(ratio)) == pytest.approx(ratio)


def test_regimes_are_those_of_the_phase_diagram() -> None:
    """Layers for delta > 0, segregation for delta < 0, and weaker where sizes are alike."""
    found = regimes_over_size_and_shape((1.1, 2.0, 2.8), (-0.2, 0.2), workers=1)
    rounder, rougher = found.sel(delta=-0.2), found.sel(delta=0.2)
    assert rougher["regime"].values[1:].tolist() == ["stratified"] * 2
    assert rounder["regime"].values.tolist() == ["mixed", "segregated", "segregated"]
    alike, *unlike = rounder["segregation"].values
    assert alike < 0.4
    assert min(unlike) > 0.75
    assert found["deposit"].dims == ("example", "row", "column")
    layered, *others = (float(abs(d.diff("row")).mean()) for d in found["deposit"])
    assert layered > 4 * max(others)


Command = Callable[..., tuple[int, str]]


@pytest.fixture
def figure(monkeypatch, capsys) -> Command:
    """The command as a user gives it, in this process: its exit status and what it says."""

    def run(*arguments: str | Path) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["stratify", "figure", *map(str, arguments)])
        try:
            main()
        except SystemExit as end:
            return int(end.code or 0), capsys.readouterr().err
        return 0, capsys.readouterr().err

    return run


def test_the_command_draws_in_two_formats_the_same_bytes_each_time(
    tmp_path: Path, figure: Command
) -> None:
    """In another process, too."""
    for name in ("angles", "functions", "profiles"):
        assert figure(name, "-o", tmp_path / "once") == (0, "")
    done = stratify("figure", "profiles", "-o", "again", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    names = [f"{name}.{kind}" for name in ("angles", "functions") for kind in ("pdf", "png")]
    files = sorted(path.name for path in (tmp_path / "once").iterdir())
    assert files == [*names, "profiles.pdf", "profiles.png"]
    for name, begin in (("profiles.pdf", b"%PDF"), ("profiles.png", b"\x89PNG")):
        content = (tmp_path / "once" / name).read_bytes()
        assert content.startswith(begin)
        assert content == (tmp_path / "again" / name).read_bytes()


def test_the_command_writes_what_is_drawn_when_told(tmp_path: Path, figure: Command) -> None:
    assert figure("angles", "-o", tmp_path, "--data") == (0, "")
    with xr.open_dataset(tmp_path / "angles.nc") as data:
        xr.testing.assert_allclose(data.load(), repose_angles())
        assert data.attrs["Conventions"] == "CF-1.11"
        assert all("long_name" in data[name].attrs for name in data.variables)


def test_the_command_replaces_nothing_unless_told(tmp_path: Path, figure: Command) -> None:
    """Not even half: one of its files is there already, and it writes none."""
    (tmp_path / "angles.png").write_text("mine")
    status, said = figure("angles", "-o", tmp_path)
    assert status == 2
    assert "angles.png' exists already; --force replaces it" in said
    assert [path.name for path in tmp_path.iterdir()] == ["angles.png"]
    assert figure("angles", "-o", tmp_path, "--force") == (0, "")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["angles.pdf", "angles.png"]
    assert (tmp_path / "angles.png").read_bytes() != b"mine"


def test_the_command_writes_all_or_nothing(tmp_path: Path, figure: Command, monkeypatch) -> None:
    """The second file cannot be written: the first is not there either."""

    def write(drawn, path: Path, *, force: bool) -> Path:
        if path.suffix == ".png":
            raise ArchiveError("no room")
        return save(drawn, path, force=force)

    monkeypatch.setattr("compare.cli.figure.save", write)
    assert figure("angles", "-o", tmp_path) == (2, "stratify: no room\n")
    assert list(tmp_path.iterdir()) == []


def test_the_command_names_its_figures_where_it_knows_none(figure: Command) -> None:
    status, said = figure("kinks")
    assert status == 2
    assert said.count("\n") == 1
    assert all(name in said for name in FIGURES)


def test_the_command_says_where_it_cannot_write(tmp_path: Path, figure: Command) -> None:
    (tmp_path / "file").write_text("")
    status, said = figure("angles", "-o", tmp_path / "file")
    assert status == 2
    assert said.count("\n") == 1
    assert "cannot be written" in said


def test_a_folder_of_its_name_is_seen_before_the_work_begins(
    tmp_path: Path, figure: Command, monkeypatch
) -> None:
    def work(_: object) -> xr.Dataset:
        raise AssertionError

    monkeypatch.setitem(FIGURES, "phase", FIGURES["phase"]._replace(data=work))
    (tmp_path / "phase.png").mkdir()
    status, said = figure("phase", "-o", tmp_path, "--force")
    assert (status, said.count("\n")) == (2, 1)
    assert "phase.png' cannot be written: it is a folder" in said
