"""Between the rules: from the continuum's rates to the threshold rule, one change at a time.

`lattice-stratification` is poured with rates of collision. With one grain in contact, nothing set
rolling and a surface of one grain, capture at k times its rate is the threshold rule as k grows:
1 - exp(-k gamma P(theta - s) dt) is then 0 or 1. So there is a path, k, and a ladder of FACTORS:

    grains      an n-th of their height  ->  as tall as they are, in whole units
    layer       d thick and mixed        ->  the topmost grain
    digging     amplification            ->  none
    capture     at a rate                ->  below a threshold

All 16 corners of these are poured. What a factor changes depends on those changed before it: in
logarithms, the mean over all 24 orders (Shapley's value) adds up to the whole, and what it changes
first, from the rates, and last, before the threshold rule, tell how far there is one number.
"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import permutations, product
from typing import Any

import numpy as np
import xarray as xr
from rich.table import Table
from rich.text import Text

from compare.bridge.ensembles import means_over_piles, pour_piles, share_of, with_own_errors
from compare.campaign import campaign
from compare.convergence import QUANTITIES
from compare.quantities import named
from compare.table import with_error
from experiment import Experiment, load
from experiment.arrays import Floats
from experiment.pouring import Progress

__all__ = [
    "CORNERS",
    "FACTORS",
    "between",
    "between_table",
    "effects",
    "ladder",
    "lattice",
    "set_up",
    "sharpened",
]

PRESET = "lattice-stratification"
GAMMA, CROSS = 1.0, 0.1  # 1/s, and what of it unlike grains have
DEPTH, WIDTH, UNIT = 0.3, 1.0, 0.1  # cm; d: a small and a large grain; w and u: the preset's
FINENESS = 16
SHARPEST = 1e9
SHARPNESS = (1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1e3, 1e4, 1e5)
RATES = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)  # gamma, 1/s
CROSS_RATES = (0.01, 0.1, 1.0)  # of gamma
FACTORS = ("grains", "layer", "digging", "capture")
AMPLIFIED = ("1 / k", "none", "all")
WHEN = ("first", "mean", "last")
CORNERS = tuple(product((False, True), repeat=len(FACTORS)))
RUNGS = (
    "continuum, dx to 0",
    "continuum, dx = w",
    "small grains",
    "contacts = 1",
    "grains of their height",
    "topmost grain",
    "no amplification",
    "thresholds",
    "threshold rule",
)
COMMENT = "effects are 100 (ratio - 1) %, by logarithms; where piles are alike, a pile's own error"

Variables = dict[str, tuple[str | tuple[str, ...], Any, dict[str, str]]]


def between(
    seeds: int,
    workers: int | None,
    progress: Progress,
    *,
    fineness: int = FINENESS,
    sharpness: Sequence[float] = SHARPNESS,
    rates: Sequence[float] = RATES,
    duration: float = 40_000.0,
) -> xr.Dataset:
    """The ladder and the path in numbers: for each NAME of QUANTITIES, with a NAME_error beside it.

    NAME(rung) climbs from the continuum to the threshold rule; path_NAME(amplified, k) sharpens
    capture by single grains; corner_NAME(FACTORS) and effect_NAME(factor, when) [%] are as the
    module tells; rate_NAME(gamma) and cross_NAME(cross) are the continuum's with other rates.
    """
    base = set_up(duration)
    steps = ladder(base, fineness)
    poured = {
        "ladder": steps[2:],
        "corner": [lattice(base, fineness, *corner) for corner in CORNERS],
        "path": [sharpened(base, k, share) for share in AMPLIFIED for k in sharpness],
    }
    found = _of_piles(poured, seeds, workers, share_of(progress, 0.0, 0.9))
    others = [(gamma, CROSS) for gamma in rates] + [(GAMMA, cross) for cross in CROSS_RATES]
    grids = [*steps[:2], *(_with_rates(base, *pair) for pair in others)]
    continuum = _measured(grids, workers, share_of(progress, 0.9, 1.0))
    by_cross = len(grids) - len(CROSS_RATES)
    told: Variables = {}
    for name in QUANTITIES:
        units = str(found["ladder"][name].attrs["units"])
        corner = _pair(found["corner"], name, (2,) * len(FACTORS))
        grid = _pair(continuum, name)
        rungs = np.hstack([grid[:, :2], _pair(found["ladder"], name)])
        path = _pair(found["path"], name, (len(AMPLIFIED), len(sharpness)))
        told |= _told(name, "rung", rungs, units)
        told |= _told(f"path_{name}", ("amplified", "k"), path, units)
        told |= _told(f"rate_{name}", "gamma", grid[:, 2:by_cross], units)
        told |= _told(f"cross_{name}", "cross", grid[:, by_cross:], units)
        told |= _told(f"corner_{name}", FACTORS, corner, units)
        told |= _told(f"effect_{name}", ("factor", "when"), effects(*corner), "percent")
    layered = found["ladder"]["wavelength_count"].values / seeds
    told["layered"] = (
        "rung",
        np.concatenate([[np.nan] * 2, layered]),
        named("share of the piles that have layers"),
    )
    coordinates: Variables = {
        "rung": ("rung", list(RUNGS), named("what was changed last", "")),
        "k": ("k", np.array(sharpness), named("times faster than by its law grains are captured")),
        "amplified": ("amplified", list(AMPLIFIED), named("share of amplification", "")),
        "gamma": ("gamma", np.array(rates), named("rate of collision", "s-1")),
        "cross": ("cross", list(CROSS_RATES), named("rate of unlike grains, over gamma")),
        "factor": ("factor", list(FACTORS), named("what is changed", "")),
        "when": ("when", list(WHEN), named("when it is changed", "")),
    }
    return xr.Dataset(told, coordinates, {"title": "Between the rules", "comment": COMMENT})


def set_up(duration: float) -> Experiment:
    """The preset with rates, a layer and, but for what columns bend, no curvature length."""
    return load(PRESET).with_values(
        {
            "mixture.collision_rate": _rates(GAMMA, CROSS),
            "mixture.surface_depth": DEPTH,
            "mixture.curvature_length": 0.0,
            "pour.duration": duration,
            "pour.records": max(200, round(duration / 20.0)),
            "ca_model.column_width": WIDTH,
        }
    )


def ladder(base: Experiment, fineness: int) -> list[Experiment]:
    """The set-ups of RUNGS; the first two are the continuum's, the last is the other rule's."""
    limit = {
        "mixture.curvature_length": WIDTH / 2,
        "continuum.scheme": "muscl",
        "continuum.cells": 2 * round(base.cell.length / WIDTH),
    }
    corners = [[k < climbed for k in range(len(FACTORS))] for climbed in range(len(FACTORS) + 1)]
    return [
        base.with_values(limit),
        base.with_values({"continuum.cells": round(base.cell.length / WIDTH)}),
        lattice(base, fineness).with_values({"ca_model.contacts": "all"}),
        *(lattice(base, fineness, *corner) for corner in corners),
        base.with_values({"ca_model.contacts": 1}),
    ]


def lattice(
    base: Experiment,
    fineness: int,
    whole: bool = False,
    topmost: bool = False,
    still: bool = False,
    sharp: bool = False,
) -> Experiment:
    """A corner: for each of FACTORS, whether it is as in the threshold rule.

    What touches the pile is as thick as one small grain of the preset.
    """
    n = 1 if whole else fineness
    return base.with_values(
        {
            "mixture.grain_diameter": [d / n for d in base.mixture.grain_diameter],
            "mixture.surface_depth": UNIT if topmost else DEPTH,
            "ca_model.rule": "rate",
            "ca_model.contacts": n,
            "ca_model.amplification": 0.0 if still else 1.0,
            "ca_model.sharpness": SHARPEST if sharp else 1.0,
        }
    )


def sharpened(base: Experiment, k: float, amplified: str) -> Experiment:
    """Single grains on a surface of one, captured `k` times faster; set rolling as AMPLIFIED."""
    share = {"1 / k": 1.0 / k, "none": 0.0, "all": 1.0}[amplified]
    return lattice(base, 1, whole=True, topmost=True).with_values(
        {"ca_model.sharpness": k, "ca_model.amplification": share}
    )


def _rates(gamma: float, cross: float) -> list[list[float]]:
    return [[gamma, cross * gamma], [cross * gamma, gamma]]


def _with_rates(base: Experiment, gamma: float, cross: float) -> Experiment:
    cells = round(base.cell.length / WIDTH)
    return base.with_values(
        {"mixture.collision_rate": _rates(gamma, cross), "continuum.cells": cells}
    )


def _of_piles(
    poured: Mapping[str, Sequence[Experiment]],
    seeds: int,
    workers: int | None,
    progress: Progress,
) -> dict[str, xr.Dataset]:
    """Means over piles of each part; the error of piles that are all alike is that of one."""
    every = [setup for part in poured.values() for setup in part]
    found = pour_piles(every, seeds, workers=workers, progress=progress)
    means = with_own_errors(means_over_piles(found), found)
    ends = np.cumsum([0, *(len(part) for part in poured.values())]).tolist()
    return {
        name: means.isel(setup=slice(begin, end))
        for name, begin, end in zip(poured, ends, ends[1:], strict=False)
    }


def _measured(grids: list[Experiment], workers: int | None, progress: Progress) -> xr.Dataset:
    return campaign(grids, ["continuum"], workers=workers, progress=progress).isel(model=0)


def _pair(found: xr.Dataset, name: str, shape: tuple[int, ...] = (-1,)) -> Floats:
    """A number and its error, (2, *shape)."""
    return np.stack([found[each].values.reshape(shape) for each in (name, f"{name}_error")])


def _told(name: str, dims: str | tuple[str, ...], pair: Floats, units: str) -> Variables:
    meaning = name.replace("_", " ")
    return {
        name: (dims, pair[0], named(meaning, units)),
        f"{name}_error": (dims, pair[1], named(f"standard error of {meaning}", units)),
    }


def effects(values: Floats, errors: Floats) -> Floats:
    """Changes [%] by each factor first, on average and last, and their errors (2, factor, when)."""
    every = range(len(FACTORS))
    found = np.empty((2, len(FACTORS), len(WHEN)))
    for factor in every:
        others = tuple(other for other in every if other != factor)
        orders = [(factor, *others)], list(permutations(every)), [(*others, factor)]
        for when, chosen in enumerate(orders):
            weights = _weights(factor, chosen)
            counts = weights != 0
            ratio = np.exp((weights * np.log(values))[counts].sum())
            spread = float(np.sqrt(((weights * errors / values)[counts] ** 2).sum()))
            found[:, factor, when] = 100 * (ratio - 1), 100 * ratio * spread
    return found


def _weights(factor: int, orders: Iterable[tuple[int, ...]]) -> Floats:
    """Of each corner, in what `factor` changes on average when factors change in these `orders`."""
    weights = np.zeros((2,) * len(FACTORS))
    chosen = list(orders)
    for order in chosen:
        corner = np.zeros(len(FACTORS), dtype=int)
        corner[list(order[: order.index(factor)])] = 1
        weights[tuple(corner)] -= 1 / len(chosen)
        corner[factor] = 1
        weights[tuple(corner)] += 1 / len(chosen)
    return weights


def between_table(found: xr.Dataset) -> Table:
    """A row for each rung, then one for each factor's effect, and when."""
    sheet = Table("", *QUANTITIES, title=Text(found.attrs["title"], style="bold"))
    for rung in found["rung"].values:
        sheet.add_row(rung, *_cells(found.sel(rung=rung)))
    sheet.add_section()
    for factor in found["factor"].values:
        for when in found["when"].values:
            cells = _cells(found.sel(factor=factor, when=when), "effect_")
            sheet.add_row(f"{factor}, {when} (%)", *cells)
    return sheet


def _cells(found: xr.Dataset, prefix: str = "") -> list[str]:
    names = [prefix + name for name in QUANTITIES]
    return [with_error(found[name].item(), found[f"{name}_error"].item()) for name in names]
