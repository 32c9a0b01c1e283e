"""Where mixtures stratify, and where they segregate: Makse, Fig. `phase`, as it is measured.

"Phase diagram for two-dimensional flows of granular mixtures. We distinguish the regions of
stratification and strong segregation. Weak segregation is expected in the shaded region when the
size ratio is close to one": Makse, PRE 56, 7008 (1997), section V, over d2 / d1 and
delta = theta_22 - theta_11, with deposits for "stratification: delta = 0.25, psi = 0.3, gamma = 1,
cross rates 0.1, v = 1, R_a^0 = 0.5, and segregation: the same parameters except for delta = -0.1".

Every point is a pour of the continuum (`makse-segregation`, 200 cells), measured as any other. The
paper says that psi grows with the size ratio q = d2 / d1, not how. Taken here is the geometry of
disks: one of diameter d2 in the hollow between two of d1 that touch rolls out at an angle whose
sine is 1 / (1 + q), a tangent of 1 / sqrt(q (q + 2)), so that

    psi(q) = theta_11 - theta_21 = 1 / sqrt(3) - 1 / sqrt(q (q + 2))

It is 0 for equal grains and has no free number: 0.22 for q = 2, 0.3 for q = 2.74, 0.32 for q = 3,
where 0.1 to 0.3 was measured (glass and sugar). The mean diameter stays 0.1 cm.

Near q = 1 the collision functions bend over more than psi (Fig. `functions`). Their `smoothing` is
that of preset `canonical`, 0.1, which is psi for q = 1.32. How strong segregation is, is a matter
of degree: its order parameter is the shade, and 0.5, from which on it counts as strong, a line.
"""

import math
from collections.abc import Sequence
from string import ascii_lowercase
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from compare.campaign import Pour, campaign
from compare.pictures.paper.look import page
from compare.pictures.style import BLUE, LIGHT_BLUE, ORANGE, edges, style
from compare.quantities import named
from compare.regimes import SEGREGATED
from experiment import Experiment, load
from experiment.pouring import Progress

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_regimes", "psi_of", "regimes_over_size_and_shape"]

PRESET = "makse-segregation"
ALIKE = {"mixture.smoothing": 0.1, "continuum.cells": 200, "pour.records": 300}
MEAN_DIAMETER = 0.1  # cm
RATIOS = tuple(np.linspace(1.05, 2.95, 20).tolist())
DELTAS = tuple(np.linspace(-0.2875, 0.2875, 24).tolist())
EXAMPLES = ((0.3, 0.25), (0.3, -0.1), (0.03, -0.1))  # psi and delta; two are the caption's
LAYERS = {"stratified": BLUE, "layered-and-segregated": LIGHT_BLUE}
STRONGEST = ORANGE
PSI_TICKS = (0.0, 0.1, 0.2, 0.3)
WORDS: tuple[tuple[float, float, str, dict[str, Any]], ...] = (  # delta, d2 / d1
    (-0.19, 2.0, "strong segregation", {}),
    (-0.21, 1.15, "weak segregation", {}),
    (0.18, 2.0, "stratification", {"color": "white"}),
    (0.025, 2.45, "layers, and segregation", {"rotation": "vertical"}),
)
MARK: dict[str, Any] = {"boxstyle": "circle,pad=0.15", "facecolor": "white", "linewidth": 0.6}
MEASURED = ("regime", "segregation", "layered_share")


def psi_of(ratio: float) -> float:
    """The step psi of repose slopes (tangents) between disks whose diameters are in this ratio."""
    return 1.0 / math.sqrt(3.0) - 1.0 / math.sqrt(ratio * (ratio + 2.0))


def ratio_of(psi: float) -> float:
    """The size ratio d2 / d1 that gives `psi`."""
    return math.sqrt(1.0 + (1.0 / math.sqrt(3.0) - psi) ** -2) - 1.0


