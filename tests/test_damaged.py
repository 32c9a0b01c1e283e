"""What is damaged, foreign or older is refused in one line: never a traceback, or other numbers."""

import os
import subprocess
import sys
import tempfile
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import netCDF4
import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

import ca_model
import continuum
from ca_model.stream import pour_to_disk, read_section
from experiment import ArchiveError, Experiment, load
from experiment.archive import read, write
from experiment.archive.digest import bare_size, digest_of
from experiment.archive.storage import seal, write_whole

SET_UP = ["cell.length=20.0", "pour.duration=60.0", "pour.records=8", "continuum.cells=20"]
NOBODY = 65534


class Written(NamedTuple):
    """A file as it was written, and what reads it."""

    path: Path
    content: bytes
    read: Callable[[Path], xr.Dataset]

    def read_damaged(self, content: bytes) -> xr.Dataset:
        """What is read where `content` stands; a name is never used twice, for HDF5 keeps files."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "damaged.nc"
            path.write_bytes(content)
            return self.read(path)

    def refused(self, content: bytes) -> None:
        """That `content` is refused, in one line that names the file."""
        with pytest.raises(ArchiveError, match=r"damaged\.nc' is not a") as refusal:
            self.read_damaged(content)
        assert "\n" not in str(refusal.value)


@pytest.fixture(scope="module", params=["ca_model", "continuum", "slabs"])
def written(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Written:
    path = tmp_path_factory.mktemp("whole") / f"{request.param}.nc"
    experiment = load("makse-stratification", SET_UP)
    if request.param == "slabs":
        pour_to_disk(experiment, path, log=50)
        return Written(path, path.read_bytes(), read_section)
    model = {"ca_model": ca_model, "continuum": continuum}[request.param]
    write(model.pour(experiment), path)
    return Written(path, path.read_bytes(), read)


@pytest.fixture
def archive(small_pour: Experiment) -> xr.Dataset:
    return continuum.pour(small_pour)


@settings(max_examples=200, deadline=None)
@given(data=st.data())
def test_a_file_in_which_any_bits_are_flipped_is_refused(written: Written, data) -> None:
    bits = st.integers(0, 8 * len(written.content) - 1)
    content = bytearray(written.content)
    for bit in data.draw(st.sets(bits, min_size=1, max_size=8)):
        content[bit // 8] ^= 1 << bit % 8
    written.refused(bytes(content))


@settings(max_examples=200, deadline=None)
@given(data=st.data())
def test_a_file_that_is_cut_anywhere_is_refused(written: Written, data) -> None:
    """But where the line of its checksum is cut off, which leaves the file that HDF5 wrote."""
    left = data.draw(st.integers(0, len(written.content) - 1))
    if left != bare_size(written.path):
        written.refused(written.content[:left])


def test_a_file_without_the_line_of_its_checksum_has_its_digest(written: Written) -> None:
    bare = written.content[: bare_size(written.path)]
    assert len(bare) == len(written.content) - 82
    assert written.read_damaged(bare).identical(written.read(written.path))


@settings(max_examples=100, deadline=None)
@given(data=st.data())
def test_a_file_whose_tail_never_reached_the_disk_is_refused(written: Written, data) -> None:
    kept = data.draw(st.integers(0, len(written.content) - 1))
    written.refused(written.content[:kept].ljust(len(written.content), b"\0"))


@settings(max_examples=100, deadline=None)
@given(more=st.binary(min_size=1, max_size=200))
def test_a_file_with_more_behind_its_end_is_refused(written: Written, more: bytes) -> None:
    written.refused(written.content + more)


@pytest.mark.parametrize("content", [b"", b"\x89", b"CDF\x01", b"\x89HDF\r\n\x1a\n", bytes(5000)])
def test_what_only_begins_like_an_archive_is_refused(written: Written, content: bytes) -> None:
    written.refused(content)


def test_an_archive_of_an_older_version_is_to_be_poured_again(archive, tmp_path: Path) -> None:
    archive.to_netcdf(tmp_path / "older.nc")
    with pytest.raises(ArchiveError, match=r"older\.nc' .* no content_sha256: .* `stratify pour"):
        read(tmp_path / "older.nc")


@pytest.mark.parametrize("name", ["height", "deposit_fraction", "base_height", "time"])
def test_an_archive_in_which_another_program_changed_a_number_is_refused(
    name: str, archive: xr.Dataset, tmp_path: Path
) -> None:
    path = write(archive, tmp_path / "run.nc")
    with netCDF4.Dataset(path, "a") as file:
        file[name][(0,) * file[name].ndim] = 0.25
    with pytest.raises(ArchiveError, match="it is damaged or was changed"):
        read(path)


@pytest.mark.parametrize("value", [7, [1.0, 2.0], np.array(["a", "b"]), b"\xff\xfe", ""])
@pytest.mark.parametrize("name", ["model", "experiment", "content_sha256", "odd"])
def test_an_archive_with_another_attribute_is_refused(name, value, archive, tmp_path) -> None:
    path = write(archive, tmp_path / "run.nc")
    with netCDF4.Dataset(path, "a") as file:
        file.setncattr(name, value)
    reason = r"run\.nc' is not .*(damaged or was changed|codec can't decode)"
    with pytest.raises(ArchiveError, match=reason) as refusal:
        read(path)
    assert "\n" not in str(refusal.value)


def test_a_file_that_claims_more_numbers_than_it_can_hold_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "huge.nc"
    with netCDF4.Dataset(path, "w") as file:
        file.content_sha256 = "0"
        for dim in ("time", "x"):
            file.createDimension(dim, 10**6)
        file.createVariable("time", "f8", ("time",), zlib=True, chunksizes=(1000,))
        file.createVariable("height", "f8", ("time", "x"), zlib=True, chunksizes=(1000, 1000))
    with pytest.raises(ArchiveError, match=r"it claims 8e\+12 bytes of numbers"):
        read(path)


def test_a_folder_and_a_file_that_may_not_be_read_are_refused(archive, tmp_path: Path) -> None:
    with pytest.raises(ArchiveError, match="no such archive"):
        read(tmp_path)
    with tempfile.TemporaryDirectory() as folder:
        path = write(archive, Path(folder) / "run.nc")
        path.parent.chmod(0o755)
        path.chmod(0)
        root = os.geteuid() == 0
        if root:
            os.seteuid(NOBODY)
        try:
            with pytest.raises(ArchiveError, match=r"run\.nc' cannot be read: Permission denied"):
                read(path)
        finally:
            if root:
                os.seteuid(0)


# The command line.


@pytest.mark.parametrize("command", ["show", "compare"])
def test_a_command_given_a_damaged_file_says_so_in_one_line(command, archive, tmp_path) -> None:
    path = write(archive, tmp_path / "continuum.nc")
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    stratify = Path(sys.executable).parent / "stratify"
    told = [str(stratify), command, "continuum.nc" if command == "show" else "."]
    done = subprocess.run(told, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith("stratify: '")
    assert "continuum.nc' is not an archive of a pour: it is damaged" in done.stderr
    assert done.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["continuum.nc"]


# The digest.


def test_the_digest_is_one_in_memory_and_however_a_file_is_laid_out(archive, tmp_path) -> None:
    chunks = {"zlib": True, "shuffle": True, "chunksizes": (3, 7, 1)}
    laid_out = {
        "plain": {},
        "chunked": {"encoding": {"rolling_thickness": chunks}},
        "unlimited": {"unlimited_dims": ["time"]},
    }
    assert digest_of(archive) == digest_of(archive.copy(deep=True))
    for name, options in laid_out.items():
        archive.to_netcdf(tmp_path / f"{name}.nc", **options)
        with xr.open_dataset(tmp_path / f"{name}.nc") as stored:
            assert digest_of(stored) == digest_of(archive)


def test_the_digest_knows_values_and_not_how_they_are_kept() -> None:
    real, whole = np.array([0.0, np.nan, 1.5]), np.array([1, 2])
    one = xr.Dataset({"a": ("x", real), "b": ("y", whole)}, attrs={"k": [1, 2], "n": 3})
    other = xr.Dataset(
        {"b": ("y", whole.astype(">i8")), "a": ("x", np.copysign(real, -1).astype(">f8"))},
        attrs={"n": np.int64(3), "history": "b", "k": np.array([1, 2]), "content_sha256": "0"},
    )
    other["a"][2] = 1.5
    assert digest_of(one) == digest_of(other)


@settings(max_examples=100, deadline=None)
@given(values=st.lists(st.floats(width=32), min_size=2, max_size=5), data=st.data())
def test_the_digest_is_another_where_anything_is(values: list[float], data) -> None:
    one = xr.Dataset(
        {
            "a": ("x", values),
            "b": ("x", ["ab", "c", "", "d", "e"][: len(values)]),
            "c": (("y", "z"), np.zeros((2, 3))),
        },
        attrs={"k": "v"},
    )
    k = data.draw(st.integers(0, len(values) - 1))
    changed = one.copy(deep=True)
    changed["a"][k] = np.nextafter(np.nan_to_num(values[k]), 1e300)
    others = [
        changed,
        one.assign(b=("x", ["a", "bc", "", "d", "e"][: len(values)])),
        one.assign(c=(("y", "z"), np.zeros((2, 3), dtype=int))),
        one.assign(a=one["a"].assign_attrs(units="cm")),
        one.assign(a=one["a"].assign_attrs(history="older")),
        one.drop_vars("c").assign(c=(("y", "z"), np.zeros((3, 2)))),
        one.drop_vars("b"),
        one.isel(x=slice(1, None)),
        one.rename(a="d"),
        one.rename(x="u"),
        one.assign_attrs(k="w"),
        one.assign_attrs(m="v"),
    ]
    assert len({digest_of(each) for each in [one, *others]}) == len(others) + 1


def test_a_file_that_was_written_in_pieces_is_sealed_in_little_memory(archive, tmp_path) -> None:
    path = tmp_path / "large.nc"
    with netCDF4.Dataset(path, "w") as file:
        file.createDimension("time", None)
        file.createDimension("x", 2**17)
        height = file.createVariable("height", "f8", ("time", "x"), zlib=True, complevel=1)
        for k in range(200):  # MB
            height[k] = float(k)
    tracemalloc.start()
    seal(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 60e6
    with xr.open_dataset(path) as stored:
        assert stored.attrs["content_sha256"] == digest_of(stored.load())

    whole = tmp_path / "run.nc"
    archive.to_netcdf(whole)
    seal(whole)
    assert read(whole).identical(archive)


def test_every_group_of_a_file_has_its_own_digest(archive: xr.Dataset, tmp_path: Path) -> None:
    part = archive[["base_height"]]
    path = write_whole(archive, tmp_path / "both.nc", {"a/part": part})
    with xr.open_dataset(path, group="a/part") as stored:
        assert stored.attrs["content_sha256"] == digest_of(part)
    assert read(path).identical(archive)
