"""What an archive promises: the same numbers back, whole or absent."""

from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray as xr

import ca_model
import continuum
from experiment import ArchiveError, Experiment, OutputExistsError, load
from experiment.archive import assemble, experiment_of, read, write
from experiment.archive.storage import write_whole
from experiment.archive.variables import COORDINATES, VARIABLES
from experiment.pouring.recorder import Recorder, record_steps

MODELS = pytest.mark.parametrize("model", [ca_model, continuum])


@pytest.fixture
def archive(small_pour: Experiment) -> xr.Dataset:
    return continuum.pour(small_pour)


@MODELS
def test_both_models_write_the_variables_of_the_table(model, small_pour: Experiment) -> None:
    dataset = model.pour(small_pour)
    assert set(dataset.variables) == set(COORDINATES | VARIABLES)
    for variable in VARIABLES.values():
        assert dataset[variable.name].dims == variable.dims
        assert dataset[variable.name].attrs["units"] == variable.units
    assert dataset.attrs["model"] == model.__name__


@MODELS
def test_a_written_archive_gives_the_same_numbers_back(model, small_pour, tmp_path: Path) -> None:
    dataset = model.pour(small_pour)
    path = write(dataset, tmp_path / "run.nc")
    assert read(path).identical(dataset)
    with xr.open_dataset(path) as opened:
        assert opened["time"].dtype == np.float64
        del opened.attrs["content_sha256"]
        assert opened.load().identical(dataset)


@pytest.mark.parametrize("arrivals", ["fixed", "poisson"])
def test_a_grain_of_a_lattices_deposit_takes_less_than_a_quarter_of_a_byte(
    arrivals: str, tmp_path: Path
) -> None:
    """Whole grains are stored as bytes; memory has them as the same float32 as any fraction."""
    settings = ["pour.duration=400000.0", "pour.records=1", f"ca_model.arrivals={arrivals}"]
    dataset = ca_model.pour(load("lattice-stratification", settings))
    grains = dataset["deposited_volume"][-1] / (0.1 * np.array([1, 2]))
    path = write(dataset, tmp_path / "run.nc")
    bare = write_whole(dataset.drop_vars("deposit_fraction"), tmp_path / "bare.nc")
    assert path.stat().st_size - bare.stat().st_size < float(grains.sum()) / 4
    assert read(path)["deposit_fraction"].dtype == np.float32
    assert read(path).identical(dataset)


@MODELS
def test_an_archive_alone_can_be_poured_again(model, small_pour: Experiment) -> None:
    first = model.pour(small_pour)
    again = model.pour(experiment_of(first))
    assert again.drop_attrs().identical(first.drop_attrs())


@MODELS
def test_poured_is_rolling_plus_deposited_plus_what_fell_off(model, small_pour: Experiment) -> None:
    dataset = model.pour(small_pour)
    held = dataset["rolling_volume"] + dataset["deposited_volume"] + dataset["outflow_volume"]
    np.testing.assert_allclose(held, dataset["poured_volume"], rtol=1e-12, atol=1e-12)
    assert (dataset["poured_volume"].diff("time") > 0).all()


@MODELS
def test_the_deposit_adds_up_to_what_came_to_rest(model, small_pour: Experiment) -> None:
    dataset = model.pour(small_pour)
    dx, dz = (float(dataset[name][1] - dataset[name][0]) for name in ("x", "z"))
    lower = dataset["z"] - dz / 2
    top, base = dataset["height"].isel(time=-1), dataset["base_height"]
    filled = (np.minimum(lower + dz, top) - np.maximum(lower, base)).clip(0)
    volume = (dataset["deposit_fraction"].fillna(0) * filled).sum(["z", "x"]) * dx
    np.testing.assert_allclose(volume, dataset["deposited_volume"].isel(time=-1), rtol=1e-4)


def test_an_archive_cut_in_half_is_refused(archive: xr.Dataset, tmp_path: Path) -> None:
    path = write(archive, tmp_path / "run.nc")
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(ArchiveError, match="is not a whole netCDF-4 archive"):
        read(path)


def test_every_number_is_kept_with_a_checksum(archive: xr.Dataset, tmp_path: Path) -> None:
    with netCDF4.Dataset(write(archive, tmp_path / "run.nc")) as stored:
        for variable in stored.variables.values():
            assert variable.dtype is str or variable.filters()["fletcher32"]


