"""Films of archives: the pile grows, grains roll down it, kinks climb.

    frames -> ffmpeg -> .mp4 (H.264, 4:2:0: what every player knows), .gif (one palette)

Needs imageio-ffmpeg, `pip install 'stratify[film]'`, which brings ffmpeg along; nothing of it is
imported before it is used.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path
from subprocess import PIPE, Popen
from typing import IO, NamedTuple, cast

import numpy as np
import xarray as xr

from compare.pictures.frame import Frames
from compare.pictures.stage import Pixels
from experiment.archive.files import refuse_existing, whole_file
from experiment.errors import ArchiveError, SetupError

__all__ = ["animate"]

LONGEST = 3600.0  # s
SAMPLES = 8  # frames sent ahead of a .gif, from which its colours are chosen
PALETTE = (
    f"split[all][film];[all]trim=end_frame={SAMPLES},palettegen[palette];"
    f"[film]trim=start_frame={SAMPLES},setpts=PTS-STARTPTS[frames];"
    "[frames][palette]paletteuse=dither=none:diff_mode=rectangle"
)
BT709 = "scale=out_color_matrix=bt709:out_range=tv,format=yuv420p,setparams=colorspace=bt709"


class Format(NamedTuple):
    """How a kind of film is made, unless the user wants it otherwise."""

    fps: float
    seconds: float
    most: Pixels
    samples: int
    arguments: tuple[str, ...]  # of ffmpeg
    fastest: float = 120.0  # frames/s


FORMATS = {
    ".mp4": Format(
        25,
        20,
        Pixels(960, 720),
        0,
        ("-vf", BT709, "-c:v", "libx264", "-crf", "20", "-movflags", "+faststart"),
    ),
    ".gif": Format(10, 12, Pixels(640, 540), SAMPLES, ("-filter_complex", PALETTE), 50.0),
}


def animate(
    archive: xr.Dataset,
    path: Path,
    *,
    fps: float | None = None,
    seconds: float | None = None,
    start: float | None = None,
    end: float | None = None,
    force: bool = False,
    progress: Callable[[float], object] | None = None,
) -> Path:
    """Make a film of an archive, .mp4 or .gif, whole or not at all.

    It shows the pour between the times `start` and `end` [s], by default all of it, in `seconds`
    (default: 20, a .gif 12) at `fps` frames a second (25, a .gif 10). `progress` is called with the
    share that is done.

    Raises :class:`NotApplicableError` for a drum, :class:`SetupError` for an option out of bounds,
    :class:`OutputExistsError` where `path` exists and `force` is not given, and
    :class:`ArchiveError` where it cannot be written.
    """
    kind = _kind(path)
    refuse_existing([path], force=force)
    fps = _within("fps", kind.fps if fps is None else fps, 1.0, kind.fastest)
    seconds = _within("seconds", kind.seconds if seconds is None else seconds, 1.0, LONGEST)
    frames = Frames(archive, kind.most)
    first, last = frames.course.records[[0, -1]]
    start = _within("from", first if start is None else start, first, last)
    end = _within("to", last if end is None else end, start, last)
    times = np.linspace(start, end, round(fps * seconds))
    with whole_file(path, force=force) as part, _ffmpeg(part, frames.size, fps, kind) as film:
        for time in np.linspace(start, end, kind.samples):
            film.write(frames.at(time))
        for done, time in enumerate(times, start=1):
            film.write(frames.at(time))
            if progress is not None:
                progress(done / len(times))
    return path


def _kind(path: Path) -> Format:
    """The format that the name of a film tells."""
    if path.suffix not in FORMATS:
        allowed = " or ".join(FORMATS)
        raise ArchiveError(f"{str(path)!r} cannot be written: a film should end in {allowed}")
    if find_spec("imageio_ffmpeg") is None:
        raise ArchiveError("films are the work of imageio-ffmpeg: pip install 'stratify[film]'")
    return FORMATS[path.suffix]


def _within(name: str, value: float, least: float, most: float) -> float:
    if not least <= value <= most:
        raise SetupError(f"{name} = {value:g}: it should be between {least:g} and {most:g}")
    return float(value)


@contextmanager
def _ffmpeg(part: Path, size: Pixels, fps: float, kind: Format) -> Iterator[IO[bytes]]:
    """Where frames are written to become the film `part`; no ffmpeg outlives it.

    Ctrl-C at the terminal is left to this process, which ends ffmpeg. Raises
    :class:`RuntimeError` with what ffmpeg says where it fails.
    """
    from imageio_ffmpeg import get_ffmpeg_exe

    raw = ("-f", "rawvideo", "-pix_fmt", "rgba", "-s", f"{size.width}x{size.height}")
    command = [get_ffmpeg_exe(), "-v", "error", "-y", *raw, "-r", f"{fps}", "-i", "-"]
    ffmpeg = Popen([*command, *kind.arguments, part], stdin=PIPE, stderr=PIPE, process_group=0)  # noqa: S603
    try:
        with suppress(BrokenPipeError):  # ffmpeg has ended and tells why
            yield cast(IO[bytes], ffmpeg.stdin)
        _, told = ffmpeg.communicate()
    finally:
        ffmpeg.kill()
        with suppress(BrokenPipeError):
            ffmpeg.__exit__(None, None, None)
    if ffmpeg.returncode != 0:
        raise RuntimeError(f"ffmpeg: {told.decode(errors='replace')}")
