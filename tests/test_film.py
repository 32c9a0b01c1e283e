"""Films of a pour: as long as asked, showing what the archive says, whole or not at all."""

import gc
import os
import signal
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner
from matplotlib.colors import to_rgb
from numpy.typing import NDArray

import compare
import continuum
from compare.cli import cli
from compare.pictures import film
from compare.pictures.frame import Frames
from compare.pictures.stage import FEED, Pixels
from compare.pictures.style import KINK
from compare.quantities import coarseness
from experiment import ArchiveError, NotApplicableError, OutputExistsError, SetupError, load
from experiment.archive import write

MOST = Pixels(960, 720)
STRIPES = ("pour.duration=900.0", "pour.records=300", "continuum.cells=200")
Pixel = NDArray[np.uint8]


@pytest.fixture(scope="module", params=["ca_model", "continuum"])
def archive(request: pytest.FixtureRequest, poured: Callable[..., xr.Dataset]) -> xr.Dataset:
    return poured(request.param, "makse-stratification", *STRIPES)


@pytest.fixture(scope="module")
def frames(archive: xr.Dataset) -> Frames:
    return Frames(archive, MOST)


@pytest.fixture(scope="module")
def short(poured: Callable[..., xr.Dataset]) -> xr.Dataset:
    return poured("continuum", "makse-stratification", *STRIPES)


