"""A pour to disk: the archive that memory would hold, in little memory, stopped or not."""

import os
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from running import stopping_after

import ca_model
import continuum
from experiment import (
    ArchiveError,
    Experiment,
    OutputExistsError,
    SetupError,
    StoppedError,
    load,
)
from experiment.archive import read
from experiment.archive.digest import DIGEST
from experiment.archive.storage import read_whole, told_by
from experiment.pouring import InMemory, Pouring, run_to_the_end
from experiment.pouring.extension import STATE
from experiment.pouring.slabs import Deposit, Slab
from experiment.pouring.streaming import pour_to_file
from experiment.pouring.work import work_folder

MEMORY = Path("/proc/self/status")
SHORT = ["pour.records=20", "continuum.cells=40"]
POURS = {  # preset, duration, settings
    "drawn grains": ("makse-stratification", 300.0, ["ca_model.arrivals=drawn", "pour.seed=5"]),
    "a heap": ("heap", 60.0, ["ca_model.arrivals=poisson"]),
    "a drum": ("drum-mixture", 6.0, ["continuum.cells=40"]),
    "a moving source": ("stockpile", 60.0, []),
    "toppling": ("franks", 400.0, []),
    "rates": (
        "makse-grains",
        100.0,
        ["mixture.grain_diameter=[0.0166,0.0333]", "ca_model.column_width=0.5"],
    ),
    "rates over a heap": ("heap", 60.0, ["ca_model.rule=rate", "cell.end=open", "pour.pile=3"]),
    "a schedule": ("pulsed-feed", 1600.0, []),
    "three species, second order": ("ternary", 60.0, ["continuum.scheme=muscl"]),
}
MODELS = {"ca_model": ca_model, "continuum": continuum}
RATES = ("rates", "rates over a heap")
APPLICABLE = [
    pytest.param(model, name, id=f"{name}, {model}")
    for name in POURS
    for model in MODELS
    if not (model == "ca_model" and name == "a drum")
    and not (model == "continuum" and name in ("a moving source", "toppling", *RATES))
]
every_pour = pytest.mark.parametrize(("model", "name"), APPLICABLE)


def setup(name: str, longer: float = 1.0, records: int = 20) -> Experiment:
    preset, duration, settings = POURS[name]
    told = [f"pour.duration={longer * duration}", f"pour.records={records}"]
    return load(preset, [*SHORT, *told, *settings])


@every_pour
def test_a_streamed_archive_is_the_one_that_memory_would_hold(model, name, tmp_path: Path) -> None:
    experiment, path = setup(name), tmp_path / "run.nc"
    assert pour_to_file(MODELS[model].begin, experiment, path)
    in_memory, streamed = MODELS[model].pour(experiment), read(path)
    for archive in (in_memory, streamed):
        del archive.attrs["history"]
    assert streamed.identical(in_memory)
    assert list(tmp_path.iterdir()) == [path]


@every_pour
def test_a_pour_stopped_anywhere_comes_to_the_same_archive(model, name, tmp_path: Path) -> None:
    """Put down after every second block, and taken up again by one that knows the files only."""
    experiment, whole, path = setup(name), tmp_path / "whole.nc", tmp_path / "run.nc"
    pour_to_file(MODELS[model].begin, experiment, whole)
    stops = 0
    while not path.exists():
        try:
            pour_to_file(MODELS[model].begin, experiment, path, resume=True, stop=stopping_after(1))
        except StoppedError:
            stops += 1
    assert stops >= 9
    assert told_by(path, DIGEST) == told_by(whole, DIGEST)
    assert read_whole(path, STATE).identical(read_whole(whole, STATE))
    assert sorted(tmp_path.iterdir()) == [path, whole]


@every_pour
def test_an_extended_archive_is_that_of_the_longer_pour(model, name, tmp_path: Path) -> None:
    whole, path = tmp_path / "whole.nc", tmp_path / "run.nc"
    pour_to_file(MODELS[model].begin, setup(name, longer=2.5, records=50), whole)
    pour_to_file(MODELS[model].begin, setup(name), path)
    pour_to_file(MODELS[model].begin, setup(name, longer=1.5), path, extend=True)
    with pytest.raises(StoppedError):
        pour_to_file(
            MODELS[model].begin, setup(name, longer=2.5), path, extend=True, stop=stopping_after(9)
        )
    assert read(path).sizes["time"] == 31, "the archive stays until the longer one is whole"
    pour_to_file(MODELS[model].begin, setup(name, longer=2.5), path, extend=True, resume=True)
    assert told_by(path, DIGEST) == told_by(whole, DIGEST)
    assert not pour_to_file(
        MODELS[model].begin, setup(name, longer=2.5), path, extend=True, resume=True
    )


