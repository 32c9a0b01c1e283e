"""The command line as a user meets it: what it writes, and one clear line where it refuses."""

import json
import subprocess
from pathlib import Path

import pytest
import xarray as xr
from running import stratify

SHORT = [
    "--set=cell.length=20.0",
    "--set=pour.duration=200.0",
    "--set=pour.records=40",
    "--set=continuum.cells=40",
]


@pytest.fixture(scope="module")
def pours(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("work")
    done = stratify("pour", "makse-stratification", *SHORT, "-o", "pours/short", folder=folder)
    assert done.returncode == 0, done.stderr
    return folder


def test_presets_lists_and_prints_what_can_be_poured(tmp_path: Path) -> None:
    listed = stratify("presets", folder=tmp_path)
    assert "glass-sugar" in listed.stdout
    assert "Glass beads and sugar" in listed.stdout
    printed = stratify("presets", "glass-sugar", folder=tmp_path)
    (tmp_path / "mine.toml").write_text(printed.stdout)
    poured = stratify("pour", "mine.toml", *SHORT, folder=tmp_path)
    assert poured.returncode == 0, poured.stderr
    assert (tmp_path / "pours" / "mine" / "continuum.nc").exists()


def test_pour_writes_one_archive_a_model_and_nothing_else(pours: Path) -> None:
    for name in ("ca_model", "continuum"):
        with xr.open_dataset(pours / "pours" / "short" / f"{name}.nc") as archive:
            assert archive.attrs["model"] == name
    leftovers = [p for p in (pours / "pours" / "short").iterdir() if p.name.startswith(".")]
    assert leftovers == []


def test_pour_takes_one_model_when_told(tmp_path: Path) -> None:
    done = stratify(
        "pour", "glass-sugar", *SHORT, "--model", "ca_model", "-o", "out", folder=tmp_path
    )
    assert done.returncode == 0, done.stderr
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["ca_model.nc"]


def test_a_model_that_does_not_apply_says_so_and_the_other_pours(tmp_path: Path) -> None:
    quick = ["--set=pour.duration=50.0", "-o", "out"]
    done = stratify("pour", "lattice-stratification", *quick, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "continuum: does not apply: mixture.collision_rate: missing" in done.stdout
    alone = stratify(
        "pour", "lattice-stratification", "--model=continuum", "-o", "no", folder=tmp_path
    )
    assert alone.returncode == 2
    assert not (tmp_path / "no").exists()


@pytest.mark.parametrize(
    ("settings", "refusal", "pours"),
    [
        (["mixture.dispersion=0.1"], "ca_model: does not apply: mixture.disp", "continuum.nc"),
        (
            ["cell.shape=heap", "feed.source={time=[0.0, 9.0], x=[0.0, 9.0]}"],
            "continuum: does not apply: feed.source: the continuum's feed falls at x = 0",
            "ca_model.nc",
        ),
    ],
)
def test_a_pour_that_one_model_does_not_know_is_poured_by_the_other(
    tmp_path: Path, settings, refusal: str, pours: str
) -> None:
    options = [*SHORT, *(f"--set={setting}" for setting in settings), "-o", "out"]
    done = stratify("pour", "makse-stratification", *options, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert refusal in done.stdout
    assert [path.name for path in (tmp_path / "out").iterdir()] == [pours]


def test_compare_prints_a_table_and_writes_numbers_and_a_picture(pours: Path) -> None:
    done = stratify("compare", "pours/short", "--force", folder=pours)
    assert done.returncode == 0, done.stderr
    assert "kink velocity (cm/s)" in done.stdout
    with xr.open_dataset(pours / "pours" / "short" / "comparison.nc") as comparison:
        assert comparison["model_name"].values.tolist() == ["ca_model", "continuum"]
    assert (pours / "pours" / "short" / "comparison.png").stat().st_size > 10_000


def test_compare_prints_json_for_programs(pours: Path) -> None:
    done = stratify("compare", "pours/short", "--json", "--force", folder=pours)
    record = json.loads(done.stdout)["pours/short"]
    assert set(record) == {"title", "comment", "published", "ca_model", "continuum"}


def test_a_title_may_hold_any_characters(tmp_path: Path) -> None:
    """Neither the table nor the picture takes it for markup."""
    title = "[/x] costs $\\frac{ 3 $"
    options = [*SHORT, f"--set=title='{title}'", "--model=ca_model", "-o", "odd"]
    assert stratify("pour", "makse-stratification", *options, folder=tmp_path).returncode == 0
    done = stratify("compare", "odd", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "[/x] costs $" in done.stdout


def test_show_draws_one_archive(pours: Path) -> None:
    done = stratify("show", "pours/short/continuum.nc", "-o", "one.png", folder=pours)
    assert done.returncode == 0, done.stderr
    assert (pours / "one.png").stat().st_size > 10_000


@pytest.mark.parametrize("command", ["presets", "pour", "compare", "show"])
def test_every_command_has_help_with_an_example(command: str, tmp_path: Path) -> None:
    done = stratify(command, "--help", folder=tmp_path)
    assert f"Example: stratify {command}" in done.stdout


def refused(done: subprocess.CompletedProcess[str]) -> str:
    """The one line with which a command ended."""
    assert done.returncode == 2, done.stdout + done.stderr
    lines = done.stderr.splitlines()
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith("stratify: ")
    return lines[0]


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["pour", "sand"], "'sand': no such preset or file; presets: bcre"),
        (["pour", "gone.toml"], "'gone.toml' cannot be read: No such file"),
        (["pour", "glass-sugar", "--set=mixture.grain_diameter.0=-1.0"], "[0] = -1.0: it should"),
        (["pour", "glass-sugar", "--set=mixture.collision_rate=[[1.0]]"], "a 2 x 2 matrix"),
        (["pour", "glass-sugar", "--set=cell.length=nan"], "cell.length = nan"),
        (["pour", "glass-sugar", "--set=feed.inflow=[0.0,0.0]"], "feed.inflow = [0.0, 0.0]"),
        (["pour", "glass-sugar", "--set=continuum.cells=1"], "continuum.cells = 1"),
        (["pour", "glass-sugar", "--set=ca_model.contacts=0"], "ca_model.contacts"),
        (
            ["pour", "glass-sugar", "--model=ca_model", "--set=continuum.cels=3"],
            "continuum: no field 'cels'",
        ),
        (["pour", "lattice-stratification", "--set=continuum.cells=2.5"], "continuum.cells = 2.5"),
        (["pour", "glass-sugar", "--model=magic"], "'magic' is not one of"),
        (["pour"], "Missing argument 'SETUP'"),
        (["pour", "glass-sugar", "-o", "text.nc/out"], "folder 'text.nc/out' cannot be written"),
        (["show", ""], "no such archive"),
        (["stir"], "No such command 'stir'"),
        (["compare", "nowhere"], "'nowhere' holds no archive"),
        (["show", "nothing.nc"], "'nothing.nc': no such archive"),
        (["show", "text.nc"], "'text.nc' is not a whole netCDF-4 archive"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(arguments, named: str, tmp_path) -> None:
    (tmp_path / "text.nc").write_text("no archive")
    line = refused(stratify(*arguments, folder=tmp_path))
    assert named in line
    assert [path.name for path in tmp_path.iterdir()] == ["text.nc"]


def test_without_a_command_the_help_is_shown(tmp_path: Path) -> None:
    done = stratify(folder=tmp_path)
    assert done.returncode == 2
    assert len(done.stdout.splitlines()) > 10
    assert done.stderr == ""


def test_an_archive_cut_in_half_is_refused(pours: Path, tmp_path: Path) -> None:
    whole = (pours / "pours" / "short" / "continuum.nc").read_bytes()
    (tmp_path / "continuum.nc").write_bytes(whole[: len(whole) // 2])
    assert "not a whole netCDF-4 archive" in refused(stratify("compare", ".", folder=tmp_path))
    assert [path.name for path in tmp_path.iterdir()] == ["continuum.nc"]


@pytest.mark.parametrize("arguments", [["pour", "glass-sugar", "-o", "."], ["compare", "."]])
def test_an_existing_output_stays_without_force(arguments, tmp_path: Path) -> None:
    for name in ("continuum.nc", "comparison.nc"):
        (tmp_path / name).write_text("precious")
    assert "exists already; --force replaces it" in refused(stratify(*arguments, folder=tmp_path))
    assert {path.read_text() for path in tmp_path.iterdir()} == {"precious"}


def test_a_picture_format_that_is_none_is_refused(pours: Path) -> None:
    for name in ("picture.grain", "picture"):
        done = stratify("show", "pours/short/continuum.nc", "-o", name, folder=pours)
        assert f"'{name}' cannot be written: it should end in" in refused(done)


def test_a_comparison_predicts_ranges_beside_what_was_measured(pours: Path) -> None:
    """In the table, in JSON and in comparison.nc; the same numbers each time."""
    options = ["--vary=mixture.psi=0.2:0.3", "--draws=4", "--seeds=2", "--force"]
    told = stratify("compare", "pours/short", *options, folder=pours)
    assert told.returncode == 0, told.stderr
    assert "predicted: median, 16 to 84 %" in told.stdout
    assert "4 of 4" in told.stdout
    assert "chance has no part in it" in told.stdout
    assert "predicted from 4 draws (Latin hypercube) of mixture.psi 0.2 to 0.3" in told.stdout
    with xr.open_dataset(pours / "pours" / "short" / "comparison.nc") as comparison:
        predicted = comparison["predicted_wavelength"].load()
    assert predicted.dims == ("model", "quantile")
    assert predicted.attrs["units"] == "cm"
    assert (predicted.isel(model=0).diff("quantile") >= 0).all()
    record = json.loads(
        stratify("compare", "pours/short", *options, "--json", folder=pours).stdout
    )["pours/short"]["ca_model"]
    for quantile, value in record["predicted_wavelength"].items():
        assert value == float(predicted.isel(model=0).sel(quantile=float(quantile)))
    assert set(record["predicted_wavelength_follows"]) == {"mixture.psi"}


def test_seeds_average_over_piles_where_chance_matters(tmp_path: Path) -> None:
    drawn = "--set=ca_model.arrivals=drawn"
    stratify("pour", "makse-stratification", *SHORT, drawn, "-o", ".", folder=tmp_path)
    told = stratify("compare", ".", "--seeds=3", "--json", folder=tmp_path)
    record = json.loads(told.stdout)["."]
    assert record["ca_model"]["piles_kink_velocity_count"] <= 3
    assert record["ca_model"]["piles_wavelength_error"] > 0
    assert record["continuum"]["piles_wavelength"] is None


@pytest.mark.parametrize(
    ("option", "named"),
    [
        ("--vary=mixture.psi", "--vary 'mixture.psi': it should be KEY=LOW:HIGH"),
        ("--vary=mixture.psi=0.3:0.1", "[0.3, 0.1]: the first should be less than the second"),
        ("--vary=mixture.psi=0.1:9.0", "mixture.psi = 9: it makes a repose slope"),
        ("--vary=mixture.sy=0.1:0.3", "mixture: no field 'sy'; allowed"),
        ("--draws=-1", "-1 is not in the range"),
    ],
)
def test_a_range_that_cannot_be_is_one_line_and_nothing_is_written(pours, option, named) -> None:
    before = {path: path.stat().st_mtime_ns for path in (pours / "pours" / "short").iterdir()}
    assert named in refused(stratify("compare", "pours/short", option, "--force", folder=pours))
    after = {path: path.stat().st_mtime_ns for path in (pours / "pours" / "short").iterdir()}
    assert after == before
