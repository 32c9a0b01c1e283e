"""A deposit on disk: the grains that memory would hold, in few bytes, however many they are."""

import os
import subprocess
import sys
from pathlib import Path

import netCDF4
import numpy as np
import pytest

import ca_model
from ca_model.lattice import lattice_of
from ca_model.stream import pour_to_disk, read_section, slabs_of
from experiment import Experiment, NotApplicableError, SetupError, load
from experiment.archive import read, write
from experiment.archive.storage import seal
from experiment.errors import ArchiveError, OutputExistsError
from experiment.pouring import InMemory, run_to_the_end
from experiment.pouring.slabs import Deposit

MEMORY = Path("/proc/self/status")
LOG = 3000  # grains; a small pour makes many slabs of them
ALL = (-np.inf, np.inf)
POURS = {
    "silo": [],
    "poisson": ["ca_model.arrivals='poisson'", "pour.seed=3"],
    "drawn": ["ca_model.arrivals='drawn'", "ca_model.contacts='all'"],
    "open": ["cell.end='open'", "cell.start_slope=0.0"],
    "heap": ["cell.shape='heap'", "cell.length=53.0"],
    "open heap": [
        "cell.shape='heap'",
        "cell.end='open'",
        "ca_model.arrivals='poisson'",
        "cell.start_slope=0.1",
    ],
}


def small(*settings: str) -> Experiment:
    common = ["cell.length=101.0", "pour.duration=6000.0", "pour.records=3"]
    return load("lattice-stratification", [*common, *settings])


@pytest.fixture(params=POURS)
def experiment(request: pytest.FixtureRequest) -> Experiment:
    return small(*POURS[request.param])


@pytest.fixture
def on_disk(tmp_path: Path) -> Path:
    return pour_to_disk(small(), tmp_path / "pile.nc", log=LOG)


def test_the_disk_holds_the_stacks_that_memory_holds(experiment, tmp_path: Path) -> None:
    lattice, in_memory, from_disk = lattice_of(experiment), Deposit(), Deposit()
    pouring = ca_model.begin(experiment, in_memory)
    run_to_the_end(pouring, InMemory(4, pouring.columns, 2))
    pouring.bury()
    for slab in slabs_of(pour_to_disk(experiment, tmp_path / "pile.nc", log=LOG)):
        from_disk.lay(slab)
    assert len(from_disk.slabs) > 5 > len(in_memory.slabs)
    for i in range(lattice.columns):
        assert (from_disk.stack(i) == in_memory.stack(i)).all()


def test_a_fine_section_is_the_archive_of_a_pour_in_memory(experiment, tmp_path: Path) -> None:
    """Every variable, bit for bit."""
    path = pour_to_disk(experiment, tmp_path / "pile.nc", log=LOG)
    section = read_section(path, (10_000, 10_000))
    assert section.drop_attrs().identical(ca_model.pour(experiment).drop_attrs())


def test_a_coarse_section_has_the_volumes_of_the_fine_one(experiment, tmp_path: Path) -> None:
    """By species and cell: the sums over the units that a coarse cell covers."""
    path = pour_to_disk(experiment, tmp_path / "pile.nc", log=LOG)
    fine, coarse = ca_model.pour(experiment), read_section(path, (40, 30))
    units, wide = (round(np.ptp(coarse[k].values[:2]) / np.ptp(fine[k].values[:2])) for k in "zx")
    assert min(units, wide) > 1
    blocks = {"z": units, "x": wide}
    volume = fine["deposit_fraction"].fillna(0).coarsen(blocks, boundary="pad").sum()
    share = (volume / volume.sum("species").where(lambda total: total > 0)).values
    np.testing.assert_allclose(coarse["deposit_fraction"], share, rtol=1e-6)
    mean = fine["height"].coarsen(x=wide, boundary="pad").mean().values
    np.testing.assert_allclose(coarse["height"], mean)
    np.testing.assert_allclose(coarse["x"][0], fine["x"][:wide].mean())


def test_a_part_of_a_section_is_that_part_of_the_whole(experiment, tmp_path: Path) -> None:
    path = pour_to_disk(experiment, tmp_path / "pile.nc", log=LOG)
    whole, part = (read_section(path, (10_000, 10_000), between=at) for at in (ALL, (9.0, 40.0)))
    assert part.sizes["x"] == 31
    x = slice(9.0, 40.0)
    np.testing.assert_allclose(part["x"], whole["x"].sel(x=x))
    assert (part["height"].values == whole["height"].sel(x=x).values).all()
    same = whole["deposit_fraction"].sel(x=x)[: part.sizes["z"]].values
    np.testing.assert_array_equal(part["deposit_fraction"], same)


def test_a_section_is_an_archive(on_disk: Path, tmp_path: Path) -> None:
    section = read_section(on_disk, (50, 40))
    assert read(write(section, tmp_path / "section.nc")).identical(section)
    assert section.attrs["title"] == small().title
    assert Experiment.from_toml(section.attrs["experiment"]) == small()