def seen(path: Path) -> tuple[dict[str, object], list[Pixel]]:
    """What ffmpeg tells of a film, and its frames (row, column, RGB)."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)  # of pipes that the reader leaves open
        told, *frames = imageio_ffmpeg.read_frames(str(path))
        gc.collect()
    width, height = told["size"]
    return told, [np.frombuffer(frame, np.uint8).reshape(height, width, 3) for frame in frames]


def pixel(frames: Frames, x: float, z: float) -> tuple[int, int]:
    """Row and column of the picture at x and z [cm]."""
    right, up = frames.stage.axes.transData.transform((x, z))
    return frames.size.height - 1 - int(up), int(right)


def colour(frames: Frames, species: int) -> Pixel:
    return np.round(255 * frames.stage.colours[species, :3]).astype(np.uint8)


def assert_alike(found: Pixel, wanted: object, within: int = 12) -> None:
    assert np.abs(found.astype(int) - np.asarray(wanted, int)).max() <= within


def test_a_film_is_as_long_and_as_fast_as_asked(archive: xr.Dataset, tmp_path: Path) -> None:
    path = compare.animate(archive, tmp_path / "pour.mp4", seconds=2.0, fps=12.0)
    told, pictures = seen(path)
    assert (told["codec"], told["fps"], told["duration"]) == ("h264", 12.0, 2.0)
    assert str(told["pix_fmt"]).startswith("yuv420p")
    assert len(pictures) == imageio_ffmpeg.count_frames_and_secs(str(path))[0] == 24
    assert told["size"] == Frames(archive, MOST).size
    assert not any(side % 2 for side in Frames(archive, MOST).size)


def test_a_gif_has_its_frames_and_no_sample_of_its_colours(
    short: xr.Dataset, tmp_path: Path
) -> None:
    told, pictures = seen(compare.animate(short, tmp_path / "pour.gif", seconds=3.0))
    assert (told["codec"], told["fps"], len(pictures)) == ("gif,", 10.0, 30)
    frames = Frames(short, Pixels(640, 540))
    x, top = float(short["x"][60]), float(short["height"][-1, 60])
    assert (pictures[0][pixel(frames, x, top - 2.0)] == 255).all()
    assert not (pictures[-1][pixel(frames, x, top - 2.0)] == 255).all()


def test_there_is_air_where_the_pile_is_to_grow_and_the_deposit_in_the_end(
    archive: xr.Dataset, tmp_path: Path
) -> None:
    """In the decoded film, against the archive and its colour map."""
    _, pictures = seen(compare.animate(archive, tmp_path / "pour.mp4", seconds=1.0, fps=10.0))
    frames = Frames(archive, MOST)
    coarse = coarseness(archive["deposit_fraction"], archive)
    first, last = [], []
    for column in range(10, archive.sizes["x"], 12):
        laid = archive["height"][[0, -1], column].values
        x = float(archive["x"][column])
        z = laid[0] + 0.5 * (laid[1] - laid[0])
        row, place = pixel(frames, x, z)
        window = (slice(row - 8, row + 9), slice(place - 8, place + 9))
        first.append(pictures[0][row, place])
        seen_here = pictures[-1][window].mean(axis=(0, 1))
        size = frames.stage.axes.transData.inverted().transform([(0, 0), (8, 8)])
        half = size[1] - size[0]
        laid_here = coarse.sel(x=slice(x - half[0], x + half[0]), z=slice(z - half[1], z + half[1]))
        last.append((seen_here[2] - seen_here[0], float(laid_here.mean())))
    assert_alike(np.array(first), 255, within=2)
    blueness, share = np.array(last).T
    assert np.corrcoef(blueness, share)[0, 1] < -0.9


def test_what_rolls_is_of_its_colour_small_grains_below(
    archive: xr.Dataset, frames: Frames
) -> None:
    """And each band is as thick as the archive says, times what the picture says."""
    thinner = archive["rolling_thickness"].min("species").values[:, 20:-20]
    record, column = np.add(np.unravel_index(thinner.argmax(), thinner.shape), (0, 20))
    picture = np.array(frames.at(float(archive["time"][record])))[..., :3]
    height, rolling = (archive[v][record, column].values for v in ("height", "rolling_thickness"))
    drawn = rolling * frames.stage.magnified
    x = float(archive["x"][column])
    assert_alike(picture[pixel(frames, x, height + 0.6 * drawn[0])], colour(frames, 0))
    assert_alike(picture[pixel(frames, x, height + drawn[0] + 0.6 * drawn[1])], colour(frames, 1))
    assert_alike(picture[pixel(frames, x, height + drawn.sum() + 2.0)], 255)
    told = [text.get_text() for text in frames.stage.canvas.figure.legends[0].get_texts()]
    assert f"rolling layer: {frames.stage.magnified} times as thick" in told


def test_a_kink_is_marked_where_it_is(archive: xr.Dataset, frames: Frames) -> None:
    kink = archive.strata.kinks().isel(event=0)
    passage = kink["passage"].dropna("x")[60]
    picture = np.array(frames.at(float(passage)))[..., :3]
    rows, columns = np.nonzero((picture == np.round(255 * np.array(to_rgb(KINK["color"])))).all(-1))
    below_legend = rows > frames.size.height * 0.2
    z = float(archive["height"].interp(time=float(passage), x=float(passage["x"])))
    row, column = pixel(frames, float(passage["x"]), z)
    assert columns[below_legend].mean() == pytest.approx(column, abs=4)
    assert rows[below_legend].max() == pytest.approx(row, abs=5)


def test_marks_and_the_clock_are_those_of_the_moment(archive: xr.Dataset, frames: Frames) -> None:
    time = float(archive.strata.fronts().isel(event=1)["passage"].dropna("x")[20])
    moment = frames.course.at(time)
    frames.at(time)
    assert len(moment.fronts) > 0
    np.testing.assert_array_equal(frames.fronts.get_xydata(), moment.fronts)
    np.testing.assert_array_equal(frames.kinks.get_xydata(), moment.kinks)
    assert frames.stage.canvas.figure.texts[1].get_text() == f"t = {time:.0f} s"


def test_the_deposit_has_no_hole_that_a_pile_once_higher_could_show(frames: Frames) -> None:
    [deposit] = frames.stage.axes.images
    assert np.isfinite(np.ma.filled(deposit.get_array(), np.nan)).all()


def test_a_travelling_spout_is_drawn_where_it_pours(poured: Callable[..., xr.Dataset]) -> None:
    frames = Frames(poured("ca_model", "stockpile", "pour.duration=5.0", "pour.records=10"), MOST)
    source = load("stockpile").feed.source
    assert source is not None
    [stream] = [line for line in frames.stage.axes.lines if line.get_color() == FEED["color"]]
    for time in (1.0, 4.0):
        frames.at(time)
        [spout] = source.position(np.array([time]))
        assert stream.get_xdata() == pytest.approx([spout, spout])


def test_a_part_of_the_pour_is_shown_from_its_start_to_its_end(
    short: xr.Dataset, tmp_path: Path
) -> None:
    options = {"seconds": 1.0, "fps": 5.0, "start": 300.0, "end": 600.0}
    _, pictures = seen(compare.animate(short, tmp_path / "part.mp4", **options))
    frames = Frames(short, MOST)
    for picture, time in ((pictures[0], 300.0), (pictures[-1], 600.0)):
        drawn = np.array(frames.at(time))[..., :3].astype(float)
        assert np.abs(picture - drawn).mean() < 3.0


@pytest.mark.parametrize("preset", ["ternary", "heap", "stockpile", "franks", "bcre"])
def test_nothing_overlaps_in_any_cell(preset: str, poured: Callable[..., xr.Dataset]) -> None:
    model = "continuum" if preset == "bcre" else "ca_model"
    archive = poured(model, preset, "pour.duration=5.0", "pour.records=10")
    for most in (MOST, Pixels(640, 540)):
        frames = Frames(archive, most)
        frames.at(2.5)
        axes, canvas = frames.stage.axes, frames.stage.canvas
        title, clock = (text.get_window_extent() for text in canvas.figure.texts)
        legend = canvas.figure.legends[0].get_window_extent()
        tight = axes.get_tightbbox()
        assert title.x1 < clock.x0
        assert legend.y1 < title.y0
        assert tight.y1 < legend.y0
        assert min(tight.x0, tight.y0) > 0
        assert legend.x1 <= frames.size.width
        assert max(frames.size) <= 1.1 * most.width


def test_a_film_that_fails_leaves_nothing(
    short: xr.Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(share: float) -> None:
        if share > 0.5:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        compare.animate(short, tmp_path / "pour.mp4", seconds=1.0, progress=fail)
    assert list(tmp_path.iterdir()) == []
    unknown = film.FORMATS[".mp4"]._replace(arguments=("-c:v", "no-such-codec"))
    monkeypatch.setitem(film.FORMATS, ".mp4", unknown)
    with pytest.raises(ArchiveError, match=r"pour.mp4' cannot be written: ffmpeg: .*no-such-codec"):
        compare.animate(short, tmp_path / "pour.mp4", seconds=1.0)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_film_that_is_stopped_leaves_no_half_of_it_and_no_ffmpeg(
    short: xr.Dataset, tmp_path: Path, number: signal.Signals
) -> None:
    write(short, tmp_path / "run.nc")
    script = (
        "import sys\n"
        "from compare.cli import main\n"
        "from compare.pictures import film\n"
        "Popen, at = film.Popen, film.Frames.at\n"
        "started = []\n"
        "def start(*args, **kwargs):\n"
        "    started.append(Popen(*args, **kwargs))\n"
        "    return started[0]\n"
        "def tell(frames, time):\n"
        "    print(started[0].pid, flush=True)\n"
        "    return at(frames, time)\n"
        "film.Popen, film.Frames.at = start, tell\n"
        "sys.argv = ['stratify', 'animate', 'run.nc', '--seconds=3600']\n"
        "main()\n"
    )
    command = [sys.executable, "-c", script]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, cwd=tmp_path, stdout=pipe, stderr=pipe, text=True) as filming:
        assert filming.stdout is not None
        ffmpeg = int(filming.stdout.readline())
        filming.send_signal(number)
        _, told = filming.communicate(timeout=20)
    assert told.strip() == "stratify: stopped; what was not yet written under its name is lost"
    assert filming.returncode == 2
    assert [path.name for path in tmp_path.iterdir()] == ["run.nc"]
    with pytest.raises(ProcessLookupError):
        os.kill(ffmpeg, 0)


def test_what_cannot_be_filmed_says_so(
    short: xr.Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "pour.mp4"
    with pytest.raises(ArchiveError, match=r"'pour.avi'.* should end in .mp4 or .gif"):
        compare.animate(short, Path("pour.avi"))
    with pytest.raises(SetupError, match=r"fps = 0: it should be between 1 and 120"):
        compare.animate(short, path, fps=0.0)
    with pytest.raises(SetupError, match=r"seconds = nan: it should be between 1 and 3600"):
        compare.animate(short, path, seconds=float("nan"))
    with pytest.raises(SetupError, match=r"to = 100: it should be between 300 and 900"):
        compare.animate(short, path, start=300.0, end=100.0)
    drum = load("drum-mixture", ["pour.duration=1.0", "pour.records=3"])
    with pytest.raises(NotApplicableError, match=r"cell.shape = 'drum'"):
        compare.animate(continuum.pour(drum), path)
    path.touch()
    with pytest.raises(OutputExistsError, match="exists already"):
        compare.animate(short, path)
    monkeypatch.setattr(film, "find_spec", lambda _: None)
    with pytest.raises(ArchiveError, match=r"pip install 'stratify\[film\]'"):
        compare.animate(short, path, force=True)


def test_the_command_films_a_group_of_a_store(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    run = CliRunner().invoke
    settings = [f"--set={setting}" for setting in STRIPES]
    pour = ["pour", "makse-stratification", "--model=continuum", *settings, "-o", "run.zarr"]
    run(cli, pour, catch_exceptions=False)
    command = ["animate", "run.zarr/continuum", "--seconds=1"]
    done = run(cli, command, catch_exceptions=False)
    assert done.output.splitlines()[-1] == "wrote run.continuum.mp4"
    assert imageio_ffmpeg.count_frames_and_secs("run.continuum.mp4") == (25, 1.0)
    assert isinstance(run(cli, command).exception, OutputExistsError)
    Path("folder.mp4").mkdir()
    onto_a_folder = run(cli, [*command, "-o", "folder.mp4", "--force"])
    assert str(onto_a_folder.exception) == "'folder.mp4' cannot be written: it is a folder"
    assert "filmed" not in onto_a_folder.output
