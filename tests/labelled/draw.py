"""Contact sheets of the labelled pours: each deposit's coarseness, and nothing measured.

    python -m tests.labelled.draw

pours every run of runs.toml and writes sheet-1.png, sheet-2.png, ... beside it.
"""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

import ca_model
import continuum
from compare.quantities import coarseness
from experiment import load

__all__ = ["draw_deposit", "draw_sheet", "pour_run", "read_runs"]

HERE = Path(__file__).parent
MODELS = {"ca_model": ca_model, "continuum": continuum}
ROWS, COLUMNS = 3, 4
COLOURS = 128


def read_runs() -> list[dict[str, Any]]:
    """Each run's index, model, preset, settings, label, and whether that is certain."""
    runs: list[dict[str, Any]] = tomllib.loads((HERE / "runs.toml").read_text())["run"]
    return runs


def pour_run(run: dict[str, Any]) -> xr.Dataset:
    """The archive of one run."""
    archive: xr.Dataset = MODELS[run["model"]].pour(load(run["preset"], run["settings"]))
    return archive


def draw_deposit(axes: Axes, index: int, archive: xr.Dataset) -> None:
    """The whole deposit, small grains dark and large ones bright, as high and wide as the panel."""
    coarse = coarseness(archive["deposit_fraction"], archive).transpose("z", "x")
    axes.imshow(np.flipud(coarse.values), cmap="cividis", vmin=0.0, vmax=1.0, aspect="auto")
    axes.text(0.98, 0.96, str(index), transform=axes.transAxes, ha="right", va="top")


def draw_sheet(runs: list[dict[str, Any]], path: Path) -> None:
    """Draw up to twelve `runs`, 300 x 220 pixels each, in few enough colours for a small file."""
    figure = Figure(figsize=(3.0 * COLUMNS, 2.2 * ROWS), dpi=100, layout="constrained")
    panels = list(figure.subplots(ROWS, COLUMNS).flat)
    for axes in panels:
        axes.set_axis_off()
    for axes, run in zip(panels, runs, strict=False):
        draw_deposit(axes, run["index"], pour_run(run))
    figure.savefig(path)
    with Image.open(path) as image:
        few = image.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
    few.save(path, optimize=True)


def main() -> None:
    """Draw all the sheets."""
    runs, size = read_runs(), ROWS * COLUMNS
    for number, first in enumerate(range(0, len(runs), size), start=1):
        draw_sheet(runs[first : first + size], HERE / f"sheet-{number}.png")


if __name__ == "__main__":
    main()