@pytest.mark.parametrize("model", MODELS)
def test_an_archive_is_the_same_in_however_small_parts_it_is_made(
    model, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    few = {"ca_model": {"log": 300}, "continuum": {"most_bins": 32}}[model]
    begin, name = partial(MODELS[model].begin, **few), "drawn grains"
    whole, path = tmp_path / "whole.nc", tmp_path / "run.nc"
    pour_to_file(begin, setup(name, longer=2.0, records=40), whole)
    for room in ("assembly.BAND", "work.ROOM", "extension.ROWS"):
        monkeypatch.setattr(f"experiment.pouring.{room}", 2**14)
    pour_to_file(begin, setup(name), path)
    pour_to_file(begin, setup(name, longer=2.0), path, extend=True)
    assert told_by(path, DIGEST) == told_by(whole, DIGEST)


def test_an_extension_that_was_killed_once_it_was_in_place_is_whole(tmp_path: Path) -> None:
    """Its work is still there, and whoever resumes it need not know that it extended anything."""
    path, longer = tmp_path / "run.nc", setup("a schedule", longer=2.0, records=40)
    pour_to_file(continuum.begin, setup("a schedule"), path)
    with pytest.raises(StoppedError):
        pour_to_file(continuum.begin, longer, path, extend=True, stop=stopping_after(3))
    shutil.copytree(work_folder(path), tmp_path / "left behind")
    pour_to_file(continuum.begin, longer, path, extend=True, resume=True)
    whole = path.read_bytes()
    (tmp_path / "left behind").rename(work_folder(path))
    assert not pour_to_file(continuum.begin, longer, path, resume=True)
    assert path.read_bytes() == whole
    assert list(tmp_path.iterdir()) == [path]


def test_an_unfinished_extension_is_not_lost_for_asking_after_the_shorter_pour(tmp_path) -> None:
    path = tmp_path / "run.nc"
    pour_to_file(continuum.begin, setup("a schedule"), path)
    with pytest.raises(StoppedError):
        pour_to_file(
            continuum.begin,
            setup("a schedule", longer=2.0),
            path,
            extend=True,
            stop=stopping_after(3),
        )
    for extend in (False, True):
        with pytest.raises(OutputExistsError, match="holds another pour, unfinished"):
            pour_to_file(continuum.begin, setup("a schedule"), path, resume=True, extend=extend)
    assert (work_folder(path) / "checkpoint.nc").exists()


@pytest.mark.parametrize(
    ("settings", "refusal"),
    [
        (["pour.duration=60.0"], "pour.duration = 60: to extend a pour of 100 s it should be"),
        (["pour.duration=101.0"], "longer by whole intervals of 20 s"),
        (["continuum.cells=30"], "same set-up can be extended: continuum.cells = 20 there, 30"),
        (["pour.seed=4"], "pour.seed = 0 there, 4 here"),
    ],
)
def test_only_the_same_pour_can_be_extended(settings, refusal: str, tmp_path: Path) -> None:
    common = ["cell.length=20.0", "continuum.cells=20", "pour.records=5"]
    path = tmp_path / "run.nc"
    short = load("makse-stratification", [*common, "pour.duration=100.0"])
    pour_to_file(continuum.begin, short, path)
    before = path.read_bytes()
    longer = load("makse-stratification", [*common, "pour.duration=200.0", *settings])
    with pytest.raises(SetupError, match=refusal):
        pour_to_file(continuum.begin, longer, path, extend=True)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_an_archive_without_its_last_state_cannot_be_extended(tmp_path: Path) -> None:
    from experiment.archive import write

    path = write(continuum.pour(setup("a schedule")), tmp_path / "run.nc")
    with pytest.raises(ArchiveError, match="it holds no state of its end"):
        pour_to_file(continuum.begin, setup("a schedule", longer=2.0), path, extend=True)


class Counted(Deposit):
    """Slabs, and how often they came and went."""

    laid = taken_back = 0

    def lay(self, slab: Slab) -> None:
        self.laid += 1
        super().lay(slab)

    def take_back(self) -> Slab:
        self.taken_back += 1
        return super().take_back()


def poured(pouring: Pouring, slabs: Deposit) -> dict[str, np.ndarray]:
    keeper = InMemory(1000, pouring.columns, pouring.experiment.mixture.species)
    run_to_the_end(pouring, keeper)
    grid = pouring.grid()
    section = pouring.section(slabs)(0, len(grid["z"]))
    return keeper.recorder.arrays | grid | {"deposit_fraction": section}


def digging(shape: str) -> Experiment:
    """First rough grains pile up steeply, then round ones wash them down the slope."""
    return load(
        "bdg-minimal",
        [
            "cell.length=20.0",
            f"cell.shape={shape}",
            "continuum.cells=40",
            "pour.duration=400.0",
            "pour.records=50",
            "mixture.repose_slope=[[1.6,1.6],[1.0,1.0]]",
            "mixture.collision_rate=[[20.0,20.0],[20.0,20.0]]",
            "feed.inflow=[0.0,0.25]",
            "feed.schedule={kind='pulses',period=400.0,share=0.5,inflow=[0.25,0.0]}",
        ],
    )


@pytest.mark.parametrize("shape", ["silo", "heap"])
def test_what_was_handed_on_is_dug_up_again(shape: str) -> None:
    """Tapes of 64 bins hand on and take back what tapes as high as the pile keep."""
    slabs, few = Deposit(), Counted()
    kept = poured(continuum.begin(digging(shape), slabs, most_bins=10_000), slabs)
    found = poured(continuum.begin(digging(shape), few, most_bins=64), few)
    assert not slabs.slabs
    assert few.laid > 20
    assert few.taken_back > 5
    dug = np.maximum.accumulate(kept["height"]) - kept["height"]
    assert dug.max() > 3.0, "cm"
    for name, values in kept.items():
        np.testing.assert_array_equal(found[name], values)


def test_grains_that_will_never_topple_are_handed_on() -> None:
    settings = ["cell.length=3.0", "cell.end=wall", "pour.duration=300.0", "pour.records=5"]
    experiment, slabs = load("franks", settings), Counted()
    pouring = ca_model.begin(experiment, slabs)
    found = poured(pouring, slabs)
    assert slabs.laid >= 3
    grown = found["height"][-1] - found["height"][0]
    kept = pouring.pile.state()["stack"].shape[1]
    assert kept < 0.5 * grown.max() / pouring.lattice.unit
    expected = ca_model.pour(experiment)["deposit_fraction"].values
    np.testing.assert_array_equal(found["deposit_fraction"], expected)


def test_grains_that_lie_deeper_than_the_steepest_pile_are_handed_on() -> None:
    """By the rate rule: so many as half of that are kept, and those on top of them."""
    settings = [*SHORT, "cell.length=10.0", "ca_model.rule=rate", "pour.duration=2000.0"]
    slabs = Counted()
    pouring = ca_model.begin(load("makse-stratification", settings), slabs)
    found = poured(pouring, slabs)
    steepest = 1.25 * 10.0 / (1 / 15)
    assert slabs.laid >= 3
    assert not slabs.taken_back
    kept = pouring.pile.state()["grains"]
    assert kept.max() < 2 * steepest < found["deposited_volume"][-1].sum() / 10 * 15 / 2
    expected = ca_model.pour(pouring.experiment)["deposit_fraction"].values
    np.testing.assert_array_equal(found["deposit_fraction"], expected)


@pytest.mark.skipif(not MEMORY.exists(), reason="there is no peak of memory to read")
@pytest.mark.parametrize("model", MODELS)
def test_memory_stays_flat_however_long_it_is_poured(model: str, tmp_path: Path) -> None:
    """Four times the pour, with four times the records: at most 10 % more memory at the peak."""
    script = f"""
from pathlib import Path
import {model} as model
from experiment import load
from experiment.pouring.streaming import pour_to_file

def peak(times):
    settings = [
        f"pour.duration={{times * 5000.0}}", f"pour.records={{times * 5000}}",
        "cell.length=20.0", "continuum.cells=80", "ca_model.column_width=0.2",
    ]
    path = Path({str(tmp_path)!r}) / f"{{times}}.nc"
    pour_to_file(model.begin, load("makse-stratification", settings), path, every=1.0)
    status = Path("{MEMORY}").read_text().split()
    return 1024 * int(status[status.index("VmHWM:") + 1]), path.stat().st_size

print(*peak(1), *peak(4))
"""
    here = os.environ | {"PYTHONPATH": str(Path(__file__).parent.parent)}
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, check=True, capture_output=True, text=True, env=here)
    memory, size, memory_of_many, size_of_many = map(int, done.stdout.split())
    assert memory_of_many < 1.1 * memory
    assert size_of_many > 3 * size


def test_what_is_unfinished_says_so_by_its_name(tmp_path: Path) -> None:
    path = tmp_path / "run.nc"
    with pytest.raises(StoppedError, match="stopped after 32 of 640 steps"):
        pour_to_file(continuum.begin, setup("a schedule"), path, stop=stopping_after(0))
    assert work_folder(path) == tmp_path / "run.nc.unfinished"
    assert list(tmp_path.iterdir()) == [work_folder(path)]
