"""Every kind of file keeps the CF conventions, and the programs that others use can read it."""

import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from PIL import Image

from ca_model.stream import pour_to_disk
from compare import compare
from compare.convergence import converge
from compare.measurement import in_detail
from compare.photograph import View, measure_photograph
from compare.prediction import base, with_piles, with_prediction
from experiment import load
from experiment.archive import write
from experiment.archive.storage import write_whole

TIME_BY_NAME = "check_spatiotemporal_dims_have_coordinate_vars"
SHORT = ("cell.length=20.0", "pour.duration=40.0", "pour.records=8", "continuum.cells=20")
DRUM = ("pour.duration=5.0", "pour.records=4", "continuum.cells=20")
BRIEF = ("pour.duration=2.0", "pour.records=4", "continuum.cells=20")
ARCHIVES = {
    "ca_model": ("ca_model", "makse-stratification", *SHORT),
    "continuum": ("continuum", "makse-stratification", *SHORT),
    "drum": ("continuum", "de-gennes-drum", *DRUM),
    "heap": ("continuum", "heap", *BRIEF),
    "heap-ca_model": ("ca_model", "heap", *BRIEF),
    "three-species": ("continuum", "ternary", *BRIEF),
    "three-species-ca_model": ("ca_model", "ternary", *BRIEF),
    "toppling": ("ca_model", "franks", "cell.length=5.0", *BRIEF[:2]),
    "rates": ("ca_model", "makse-grains", "cell.length=20.0", *BRIEF[:2]),
}
OTHERS = ("comparison", "convergence", "slabs", "cell.layers")
READERS = {"ncdump": ["-h"], "cdo": ["-s", "sinfon"], "ncks": ["-m"], "h5dump": ["-H"]}

Poured = Callable[..., xr.Dataset]


@pytest.fixture(scope="module")
def files(poured: Poured, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """One file of each kind that the program writes."""
    folder = tmp_path_factory.mktemp("kinds")
    paths = {name: folder / f"{name}.nc" for name in (*ARCHIVES, *OTHERS)}
    for name, pour in ARCHIVES.items():
        write(poured(*pour), paths[name])
    archives = [poured(*ARCHIVES[name]) for name in ("ca_model", "continuum")]
    experiment = base(archives, {"mixture.psi": (0.2, 0.3)})
    comparison = with_prediction(compare(archives), experiment, 2)
    drawn = experiment.model_copy(update={"ca_model": {"arrivals": "drawn"}})
    comparison = with_piles(comparison, drawn, 2)
    write_whole(comparison, paths["comparison"], in_detail(archives))
    grids = [
        poured("continuum", "makse-stratification", *SHORT[:3], f"continuum.cells={cells}")
        for cells in (10, 20, 40)
    ]
    write_whole(converge(grids), paths["convergence"])
    pour_to_disk(load("makse-stratification", SHORT), paths["slabs"], log=100)
    stripes = 200 * (np.arange(120) // 10 % 2)[:, None] + np.full(160, 20)
    Image.fromarray(stripes.astype(np.uint8)).save(folder / "cell.png")
    write_whole(measure_photograph(folder / "cell.png", View(16.0)), paths["cell.layers"])
    return paths


def test_every_kind_of_file_passes_the_cf_checker(files: dict[str, Path]) -> None:
    paths = [*files.values()]
    status, report = check_cf(paths, "--skip-checks", TIME_BY_NAME)
    assert status == 0, report
    assert report.count("All tests passed!") == len(paths), report


def test_the_one_skipped_cf_check_asks_for_an_epoch_that_a_pour_has_not(files) -> None:
    """It wants standard_name "time" of whatever is called time; that name is for dates only."""
    report = check_cf([files["continuum"]])[1]
    assert {line for line in report.splitlines() if line.startswith("* ")} == {
        "* Coordinate variable 'time' should have standard_name='time', found: 'None'"
    }


def check_cf(paths: list[Path], *options: str) -> tuple[int, str]:
    checker = shutil.which("compliance-checker", path=str(Path(sys.executable).parent))
    assert checker is not None
    command = [checker, "--test", "cf:1.11", "--criteria", "normal", *options, *map(str, paths)]
    report = subprocess.run(command, capture_output=True, text=True, check=False)
    return report.returncode, report.stdout


@pytest.mark.parametrize("program", READERS)
def test_every_kind_of_file_is_read_by_other_programs(program: str, files) -> None:
    found = shutil.which(program)
    if found is None:
        pytest.skip(f"{program} is not installed")
    for name, path in files.items():
        command = [found, *READERS[program], str(path)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{name}: {done.stderr}"
        assert "wavelength" in done.stdout or "height" in done.stdout, name