def test_a_damaged_byte_of_data_is_noticed(archive: xr.Dataset, tmp_path: Path) -> None:
    path = write(archive, tmp_path / "run.nc")
    content = bytearray(path.read_bytes())
    start = content.find(b"x\x01", len(content) // 3)  # a deflated chunk
    content[start + 40] ^= 0xFF
    path.write_bytes(bytes(content))
    with pytest.raises(ArchiveError, match="is not a"):
        read(path)


def test_what_is_no_archive_is_refused(tmp_path: Path) -> None:
    text = tmp_path / "text.nc"
    text.write_text("grains")
    foreign = tmp_path / "foreign.nc"
    xr.Dataset({"height": ("x", [1.0, 2.0])}).to_netcdf(foreign)
    for path in (text, foreign):
        with pytest.raises(ArchiveError, match="is not a"):
            read(path)
    with pytest.raises(ArchiveError, match="no such archive"):
        read(tmp_path / "gone.nc")


@pytest.mark.parametrize("lost", ["height", "deposit_fraction", "time"])
def test_an_archive_without_a_variable_is_refused(archive, lost: str, tmp_path: Path) -> None:
    path = write_whole(archive.drop_vars(lost), tmp_path / "run.nc")
    with pytest.raises(ArchiveError, match=f"'{lost}' is missing"):
        read(path)


def test_an_archive_with_numbers_that_are_none_is_refused(archive: xr.Dataset, tmp_path) -> None:
    archive["height"].values[0, 0] = np.nan
    with pytest.raises(ArchiveError, match="height holds values"):
        write(archive, tmp_path / "run.nc")
    assert list(tmp_path.iterdir()) == []


def test_an_archive_with_words_for_numbers_is_refused(archive: xr.Dataset, tmp_path) -> None:
    words = archive.assign(base_height=("x", np.full(archive.sizes["x"], "high", dtype=object)))
    path = write_whole(words, tmp_path / "run.nc")
    with pytest.raises(ArchiveError, match="base_height holds values"):
        read(path)


def test_nothing_is_overwritten_without_force(archive: xr.Dataset, tmp_path: Path) -> None:
    path = tmp_path / "run.nc"
    path.write_text("precious")
    with pytest.raises(OutputExistsError, match="exists already; --force"):
        write(archive, path)
    assert path.read_text() == "precious"
    write(archive, path, force=True)
    assert read(path).identical(archive)


def test_a_failed_write_leaves_nothing_behind(archive: xr.Dataset, tmp_path: Path) -> None:
    archive.attrs["unwritable"] = object()
    path = tmp_path / "run.nc"
    with pytest.raises((TypeError, ArchiveError)):
        write(archive, path)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_made_is_one_clear_error(archive, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ArchiveError, match="cannot be written"):
        write(archive, tmp_path / "file" / "run.nc")


def test_unknown_and_misshapen_variables_are_refused(small_pour: Experiment) -> None:
    with pytest.raises(ArchiveError, match="'colour' is no variable"):
        assemble(small_pour, "continuum", {"colour": np.zeros(3)}, {})
    with pytest.raises(ArchiveError, match="height has shape"):
        assemble(small_pour, "continuum", {"height": np.zeros(3), "x": np.zeros(3)}, {})


def test_an_archive_whose_numbers_are_not_those_of_its_set_up_is_refused(archive, tmp_path):
    archive["repose_slope"].values[0, 0] = 7.0
    path = write(archive, tmp_path / "run.nc")
    with pytest.raises(ArchiveError, match="repose_slope is not that of its set-up"):
        read(path)


def test_an_archive_that_runs_backwards_is_refused(archive: xr.Dataset, tmp_path: Path) -> None:
    with pytest.raises(ArchiveError, match="time should have at least 2 values, and grow"):
        write(archive.isel(time=slice(None, None, -1)), tmp_path / "run.nc")


def test_a_recorder_takes_whole_records_only() -> None:
    recorder = Recorder(room=2, columns=3, species=2)
    with pytest.raises(ArchiveError, match="'colour' is missing or unknown"):
        recorder.keep(**dict.fromkeys(recorder.arrays, 0.0), colour=1.0)


@pytest.mark.parametrize(("duration", "dt"), [(10.0, 1.0), (10.0, 0.3), (1.0, 0.4), (0.1, 7.0)])
def test_records_run_from_start_to_end_and_none_is_kept_twice(small_pour, duration, dt) -> None:
    pour = small_pour.pour.model_copy(update={"duration": duration, "records": 5})
    steps = record_steps(pour, dt)
    assert steps[0] == 0
    assert steps[-1] == max(1, round(duration / dt))
    assert steps == sorted(set(steps))
