"""Kymographs and deposits of pours that never were, so that all about them is known."""

from collections.abc import Callable, Sequence

import numpy as np
import xarray as xr

from experiment import load
from experiment.archive import assemble
from experiment.arrays import Floats

__all__ = [
    "COLUMNS",
    "DEPOSIT_COLUMNS",
    "DRIFT",
    "DZ",
    "INFLOW",
    "LENGTH",
    "PERIOD",
    "Field",
    "archive_of",
    "calm",
    "deposit_of",
    "parallel",
    "stripes",
    "wedges",
]

Field = Callable[[Floats, Floats], Floats]  # of (time, x), or of (height above the base, x)

LENGTH, COLUMNS, PERIOD, INFLOW, DRIFT = 100.0, 100, 100.0, 1.0, 5.0  # cm, 1, s, cm, cm/s
DEPOSIT_COLUMNS, DZ = 120, 0.05  # of a drawn deposit; cm


def archive_of(
    rolling: Field,
    coarse: Field | None = None,
    noise: float | Floats = 0.0,
    *,
    times: Floats | None = None,
    share: Field | float = 0.5,
    shape: str = "silo",
    seed: int = 3,
) -> xr.Dataset:
    """An archive with rolling thickness R(t, x) and deposit coarseness c(z above base, x).

    The `noise` is white, of this standard deviation over R0, or given as (time, x). Of R a `share`
    is of large grains. In a heap the left side is like the right one.
    """
    time = np.arange(0.0, 1001.0, 2.0) if times is None else times
    x = np.arange(COLUMNS) + 0.5
    if shape == "heap":
        x = np.concatenate([-x[::-1], x])
    z = np.arange(0.05, 60.0, 0.1 if coarse else 30.0)
    base = 0.5 * (LENGTH - np.abs(x))
    clean = rolling(time[:, None], np.abs(x))
    height = base + growth(rolling, time, np.abs(x))
    above = z[:, None] - base
    layers = 0.5 + 0 * above if coarse is None else coarse(above, np.abs(x))
    large = np.where((above > 0) & (z[:, None] < height[-1]), layers, np.nan)
    if np.ndim(noise) == 0:
        noise = noise * np.random.default_rng(seed).standard_normal(clean.shape)
    flow = clean + noise
    coarse_share = share(time[:, None], np.abs(x)) if callable(share) else share
    zeros = np.zeros((len(time), 2))
    experiment = load(
        "makse-stratification",
        [f"pour.duration={time[-1]}", f"mixture.drift_velocity={DRIFT}", f"cell.shape='{shape}'"],
    )
    arrays = {
        "time": time,
        "x": x,
        "z": z,
        "height": height,
        "base_height": base,
        "rolling_thickness": np.stack([flow * (1 - coarse_share), flow * coarse_share], axis=-1),
        "surface_fraction": np.full((len(time), len(x), 2), 0.5),
        "deposit_fraction": np.stack([1 - large, large], axis=-1),
        "poured_volume": zeros,
        "rolling_volume": zeros,
        "deposited_volume": zeros,
        "outflow_volume": zeros,
    }
    return assemble(experiment, "continuum", arrays, {})


def growth(rolling: Field, time: Floats, x: Floats) -> Floats:
    """Height (time, x) above the base: 0.01 cm/s in the mean, and only while grains roll."""
    fine = np.arange(time[0], time[-1], PERIOD / 97)
    flowing = np.cumsum(rolling(fine[:, None], x) > 0, axis=0) / len(fine)
    grown = flowing / np.maximum(flowing[-1], 1e-9) * 0.01 * time[-1]
    return np.asarray(grown[np.searchsorted(fine, time).clip(max=len(fine) - 1)])


def wedges(
    front: float, kink: float, period: float = PERIOD, reach: Sequence[float] = (1.0,)
) -> Field:
    """Flow behind a front going down and before a kink coming up, once a period.

    Avalanches by turns get as far as each `reach`, a share of the slope.
    """

    def rolling(time: Floats, x: Floats) -> Floats:
        flow: Floats = np.zeros(np.broadcast_shapes(time.shape, x.shape))
        for late in range(2):  # periods that an avalanche may last
            cycle = time // period - late
            phase = time % period + late * period
            far = LENGTH * np.array(reach)[cycle.astype(int) % len(reach)]
            arrives, stops = x / front, far / front + (far - x) / kink
            flow += (phase > arrives) & (phase < stops)
        return np.asarray(INFLOW * np.minimum(flow, 1.0))

    return rolling


def stripes(wavelength: float, share: float = 0.5) -> Field:
    """Layers of a wavelength [cm] that dip by 0.02, small grains in a `share` of each."""
    return lambda above, x: ((above + 0.02 * x) % wavelength > share * wavelength).astype(float)


def calm(time: Floats, x: Floats) -> Floats:
    """A flow that never stops."""
    return INFLOW * (1 - x / LENGTH) + 0 * time


def deposit_of(
    phase: Field,
    *,
    share: float = 0.5,
    noise: float = 0.0,
    grains: bool = False,
    thickness: float = 15.0,
    seed: int = 1,
) -> xr.DataArray:
    """Coarseness (z, x) where small grains lie at the phase of a cycle below `share`, on a slope.

    `phase` (height above the floor of the slope, x) counts cycles. Of `noise` the coarseness has
    this standard deviation; of `grains`, this chance that one is of the other kind.
    """
    x = (np.arange(DEPOSIT_COLUMNS) + 0.5) * LENGTH / DEPOSIT_COLUMNS
    z = np.arange(DZ / 2, 0.5 * LENGTH + thickness + 5.0, DZ)
    above = z[:, None] - 0.5 * (LENGTH - x)
    large = (phase(above, x) % 1.0 > share).astype(float)
    random = np.random.default_rng(seed)
    if grains:
        large = np.where(random.uniform(size=large.shape) < noise, 1 - large, large)
    else:
        large = large + noise * random.standard_normal(large.shape)
    inside = (above > 0) & (above < thickness)
    return xr.DataArray(np.where(inside, large, np.nan), {"z": z, "x": x}, ("z", "x"))


def parallel(wavelength: float, dip: float = 0.0) -> Field:
    """The phase of layers parallel to the slope, or that dip into it by `dip`."""
    return lambda above, x: (above + dip * (x - LENGTH / 2)) / wavelength
