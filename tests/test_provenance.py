"""What an archive says of its making, and that it can be made again from that alone."""

from pathlib import Path

import pytest
from running import stratify

import ca_model
import continuum
from experiment import Experiment, load
from experiment.archive import read, write
from experiment.archive.provenance import difference, stamp
from experiment.archive.storage import content_of

SMALL = ["cell.length=20.0", "pour.duration=50.0", "pour.records=10", "continuum.cells=30"]


def poured(folder: Path, *settings: str) -> Path:
    random = ["ca_model.arrivals=poisson", "pour.seed=7", "ca_model.contacts=2"]
    experiment = load("makse-stratification", [*SMALL, *random, *settings])
    return write(ca_model.pour(experiment), folder / "run.nc")


def test_an_archive_is_poured_again_from_itself_bit_for_bit(tmp_path: Path) -> None:
    path = poured(tmp_path)
    done = stratify("pour", "run.nc", "-o", "again", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "ca_model: it holds what run.nc holds, bit for bit" in done.stdout
    again = tmp_path / "again" / "ca_model.nc"
    assert list((tmp_path / "again").iterdir()) == [again], "by the model that it is of"
    assert content_of(again) == content_of(path)


def test_what_comes_out_otherwise_than_an_archive_is_told(tmp_path: Path) -> None:
    archive = read(poured(tmp_path)).assign_attrs(source="ca_model of stratify 0.0.9")
    write(archive, tmp_path / "older.nc")
    done = stratify("pour", "older.nc", "-o", "again", folder=tmp_path)
    assert "it differs from older.nc, which is by ca_model of stratify 0.0.9" in done.stdout


def test_an_archive_that_is_poured_over_itself_is_compared_with_what_it_was(tmp_path: Path) -> None:
    archive = read(poured(tmp_path)).assign_attrs(source="ca_model of stratify 0.0.9")
    write(archive, tmp_path / "run" / "ca_model.nc")
    done = stratify("pour", "run/ca_model.nc", "-o", "run", "--force", folder=tmp_path)
    assert "it differs from run/ca_model.nc, which is by ca_model of stratify 0.0.9" in done.stdout


def test_an_archive_can_be_poured_with_a_change(tmp_path: Path) -> None:
    poured(tmp_path)
    change = ["--set", "pour.seed=8", "--model", "both", "-o", "again"]
    done = stratify("pour", "run.nc", *change, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "bit for bit" not in done.stdout
    for name in ("ca_model", "continuum"):
        assert load(str(tmp_path / "again" / f"{name}.nc")).pour.seed == 8


@pytest.mark.parametrize("model", [ca_model, continuum])
def test_a_set_up_goes_through_an_archive_unchanged(model, tmp_path: Path) -> None:
    experiment = load("makse-stratification", SMALL)
    path = write(model.pour(experiment), tmp_path / "run.nc")
    assert load(str(path)) == experiment
    longer = load(str(path), ["pour.duration=60.0"])
    assert longer.pour.duration == 60.0


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        (["pour.duration=60.0"], "pour.duration = 50.0 there, 60.0 here"),
        (["continuum.cells=31"], "continuum.cells = 30 there, 31 here"),
        (["mixture.smoothing=0.1"], "mixture.smoothing = 0.0 there, 0.1 here"),
        (["ca_model.contacts=2"], "ca_model.contacts = not set there, 2 here"),
        ([], ""),
    ],
)
def test_the_first_difference_of_two_set_ups_is_named(settings: list[str], told: str) -> None:
    there, here = (load("makse-stratification", [*SMALL, *more]) for more in ([], settings))
    stamps = (stamp("continuum", experiment) for experiment in (there, here))
    assert difference(*stamps) == told


def test_another_version_is_a_difference(monkeypatch) -> None:
    experiment: Experiment = load("makse-stratification", SMALL)
    here = stamp("continuum", experiment)
    monkeypatch.setattr("experiment.archive.provenance.version", lambda name: f"9.{len(name)}")
    there = stamp("continuum", experiment)
    assert difference(there, here).startswith(
        "there continuum of stratify 9.8 with numpy 9.5, numba 9.5, here continuum of stratify"
    )
