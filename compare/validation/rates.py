"""The lattice's rate rule against the continuum: one pour by both, on one grid.

Grains of u = d / n and whole multiples of it, columns as wide as the continuum's cells, d and l the
set-up's own. What the mean over piles differs by is a bias; what piles differ by is noise.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

import ca_model
import continuum
from compare.quantities import cell_width, total_inflow, values_of
from compare.validation.check import Check, Checks, Poured
from continuum.theory import steady_state_of
from experiment import load
from experiment.archive import experiment_of
from experiment.arrays import Floats

__all__ = [
    "GRAINS",
    "POURS",
    "SHARE",
    "Difference",
    "Fields",
    "Pour",
    "differences",
    "exponents",
    "noise_of",
    "on_one_grid",
    "rates",
]

LAW = "the continuum, godunov, on the same grid"
COUNTED = "the law's limit of small grains: R / u of them in a column"
SECTION_III = "Makse 1997, sec. III, full form"
SHARE = 0.015  # of R0, and of a composition of 1
PILES, MANY_PILES = 6, 32
GRAINS = (4, 8, 16)  # in d
FIELDS = {"height": "h / R0", "rolling_thickness": "R_a / R0", "surface_fraction": "phi_a"}


class Pour(NamedTuple):
    """A pour without chaos: no kinks, in which a grain would change all that follows."""

    preset: str
    cells: int
    grains: int  # the smallest ones in the depth d of the surface layer
    settings: tuple[str, ...]


class Fields(NamedTuple):
    """A pour by the continuum, and piles of the lattice."""

    continuum: xr.Dataset
    piles: Sequence[xr.Dataset]


class Difference(NamedTuple):
    """How far the mean of piles is from the continuum, over time and place."""

    rms: float
    by_noise: float  # what so few piles differ by anyhow

    @property
    def allowed(self) -> float:
        """Noise, and a share for what falls with u and w."""
        return float(np.hypot(1.5 * self.by_noise, SHARE))


THICK = "mixture.surface_depth=0.5"
ONE_SPEED = ("mixture.drift_velocity=1.0", "mixture.delta=-0.2")
POURS = {
    "de Gennes": Pour("de-gennes-silo", 30, 256, ("pour.duration=40.0",)),
    "section III": Pour(
        "makse-profile", 30, 512, ("pour.duration=40.0", "mixture.curvature_length=0.2")
    ),
    "section III, l = 0": Pour("makse-profile", 30, 512, ("pour.duration=40.0", THICK)),
    "section III, mixed ground": Pour(
        "makse-profile", 30, 512, ("pour.duration=5.0", THICK, "cell.start_composition=[0.3, 0.7]")
    ),
    "minimal": Pour("bdg-minimal", 30, 256, ("pour.duration=30.0", THICK)),
    "canonical": Pour("canonical", 30, 512, ("pour.duration=30.0", THICK)),
    "unlike rates": Pour(
        "mcs-general",
        30,
        512,
        (
            "pour.duration=150.0",
            *ONE_SPEED,
            "mixture.surface_depth=1.0",
            "mixture.curvature_length=1.0",
        ),
    ),
    "three species": Pour("ternary", 30, 512, ("pour.duration=6.0", "mixture.surface_depth=0.3")),
    "heap": Pour(
        "heap", 30, 512, ("pour.duration=8.0", "mixture.surface_depth=0.3", "cell.end=wall")
    ),
    "pulses": Pour(
        "pulsed-feed",
        30,
        512,
        (
            "pour.duration=100.0",
            "cell.length=30.0",
            "feed.schedule.period=40.0",
            "mixture.delta=-0.2",
            THICK,
        ),
    ),
}


def rates(poured: Poured) -> Checks:
    """Small grains pour as the continuum does on a grid as wide as their columns (`rule = "rate"`).

    What is left is noise, which falls as the root of a grain's area, and a bias that falls as its
    height.
    """
    for name, pour in POURS.items():
        for field, found in differences(poured, pour).items():
            yield Check(
                f"{name}, {pour.grains} grains in d: rms difference of {FIELDS[field]}, "
                f"mean of {PILES} piles",
                LAW,
                0.0,
                found.rms,
                found.allowed,
                f"{SHARE} and 1.5 standard errors",
            )
    yield from of_section_iii(both(poured, POURS["section III, l = 0"], PILES).piles)
    noise, bias = exponents([on_one_grid(POURS["canonical"], n, piles=MANY_PILES) for n in GRAINS])
    what = f"canonical, {GRAINS[0]} to {GRAINS[-1]} grains in d: power of u of"
    yield Check(f"{what} the noise of R_a", COUNTED, 0.5, -noise, 0.1, "a pure power of u")
    yield Check(f"{what} the bias of h", COUNTED, 1.0, -bias, 0.35, f"noise of {MANY_PILES} piles")


def differences(poured: Poured, pour: Pour) -> dict[str, Difference]:
    """By field, over R0 but for compositions, of the mean of a few piles."""
    fields = both(poured, pour, PILES)
    inflow = total_inflow(fields.continuum)
    return {
        name: _difference(fields, name, 1.0 if name == "surface_fraction" else inflow)
        for name in FIELDS
    }


def both(poured: Poured, pour: Pour, piles: int) -> Fields:
    """The archives of both models."""
    settings = _settings(pour, pour.grains)
    return Fields(
        poured("continuum", pour.preset, *settings),
        [poured("ca_model", pour.preset, *settings, f"pour.pile={k}") for k in range(piles)],
    )


def on_one_grid(pour: Pour, grains: int, piles: int) -> Fields:
    """The same, with another number of `grains` in d, of many piles that nobody asks for again."""
    settings = _settings(pour, grains)
    experiments = [load(pour.preset, [*settings, f"pour.pile={k}"]) for k in range(piles)]
    return Fields(continuum.pour(experiments[0]), ca_model.pour_many(experiments))


def _settings(pour: Pour, grains: int) -> list[str]:
    whole = load(pour.preset, pour.settings)
    mixture, smallest = whole.mixture, min(whole.mixture.grain_diameter)
    unit = mixture.surface_depth / grains
    return [
        *pour.settings,
        "pour.records=5",
        f"mixture.grain_diameter={[round(d / smallest) * unit for d in mixture.grain_diameter]}",
        f"mixture.surface_depth={mixture.surface_depth}",
        f"mixture.curvature_length={mixture.curvature_length}",
        f"continuum.cells={pour.cells}",
        "ca_model.rule=rate",
        f"ca_model.unit={unit}",
        f"ca_model.column_width={whole.cell.length / pour.cells}",
    ]


def noise_of(fields: Fields, name: str) -> float:
    """Standard deviation between piles of a field (rms over time and place)."""
    values = np.array([values_of(pile, name)[1:] for pile in fields.piles])
    return float(np.sqrt(values.var(axis=0, ddof=1).mean()))


def _difference(fields: Fields, name: str, scale: float = 1.0) -> Difference:
    mean: Floats = np.mean([values_of(pile, name)[1:] for pile in fields.piles], axis=0)
    rms = np.sqrt(((mean - values_of(fields.continuum, name)[1:]) ** 2).mean())
    by_noise = noise_of(fields, name) / np.sqrt(len(fields.piles))
    return Difference(float(rms) / scale, float(by_noise) / scale)


def exponents(found: Sequence[Fields]) -> tuple[float, float]:
    """The powers of n = d / u, of GRAINS, with which noise of R and bias of h grow."""
    heights = [_difference(fields, "height") for fields in found]
    bias = [np.sqrt(max(one.rms**2 - one.by_noise**2, 0.0)) for one in heights]
    noise = [noise_of(fields, "rolling_thickness") for fields in found]
    return tuple(  # type: ignore[return-value]
        float(np.polyfit(np.log(GRAINS), np.log(values), 1)[0]) for values in (noise, bias)
    )


def of_section_iii(piles: Sequence[xr.Dataset]) -> Checks:
    """The mean of the last records of piles, beside the closed form at the columns' edges."""
    state, dx = steady_state_of(experiment_of(piles[0])), cell_width(piles[0])
    last = [pile.isel(time=-1) for pile in piles]
    edges = values_of(last[0], "x") + dx / 2
    rolling: Floats = np.array([values_of(one, "rolling_thickness") for one in last])
    height: Floats = np.array([values_of(one, "height") for one in last])
    slope = -np.diff(height, axis=1) / dx
    inner = edges[:-1] < 0.93 * state.length
    flow = rolling.mean(axis=0) - state.rolling_thickness(edges)
    tilt = (slope.mean(axis=0) - state.slope(edges[:-1]))[inner]
    for name, error, scale, share in (
        ("R_a / R0", flow, state.total_inflow, SHARE),
        ("theta", tilt, 1.0, 2 * SHARE),
    ):
        yield Check(
            f"section III, l = 0, mean of {len(piles)} piles: rms error of {name}",
            SECTION_III,
            0.0,
            float(np.sqrt((error**2).mean())) / scale,
            share,
            "O(w), columns of 1 cm, and noise",
        )
