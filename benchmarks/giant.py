"""A giant pile: 10^5 columns and 10^9 grains, poured to disk, and a coarse picture of it.

The grains of the lattice-stratification preset roll down a start slope of 0.4, which is 30 times
as high as what is poured onto it: the picture counts heights from there. A pair of layers is some
ten grains thick, a thousandth of the pile, so no pixel of the whole pile shows them. Beneath it are
drawn the lowest 30 cm of it, all along, and 30 cm of 10 m in its middle.
"""

import resource
import sys
import time
from pathlib import Path

from ca_model.stream import pour_to_disk, read_section
from compare.pictures import draw_deposit, save, style
from experiment import Experiment, load

COLUMNS = 100_000
GRAINS = 10**9
GRAINS_A_STEP = 3
FOLDER = Path("pours")
BAND = 30.0  # cm
MIDDLE = (50_000.0, 51_000.0)  # cm
WHOLE, FINE = (500, 1000), (5000, 500)  # cells (z, x)


def giant() -> Experiment:
    steps = -(-GRAINS // GRAINS_A_STEP)
    settings = [f"cell.length={COLUMNS}.0", f"pour.duration={steps}.0", "pour.records=1"]
    return load("lattice-stratification", ["title='A giant pile'", *settings])


def peak_memory() -> float:
    """The most memory [MB] that this process ever held."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1e6 if sys.platform == "darwin" else 1e3)


def draw(path: Path) -> Path:
    from matplotlib.figure import Figure

    whole = read_section(path, WHOLE, above_base=True)
    fine = read_section(path, FINE, above_base=True)
    middle = read_section(path, FINE, above_base=True, between=MIDDLE)
    half = float(middle["height"][-1].min()) / 2
    with style():
        figure = Figure(figsize=(9, 10))
        axes = figure.subplots(3, height_ratios=[2, 1, 1])
        for axis, section in zip(axes, (whole, middle, fine), strict=True):
            draw_deposit(axis, section)
            axis.set(title="", ylabel="z above the start slope (cm)")
        axes[1].set_ylim(half, half + BAND)
        axes[2].set_ylim(0, BAND)
        return save(figure, path.with_suffix(".png"), force=True)


def main() -> None:
    path = FOLDER / "giant.nc"
    start = time.perf_counter()
    pour_to_disk(giant(), path, force=True)
    took = time.perf_counter() - start
    size = path.stat().st_size
    print(f"{GRAINS:.0e} grains, {COLUMNS:.0e} columns  {took:8.0f} s")
    print(f"  a grain                  {took / GRAINS * 1e9:8.0f} ns")
    print(f"  peak memory              {peak_memory():8.0f} MB")
    print(f"  on disk                  {size / 1e6:8.0f} MB, {size / GRAINS:.3f} bytes a grain")
    start = time.perf_counter()
    picture = draw(path)
    took = time.perf_counter() - start
    print(f"{picture} drawn in {took:.0f} s, peak memory {peak_memory():.0f} MB")
