"""A Zarr store takes the part of the folder: the same archives, as groups, whole or absent."""

import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
import zarr
from running import stopping_after

import ca_model
import continuum
from compare.cli import cli
from experiment import ArchiveError, OutputExistsError, SetupError, StoppedError, load
from experiment.archive import read, write
from experiment.archive.digest import DIGEST
from experiment.archive.storage import read_whole
from experiment.pouring.streaming import pour_to_file
from experiment.pouring.work import work_folder

MODELS = {"ca_model": ca_model, "continuum": continuum}
BOTH = pytest.mark.parametrize("model", sorted(MODELS))
SHORT = ["cell.length=20.0", "pour.duration=50.0", "pour.records=20", "continuum.cells=40"]
SETUP = load("makse-stratification", SHORT)
LONGER = load("makse-stratification", [*SHORT, "pour.duration=100.0"])


def pour(model: str, path: Path, setup=SETUP, **how: object) -> bool:
    return pour_to_file(MODELS[model].begin, setup, path, **how)


def stratify(*arguments: str) -> None:
    cli.main(arguments, standalone_mode=False)


def content(archive: xr.Dataset) -> xr.Dataset:
    """What does not change with the hour of the pour."""
    return archive.drop_attrs(deep=False).assign_attrs(
        {name: told for name, told in archive.attrs.items() if name != "history"}
    )