def test_above_the_base_a_section_loses_no_grain(on_disk: Path) -> None:
    section = read_section(on_disk, (10_000, 10_000), above_base=True)
    assert (section["base_height"] == 0).all()
    unit = section.attrs["unit_cm"]
    volume = section["deposit_fraction"].sum(["z", "x"]) * unit * section.attrs["column_width_cm"]
    np.testing.assert_allclose(volume, section["deposited_volume"][-1], rtol=1e-6)
    assert np.isfinite(section["deposit_fraction"][0]).all(), "every column begins at its base"
    assert section["z"].attrs["long_name"] == "height above the surface before pouring"


@pytest.mark.parametrize("arrivals", ["fixed", "poisson"])
def test_a_grain_costs_less_than_a_quarter_of_a_byte_on_disk(arrivals, tmp_path: Path) -> None:
    settings = ["pour.duration=400000.0", f"ca_model.arrivals='{arrivals}'"]
    path = pour_to_disk(small(*settings), tmp_path / "pile.nc", log=2**16)
    with netCDF4.Dataset(path) as file:
        grains = file.dimensions["at_rest"].size
    assert grains > 1_190_000
    assert path.stat().st_size < grains / 4


@pytest.mark.skipif(not MEMORY.exists(), reason="there is no peak of memory to read")
def test_memory_does_not_grow_with_the_number_of_grains(tmp_path: Path) -> None:
    """Five times the grains add less than half to the peak of what they would take."""
    script = f"""
from pathlib import Path
from ca_model.stream import pour_to_disk, read_section
from experiment import load

def peak(steps):
    setting = ["cell.length=1000.0", f"pour.duration={{steps}}.0", "pour.records=1"]
    path = Path({str(tmp_path)!r}) / f"{{steps}}.nc"
    pour_to_disk(load("lattice-stratification", setting), path, log=2**17)
    read_section(path, (100, 100))
    status = Path("{MEMORY}").read_text().split()
    return 1024 * int(status[status.index("VmHWM:") + 1])

_, few, many = peak(500_000), peak(1_000_000), peak(5_000_000)
print(many - few)
"""
    command = [sys.executable, "-c", script]
    here = os.environ | {"PYTHONPATH": str(Path(__file__).parent.parent)}
    done = subprocess.run(command, check=True, capture_output=True, text=True, env=here)
    assert int(done.stdout) < 3 * 4_000_000 / 2


def test_what_cannot_be_poured_is_refused_before_a_file_is_made(tmp_path: Path) -> None:
    path = tmp_path / "pile.nc"
    with pytest.raises(NotApplicableError, match="dispersion"):
        pour_to_disk(small("mixture.dispersion=1.0"), path)
    with pytest.raises(SetupError, match="log = 0: it should be at least 1"):
        pour_to_disk(small(), path, log=0)
    assert not list(tmp_path.iterdir())


def test_nothing_is_overwritten_without_force_and_a_failed_pour_leaves_nothing(on_disk) -> None:
    before = on_disk.read_bytes()
    with pytest.raises(OutputExistsError):
        pour_to_disk(small(), on_disk)

    def fail(_share: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        pour_to_disk(small(), on_disk, fail, force=True)
    assert on_disk.read_bytes() == before
    assert list(on_disk.parent.iterdir()) == [on_disk]


def test_too_coarse_a_grid_is_refused(on_disk: Path) -> None:
    with pytest.raises(SetupError, match=r"cells = \(1, 9\): there should be at least 2 each way"):
        read_section(on_disk, (1, 9))
    with pytest.raises(SetupError, match=r"between = \(3.0, 4.0\): there should be at least 2 col"):
        read_section(on_disk, between=(3.0, 4.0))


def test_foreign_and_truncated_files_are_refused(on_disk: Path, tmp_path: Path) -> None:
    cut, text, archive = (tmp_path / name for name in ("cut.nc", "text.nc", "archive.nc"))
    cut.write_bytes(on_disk.read_bytes()[: on_disk.stat().st_size // 2])
    text.write_text("no file of this kind")
    write(ca_model.pour(small()), archive)
    for path, reason in (
        (cut, "not a whole netCDF-4 archive"),
        (text, "not a whole netCDF-4 archive"),
        (archive, "it holds no slabs of grains"),
        (tmp_path / "nothing.nc", "no such archive"),
    ):
        with pytest.raises(ArchiveError, match=reason) as refusal:
            read_section(path)
        assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("name", "at", "value", "reason"),
    [
        ("captured", -1, 0, "do not make up its pile"),
        ("captured", (0, 0), 2**31, "out of bounds"),
        ("grain", 5, 7, "out of bounds"),
        ("height", -1, 0.3, "do not make up its pile"),
    ],
)
def test_grains_that_contradict_the_rest_of_the_file_are_refused(
    name, at, value, reason, on_disk: Path
) -> None:
    with netCDF4.Dataset(on_disk, "a") as file:
        file[name][at] = value
    seal(on_disk, beside=("grain", "captured"))
    with pytest.raises(ArchiveError, match=reason):
        read_section(on_disk)
