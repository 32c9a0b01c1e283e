"""The look of every picture: one style file, one set of colours, one way to disk.

The colours are those of Okabe and Ito, some paler, and cividis: colour-blind eyes tell them apart.
"""

from contextlib import AbstractContextManager
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiment.archive.files import whole_file
from experiment.arrays import Floats
from experiment.errors import ArchiveError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = [
    "BLUE",
    "FRONT",
    "GREEN",
    "KINK",
    "LIGHT_BLUE",
    "LIGHT_YELLOW",
    "MARKS",
    "MODEL_NAMES",
    "ORANGE",
    "PURPLE",
    "SETTLED",
    "VERMILION",
    "edges",
    "save",
    "style",
]

BLUE, GREEN, ORANGE, VERMILION = "#0072b2", "#009e73", "#e69f00", "#d55e00"
PURPLE = "#cc79a7"
LIGHT_BLUE, LIGHT_YELLOW = "#7fc4ea", "#f5e5a3"
KINK: dict[str, Any] = {"color": VERMILION, "linewidth": 1.6}
FRONT: dict[str, Any] = {"color": BLUE, "linewidth": 1.6}
SETTLED: dict[str, Any] = {"color": "0.4", "linestyle": ":"}
MODEL_NAMES = {"ca_model": "lattice", "continuum": "continuum"}
MARKS: dict[str, dict[str, Any]] = {
    "ca_model": {"color": VERMILION, "marker": "s"},
    "continuum": {"color": BLUE, "marker": "o"},
}
# So that a picture of the same is the same file, byte for byte.
UNDATED: dict[str, dict[str, None]] = {".pdf": {"CreationDate": None}, ".svg": {"Date": None}}


def style() -> AbstractContextManager[None]:
    """Within it, pictures are drawn in the style of this house."""
    import matplotlib

    return matplotlib.rc_context(fname=str(files(__package__) / "stratify.mplstyle"))


def save(figure: "Figure", path: Path, *, force: bool = False) -> Path:
    """Write a picture whole or not at all, in the format that the name tells."""
    formats = figure.canvas.get_supported_filetypes()
    if path.suffix.removeprefix(".") not in formats:
        endings = ", ".join(f".{name}" for name in sorted(formats))
        raise ArchiveError(f"{str(path)!r} cannot be written: it should end in one of {endings}")
    with whole_file(path, force=force) as part:
        figure.savefig(part, metadata=UNDATED.get(path.suffix))
    return path


def edges(middles: Floats) -> tuple[float, float]:
    """Lower edge of the first and upper edge of the last of evenly spaced cells."""
    half = (middles[1] - middles[0]) / 2
    return float(middles[0] - half), float(middles[-1] + half)