@pytest.fixture(autouse=True)
def nobody_pulls_the_plug(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each wait for the disk takes as long as a pour."""
    monkeypatch.setattr("os.fsync", lambda _: None)


@pytest.fixture(scope="module")
def poured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with netCDF-4 archives and a store of the same pours."""
    folder = tmp_path_factory.mktemp("pours")
    for model in MODELS:
        pour(model, folder / f"{model}.nc")
        pour(model, folder / "run.zarr" / model)
    return folder


@pytest.fixture
def group(poured: Path, tmp_path: Path) -> Path:
    """An archive in a store that a test may spoil."""
    shutil.copytree(poured / "run.zarr", tmp_path / "run.zarr")
    return tmp_path / "run.zarr" / "continuum"


@BOTH
def test_a_group_holds_what_the_file_holds_bit_for_bit(model: str, poured: Path) -> None:
    file, group = poured / f"{model}.nc", poured / "run.zarr" / model
    one, other = read(file), read(group)
    assert content(one).identical(content(other))
    for name, values in one.variables.items():
        if values.dtype.kind == "f":
            assert values.dtype == other[name].dtype
            assert values.values.tobytes() == other[name].values.tobytes()
    assert read_whole(group, "state").identical(read_whole(file, "state"))
    with xr.open_dataset(file) as one, xr.open_zarr(group.parent, group=model) as other:
        assert one.attrs[DIGEST] == other.attrs[DIGEST]


@BOTH
def test_any_program_opens_a_store_without_a_warning(model: str, poured: Path) -> None:
    with xr.open_zarr(poured / "run.zarr", group=model) as archive:
        assert archive["time"].dtype == np.float64
        assert archive["height"].dims == ("time", "x")
        assert archive["deposit_fraction"].dtype == np.float32
        assert archive["species_name"].values.tolist() == ["small", "large"]
    with xr.open_datatree(poured / "run.zarr", engine="zarr") as tree:
        assert set(tree.children) == set(MODELS)


def test_a_store_holds_nothing_but_its_archives(poured: Path) -> None:
    assert {entry.name for entry in (poured / "run.zarr").iterdir()} == {*MODELS, "zarr.json"}
    assert {entry.name for entry in poured.iterdir()} == {"run.zarr", *(f"{m}.nc" for m in MODELS)}


def test_every_chunk_carries_its_crc(poured: Path) -> None:
    arrays = [json.loads(path.read_text()) for path in poured.rglob("*/zarr.json")]
    arrays = [told for told in arrays if told["node_type"] == "array"]
    assert len(arrays) > 40
    assert {told["codecs"][-1]["name"] for told in arrays} == {"crc32c"}


def test_a_large_array_is_stored_in_many_pieces_and_is_the_same(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("experiment.archive.zarr_store.PIECE", 5000)
    pour("continuum", tmp_path / "continuum.nc")
    pour("continuum", tmp_path / "run.zarr" / "continuum")
    assert len(list((tmp_path / "run.zarr" / "continuum" / "deposit_fraction").iterdir())) > 10
    one, other = (read(tmp_path / name) for name in ("continuum.nc", "run.zarr/continuum"))
    assert content(one).identical(content(other))


def test_the_command_line_compares_shows_and_pours_again_from_a_store(group, monkeypatch) -> None:
    folder = group.parent.parent
    monkeypatch.chdir(folder)
    stratify("compare", "run.zarr")
    stratify("show", "run.zarr/continuum")
    stratify("pour", "run.zarr/continuum", "-o", "again.zarr")
    assert {entry.name for entry in folder.iterdir()} == {
        "again.zarr",
        "run.comparison.nc",
        "run.comparison.png",
        "run.continuum.png",
        "run.zarr",
    }
    assert content(read(folder / "again.zarr" / "continuum")).identical(content(read(group)))
    assert not (folder / "again.zarr" / "ca_model").exists()
    with pytest.raises(OutputExistsError, match="exists already; --force replaces it"):
        stratify("pour", "run.zarr/continuum", "-o", "run.zarr")
    with pytest.raises(OutputExistsError, match=r"run.comparison.nc' exists already"):
        stratify("compare", "run.zarr")


@BOTH
def test_an_extended_group_is_that_of_a_long_pour(model: str, poured: Path, tmp_path) -> None:
    shutil.copytree(poured / "run.zarr", tmp_path / "run.zarr")
    path = tmp_path / "run.zarr" / model
    assert pour(model, path, LONGER, extend=True)
    pour(model, tmp_path / "long.nc", LONGER.model_copy(update={"pour": _twice(SETUP.pour)}))
    assert content(read(path)).identical(content(read(tmp_path / "long.nc")))
    with xr.open_zarr(path.parent, group=model) as listed:
        assert listed.sizes["time"] == read(path).sizes["time"]
    assert {entry.name for entry in tmp_path.iterdir()} == {"run.zarr", "long.nc"}


@BOTH
def test_a_group_is_extended_before_anything_was_sealed(model: str, tmp_path) -> None:
    path = tmp_path / "run.zarr" / model
    short, longer = (
        load("makse-stratification", [*SHORT, f"pour.duration={duration}", "pour.records=2"])
        for duration in (1.0, 2.0)
    )
    pour(model, path, short)
    assert pour(model, path, longer, extend=True)


def _twice(pour):
    return pour.model_copy(update={"duration": 2 * pour.duration, "records": 2 * pour.records})


@BOTH
def test_a_stopped_pour_goes_on_to_the_same_group(model: str, poured: Path, tmp_path) -> None:
    path = tmp_path / "run.zarr" / model
    with pytest.raises(StoppedError):
        pour(model, path, stop=stopping_after(5))
    assert not path.exists()
    assert work_folder(path) == tmp_path / f"run.{model}.unfinished"
    assert pour(model, path, resume=True)
    assert content(read(path)).identical(content(read(poured / f"{model}.nc")))
    assert not pour(model, path, resume=True)


def test_an_existing_group_stays_without_force(group: Path) -> None:
    before = read(group)
    with pytest.raises(OutputExistsError, match="exists already; --force"):
        pour("continuum", group)
    assert read(group).identical(before)
    assert pour("continuum", group, LONGER, force=True)
    assert read(group).sizes["time"] == before.sizes["time"]
    assert float(read(group)["time"][-1]) > 99
    with xr.open_datatree(group.parent, engine="zarr") as tree:
        assert float(tree["continuum"]["time"][-1]) > 99


class Killed(BaseException):
    """No error that anybody handles."""


@pytest.mark.parametrize(
    ("moment", "left"),
    [("replaced", "old"), ("continuum", "old"), ("list", "new")],
)
def test_a_pour_killed_while_it_replaces_a_group_loses_neither(
    group: Path, monkeypatch, moment: str, left: str
) -> None:
    """Killed before the old one is put aside, between that and the new one's name, and after it."""
    rename, consolidate, calls = Path.rename, zarr.consolidate_metadata, iter("ab")

    def rename_or_die(part: Path, path: Path) -> Path:
        if path.name == moment:
            raise Killed
        return rename(part, path)

    def list_or_die(*arguments, **how):
        if moment == "list" and next(calls) == "b":  # the first lists what there is before
            raise Killed
        return consolidate(*arguments, **how)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "rename", rename_or_die)
        patch.setattr(zarr, "consolidate_metadata", list_or_die)
        with pytest.raises(Killed):
            pour("continuum", group, LONGER, force=True)
    assert group.exists() == (moment != "continuum")
    assert "consolidated_metadata" not in json.loads((group.parent / "zarr.json").read_text())
    with xr.open_zarr(group.parent, group="ca_model", consolidated=False) as other:
        assert other.attrs["model"] == "ca_model"
    with pytest.raises(OutputExistsError, match="exists already"):
        pour("continuum", group)
    with xr.open_zarr(group.parent, group="continuum") as listed:
        assert float(listed["time"][-1]) == float(read(group)["time"][-1])
        assert (float(listed["time"][-1]) > 99) == (left == "new")
    assert pour("continuum", group, LONGER, force=True)
    assert float(read(group)["time"][-1]) > 99
    assert [entry.name for entry in group.parent.parent.iterdir()] == ["run.zarr"]


def refused(group: Path) -> str:
    """The one line with which all that read a group refuse it."""
    with pytest.raises(ArchiveError) as refusal:
        read(group)
    with pytest.raises(ArchiveError):
        load(str(group))
    assert "\n" not in str(refusal.value)
    assert repr(str(group)) in str(refusal.value)
    return str(refusal.value)


def test_a_damaged_chunk_is_refused(group: Path) -> None:
    chunk = group / "height" / "c.0.0"
    damaged = bytearray(chunk.read_bytes())
    damaged[len(damaged) // 2] ^= 1
    chunk.write_bytes(damaged)
    assert "checksum" in refused(group)


@pytest.mark.parametrize("lost", ["height/c.0.0", "species_name/c.0", "time/c.0"])
def test_a_lost_chunk_is_refused(group: Path, lost: str) -> None:
    (group / lost).unlink()
    assert "its content is not that of content_sha256" in refused(group)


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [
        ("zarr.json", "50.0", "51.0"),
        ("zarr.json", '"attributes": {', '"attributes": '),
        ("zarr.json", "content_sha256", "content_sha255"),
        ("height/zarr.json", '"units": "cm"', '"units": "m"'),
        ("height/zarr.json", '"float64"', '"int64"'),
        ("height/zarr.json", '"x"', '"z"'),
        ("height/zarr.json", "21,", "20,"),
        ("time/zarr.json", "21", "210000000000000"),
        ("height/zarr.json", "{", ""),
    ],
)
def test_damaged_metadata_are_refused(group: Path, file: str, old: str, new: str) -> None:
    told = (group / file).read_text()
    assert old in told
    (group / file).write_text(told.replace(old, new, 1))
    refused(group)


@pytest.mark.parametrize("lost", ["height", "deposit_fraction/zarr.json"])
def test_a_group_without_a_variable_is_refused(group: Path, lost: str) -> None:
    (group / lost).rename(group.parent.parent / "lost")
    assert "its content is not that of content_sha256" in refused(group)


@pytest.mark.parametrize("lost", ["height/c.0.0", "height/zarr.json"])
def test_a_damaged_group_is_not_gone_on_from(group: Path, lost: str) -> None:
    (group / lost).unlink()
    with pytest.raises(ArchiveError, match="its content is not that of"):
        pour("continuum", group, LONGER, extend=True)


def test_a_damaged_state_is_not_gone_on_from(group: Path) -> None:
    chunk = max((group / "state").rglob("c.*"), key=lambda path: path.stat().st_size)
    chunk.unlink()
    with pytest.raises(ArchiveError, match="its content is not that of"):
        pour("continuum", group, LONGER, extend=True)


def test_what_is_no_group_is_refused(tmp_path: Path) -> None:
    store = tmp_path / "run.zarr"
    with pytest.raises(ArchiveError, match="no such archive"):
        read(store / "continuum")
    xr.Dataset({"height": ("x", [1.0, 2.0])}).to_zarr(store, group="foreign", consolidated=False)
    with pytest.raises(ArchiveError, match="it carries no content_sha256"):
        read(store / "foreign")


def test_a_damaged_archive_is_poured_anew_with_force(group: Path) -> None:
    (group / "height" / "zarr.json").write_text("sand")
    assert pour("continuum", group, force=True)
    with xr.open_datatree(group.parent, engine="zarr") as tree:
        assert set(tree.children) == set(MODELS)


@pytest.mark.parametrize("text", ["sand", "3", "array"])
def test_a_damaged_root_is_refused_and_is_not_missed(group: Path, text: str) -> None:
    root = group.parent / "zarr.json"
    root.write_text((group / "height" / "zarr.json").read_text() if text == "array" else text)
    assert read(group).attrs["model"] == "continuum"
    with pytest.raises(ArchiveError, match=r"zarr.json' is not that of a store") as refusal:
        pour("continuum", group, force=True)
    assert "\n" not in str(refusal.value)
    root.unlink()
    assert pour("continuum", group, force=True)
    with xr.open_datatree(group.parent, engine="zarr") as tree:
        assert set(tree.children) == set(MODELS)


def test_what_else_a_store_says_and_holds_stays(group: Path) -> None:
    root = zarr.open_group(group.parent, mode="a")
    root.update_attributes({"cell": "the wide one"})
    xr.Dataset({"grains": ("x", [1.0])}).to_zarr(group.parent, group="mine", consolidated=False)
    assert pour("continuum", group, force=True)
    with xr.open_datatree(group.parent, engine="zarr") as tree:
        assert tree.attrs == {"cell": "the wide one"}
        assert set(tree.children) == {*MODELS, "mine"}


def test_a_damaged_archive_is_not_in_the_way_of_another(group: Path) -> None:
    (group / "height" / "zarr.json").write_text("sand")
    other = group.with_name("ca_model")
    assert pour("ca_model", other, force=True)
    assert read(other).attrs["model"] == "ca_model"


def test_a_store_that_cannot_be_made_is_one_clear_error(tmp_path: Path) -> None:
    (tmp_path / "run.zarr").write_text("precious")
    with pytest.raises(ArchiveError, match=r"run.zarr' cannot be written"):
        pour("continuum", tmp_path / "run.zarr" / "continuum")
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.zarr"]


def test_what_goes_to_files_only_says_so(tmp_path: Path) -> None:
    path = tmp_path / "run.zarr" / "ca_model"
    with pytest.raises(SetupError, match="to netCDF-4 files only"):
        ca_model.pour_to_disk(SETUP, path)
    with pytest.raises(ArchiveError, match="to netCDF-4 files only"):
        write(ca_model.pour(SETUP), path)
    assert list(tmp_path.iterdir()) == []


def test_without_zarr_it_says_what_to_install(group: Path, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "zarr", None)
    store = group.parent
    for use in (lambda: read(group), lambda: pour("continuum", store / "new")):
        with pytest.raises(ArchiveError, match=r"pip install 'stratify\[zarr\]'$"):
            use()
    assert not (store / "new").exists()