def regimes_over_size_and_shape(
    ratios: Sequence[float] = RATIOS,
    deltas: Sequence[float] = DELTAS,
    *,
    workers: int | None = None,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Regime, segregation and layered_share (size_ratio, delta) of pours of the continuum.

    Beside them psi (size_ratio,); and deposit (example, row, column), the columns of three of them
    let down to one floor, with example_size_ratio and example_delta (example,). `workers` and
    `progress` are those of :func:`compare.campaign`.
    """
    pours = [_setup(ratio, delta) for ratio in ratios for delta in deltas]
    found = campaign(pours, ["continuum"], workers=workers, progress=progress).isel(model=0)
    shape = len(ratios), len(deltas)
    over = ("size_ratio", "delta")
    shown = [_setup(ratio_of(psi), delta) for psi, delta in EXAMPLES]
    pictures = [Pour("continuum", setup, picture=True)().picture for setup in shown]
    size, difference = named("size ratio d2 / d1"), named("delta = theta_22 - theta_11")
    return xr.Dataset(
        {name: (over, found[name].values.reshape(shape), found[name].attrs) for name in MEASURED}
        | {
            "deposit": (
                ("example", "row", "column"),
                np.array(pictures),
                named("fraction of large grains, columns let down to one floor"),
            ),
            "example_size_ratio": ("example", [ratio_of(psi) for psi, _ in EXAMPLES], size),
            "example_delta": ("example", [delta for _, delta in EXAMPLES], difference),
        },
        coords={
            "size_ratio": ("size_ratio", np.array(ratios), size),
            "delta": ("delta", np.array(deltas), difference),
            "psi": ("size_ratio", [psi_of(q) for q in ratios], named("psi = theta_11 - theta_21")),
        },
        attrs={"title": "Regimes over size ratio and difference in repose slope"},
    )


def _setup(ratio: float, delta: float) -> Experiment:
    small = 2.0 * MEAN_DIAMETER / (1.0 + ratio)
    mixture = {
        "mixture.grain_diameter": [small, ratio * small],
        "mixture.psi": psi_of(ratio),
        "mixture.delta": delta,
    }
    return load(PRESET).with_values(ALIKE | mixture)


def draw_regimes(found: xr.Dataset) -> "Figure":
    """Draw the map of regimes and, beside it, the deposits at the lettered points."""
    with style():
        figure = page(4.8)
        left, right = figure.subfigures(1, 2, squeeze=False, width_ratios=[2.6, 1.0])[0]
        axes = left.subplots()
        _draw_map(axes, found)
        frames = right.subplots(len(EXAMPLES), 1, squeeze=False)[:, 0]
        for k, frame in enumerate(frames):
            _draw_example(frame, axes, found.isel(example=k), ascii_lowercase[k])
        frames[-1].set_xlabel("small grains dark, large bright")
    return figure


def _draw_map(axes: "Axes", found: xr.Dataset) -> None:
    """Layers in blue; elsewhere the degree of segregation, and the line where it is SEGREGATED."""
    from matplotlib.colors import LinearSegmentedColormap, ListedColormap

    regime = found["regime"].values
    delta, ratio = found["delta"].values, found["size_ratio"].values
    apart = np.where(np.isin(regime, list(LAYERS)), np.nan, found["segregation"].values)
    extent = (*edges(delta), *edges(ratio))
    shades = LinearSegmentedColormap.from_list("segregation", ["white", STRONGEST])
    image = axes.imshow(apart, extent=extent, cmap=shades, vmin=0, vmax=1, rasterized=True)
    for name, colour in LAYERS.items():
        cells = np.where(regime == name, 1.0, np.nan)
        axes.imshow(cells, extent=extent, cmap=ListedColormap([colour]), rasterized=True)
    axes.contour(delta, ratio, apart, [SEGREGATED], colors="black", linewidths=1.0)
    axes.axvline(0.0, color="black", linestyle="--", linewidth=1.2)
    axes.set(xlabel=r"$\delta = \theta_{22} - \theta_{11}$", ylabel="size ratio, $d_2 / d_1$")
    right = axes.secondary_yaxis("right")
    right.set_yticks([ratio_of(psi) for psi in PSI_TICKS], [f"{psi:g}" for psi in PSI_TICKS])
    right.set_ylabel(r"$\psi$ of this size ratio")
    bar = axes.figure.colorbar(image, ax=axes, location="bottom", aspect=40)
    bar.set_label("degree of segregation, where there are no layers")
    bar.ax.axvline(SEGREGATED, color="black")
    for x, y, words, how in WORDS:
        axes.text(x, y, words, ha="center", va="center", **how)


def _draw_example(frame: "Axes", axes: "Axes", at: xr.Dataset, name: str) -> None:
    """A deposit, and its letter on the map."""
    frame.imshow(at["deposit"].values, vmin=0, vmax=1, rasterized=True)
    frame.set(xticks=[], yticks=[])
    delta, ratio = float(at["example_delta"]), float(at["example_size_ratio"])
    axes.text(delta, ratio, name, ha="center", va="center", weight="bold", bbox=MARK)
    frame.set_title(
        rf"$\mathbf{{{name}}}$  $\delta = {delta:+g}$, $d_2/d_1 = {ratio:.3g}$", loc="left"
    )
