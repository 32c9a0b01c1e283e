"""Layers of a deposit: two estimators of their wavelength, and what else can be told of them.

By spectrum (:mod:`compare.deposit.spectrum`) the wavelength is what repeats; by counting
(:mod:`compare.deposit.counting`) it is the mean thickness of a pair of layers, times the whole
number of pairs that a cycle lays. The two must agree within AGREE, or twice their errors; where
they do not, the `comment` says so, and half their difference is part of the error of the first.
Counting looks at profiles averaged along the layers (:mod:`compare.deposit.inclination`), for
single columns of grains are noise to it.
"""

from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from compare.deposit.counting import Counted, count_layers, count_pairs
from compare.deposit.dual import Plateaus, plateaus
from compare.deposit.inclination import along_layers, rises
from compare.deposit.kernel import smooth
from compare.deposit.laid import Laid
from compare.deposit.order import (
    FEWEST,
    coherence,
    column_mean,
    regularity,
    repeats,
    together,
)
from compare.deposit.profiles import Settled, let_down, settled
from compare.deposit.spectrum import Correlation, Repeat, Transform, transform
from compare.deposit.zones import LAYERED_SHARE, zones
from compare.quantities import (
    cell_height,
    measured_columns,
    slope_columns,
    values_of,
)
from experiment.arrays import Floats

__all__ = ["layers", "layers_of", "look"]

AGREE = 0.1
COARSE = 4  # cells a wavelength, below which it is remarked
IRREGULAR = 0.3  # of the wavelength
SMOOTHED = 10  # this part of a wavelength is averaged before layers are counted
THINNEST = 4  # mean grain diameters, a pair of layers
UNLIKE = 0.6  # regularity, at which pairs that are unlike make one cycle
CYCLES = 3
NEARLY = 0.5  # of the strength of the cycle, that a pair has if it might be the wavelength
STEPS = ("wavelength_upper", "wavelength_lower", "wavelength_step_x")
CLEAR = 0.5  # of the mean strength, in columns that are looked at further


def layers(archive: xr.Dataset) -> xr.Dataset:
    """Layers of the settled part of a pour, in its measured columns; see :func:`layers_of`."""
    return look(archive).dataset()


def look(archive: xr.Dataset) -> Laid:
    """What :func:`layers` tells, as numbers and arrays."""
    slope = slope_columns(archive)
    chosen, x = measured_columns(archive)[slope], archive.variables["x"][slope]
    grain = float(values_of(archive, "grain_diameter").mean())
    return _look(settled(archive), x, cell_height(archive), chosen, grain)


def layers_of(
    coarse: xr.DataArray, measured: NDArray[np.bool_] | None = None, grain: float = 0.0
) -> xr.Dataset:
    """Layers of a deposit of coarseness `coarse` (z, x), evenly spaced in cm, NaN outside of it.

    A Dataset of the SCALARS of :mod:`compare.deposit.laid`, from the columns `measured` (x,), all
    of them by default, but for zones and shares, which are of the whole slope; and of what is
    IN_PLACE (x), in every column.
    Where the mean diameter of a `grain` [cm] is given, what alternates grain by grain is no layer.
    wavelength is by spectrum and along the vertical; it and all that hangs on it is NaN, and
    layering 0, where there are no layers. The attribute `comment`, where it is there, tells what
    should be looked at twice.
    """
    deposit = let_down(np.asarray(coarse.values, dtype=np.float64))
    chosen = np.ones(coarse.sizes["x"], bool) if measured is None else measured
    dz = _spacing(coarse["z"].values)
    return _look(deposit, coarse["x"].variable, dz, chosen, grain).dataset()


def _look(
    deposit: Settled, place: xr.Variable, dz: float, chosen: NDArray[np.bool_], grain: float
) -> Laid:
    """Layers of a `deposit` with columns at `place` (x,), in those that are `chosen` (x,)."""
    x = place.values
    dx = _spacing(x)
    transformed = transform(deposit.coarse)
    correlation = transformed.with_itself()
    pooled = correlation.pooled(chosen)
    repeat = pooled.repeat(THINNEST * grain / dz)
    local = repeats(correlation.neighbourly(together(len(x))), repeat)
    followed = _follow(deposit, transformed, repeat, dz / dx)
    mean = column_mean(deposit.coarse)
    shares = zones(x, mean, local.strength, followed.coherence, followed.regularity)
    found = {"layering": repeat.strength} | shares
    if shares["layered_share"] >= LAYERED_SHARE:
        layered = chosen & (local.strength >= CLEAR * repeat.strength)
        found |= _numbers(pooled, repeat, followed, layered, x, dz)
        found |= _drift(x[layered], local.lag[layered] * dz)
    in_place = (
        local.lag * dz,
        local.strength,
        followed.coherence,
        followed.regularity,
        mean,
    )
    return Laid(place, found, in_place, _second_thoughts(found, dz))


class _Followed(NamedTuple):
    """The deposit along its layers; all 0 and empty where nothing repeats."""

    profiles: Floats  # (z, x), averaged along the layers and smooth along z
    rise: Floats  # (x - 1,) of the layers, in cells
    coherence: Floats  # (x,)
    regularity: Floats  # (x,)


def _follow(deposit: Settled, transformed: Transform, repeat: Repeat, aspect: float) -> _Followed:
    """Averages along the layers of the `deposit`; `aspect` is that of a cell, dz / dx."""
    values = deposit.coarse
    columns = values.shape[1]
    if not np.isfinite(repeat.lag):
        nothing = np.zeros(columns)
        return _Followed(np.full(values.shape, np.nan), nothing[1:], nothing, nothing)
    rise = rises(deposit, transformed, repeat.lag, int(repeat.lag * aspect), together(columns))
    raw = along_layers(deposit, rise, together(columns))
    profiles = smooth(raw, max(1, int(repeat.lag / SMOOTHED)))
    return _Followed(profiles, rise, coherence(values, raw), regularity(profiles, repeat))


def _numbers(
    pooled: Correlation,
    repeat: Repeat,
    followed: _Followed,
    layered: NDArray[np.bool_],
    x: Floats,
    dz: float,
) -> dict[str, float]:
    """What counting in the columns that are `layered` (x,) adds to the `repeat` of all columns."""
    pairs = count_pairs(followed.profiles[:, layered])
    counted = count_layers(pairs)
    steps = plateaus(column_mean(pairs.pair) * dz, x[layered])
    lag, number = _cycle(pooled, repeat, counted, followed.regularity[layered], steps)
    inclined = _middle(-followed.rise[layered[:-1] & layered[1:]] * dz / _spacing(x))
    wavelengths = _wavelengths(lag * dz, number, counted, dz, inclined)
    return wavelengths | dict(zip(STEPS, steps, strict=True))


def _cycle(
    pooled: Correlation, repeat: Repeat, counted: Counted, regular: Floats, steps: Plateaus
) -> tuple[float, float]:
    """The wavelength by spectrum, in cells, and the whole number of pairs that a cycle lays.

    More than one pair only where the pattern repeats after several in good order (UNLIKE), and
    did so at least CYCLES times: of irregular layers the longer lag is chance, and where two
    wavelengths share the slope it is a multiple of both. Else, if it is NEARLY as strong, the peak
    nearest to the pair that was counted is the wavelength.
    """
    pairs = max(1.0, float(np.round(repeat.lag / counted.pair)))
    seen_often = counted.number >= CYCLES * pairs
    in_order = np.isnan(steps.x) and np.median(regular) >= UNLIKE
    near = Repeat(*(float(part[0]) for part in pooled.repeats_near(counted.pair)))
    as_good = near.strength >= NEARLY * repeat.strength and not in_order
    if pairs > 1 and np.isfinite(near.lag) and (as_good or not seen_often):
        return near.lag, 1.0
    return repeat.lag, pairs


def _wavelengths(
    wavelength: float, pairs: float, counted: Counted, dz: float, inclined: tuple[float, float]
) -> dict[str, float]:
    """Wavelength and sublayers by both estimators, with errors; along and across the layers."""
    by_count = counted.pair * pairs * dz
    count_error = np.hypot(counted.pair_error * pairs, pairs / max(counted.number, 1.0)) * dz
    error = float(np.hypot(count_error, (wavelength - by_count) / 2))
    slope, slope_error = inclined
    tilt = float(np.hypot(1.0, slope))
    normal_error = float(np.hypot(error, wavelength * slope * slope_error / tilt**2)) / tilt
    return {
        "wavelength": wavelength,
        "wavelength_error": error,
        "wavelength_counted": by_count,
        "wavelength_counted_error": float(count_error),
        "wavelength_spread": counted.pair_spread * float(np.sqrt(pairs)) * dz,
        "wavelength_normal": wavelength / tilt,
        "wavelength_normal_error": normal_error,
        "thickness_small": counted.small * dz,
        "thickness_small_error": counted.small_error * dz,
        "thickness_large": counted.large * dz,
        "thickness_large_error": counted.large_error * dz,
        "pairs_a_cycle": pairs if np.isfinite(by_count) else np.nan,
        "layer_pairs": counted.number,
        "inclination": slope,
        "inclination_error": slope_error,
    }


def _drift(x: Floats, wavelength: Floats) -> dict[str, float]:
    """The change of wavelength with x, by least squares; columns together count as one."""
    if len(x) <= FEWEST:
        return {}
    (variance, covariance), (_, scatter) = np.cov(x, wavelength, bias=True).tolist()
    drift = covariance / variance
    unexplained = max(scatter - drift * covariance, 0.0)
    error = np.sqrt(unexplained / variance / (len(x) - 2) * together(len(x)))
    return {"wavelength_drift": drift, "wavelength_drift_error": float(error)}


def _second_thoughts(found: dict[str, float], dz: float) -> str:
    """What should be looked at twice in a deposit of cells `dz` high, a line each."""
    if "wavelength" not in found:
        return ""
    wavelength, counted = found["wavelength"], found["wavelength_counted"]
    spectrum = f"wavelength by spectrum, {wavelength:.3g} cm"
    lines = []
    if not np.isfinite(counted):
        lines.append(f"{spectrum}: but no layers can be counted")
    elif abs(wavelength - counted) > max(AGREE * wavelength, 2 * found["wavelength_counted_error"]):
        lines.append(f"{spectrum}, and by counting, {counted:.3g} cm, do not agree")
    if wavelength < COARSE * dz:
        lines.append(f"{spectrum}, is only {wavelength / dz:.1f} cells of the deposit")
    if min(found["thickness_small"], found["thickness_large"]) < 2 * wavelength / SMOOTHED:
        lines.append(f"sublayers of less than {2 * wavelength / SMOOTHED:.2g} cm cannot be told")
    if found["wavelength_spread"] > IRREGULAR * counted:
        lines.append(f"cycles are irregular, by {found['wavelength_spread'] / counted:.0%}")
    if np.isfinite(found["wavelength_step_x"]):
        lines.append(
            f"two wavelengths: {found['wavelength_upper']:.3g} cm above and "
            f"{found['wavelength_lower']:.3g} cm below x = {found['wavelength_step_x']:.3g} cm"
        )
    elif found["pairs_a_cycle"] > 1:
        lines.append(f"a cycle lays {found['pairs_a_cycle']:.0f} pairs of layers, not alike")
    return "\n".join(lines)


def _middle(values: Floats) -> tuple[float, float]:
    """Median, and its standard error where neighbours are known together; NaN for none."""
    if not len(values):
        return np.nan, np.nan
    independent = max(1.0, len(values) / together(len(values)))
    return float(np.median(values)), float(values.std() / np.sqrt(independent))


def _spacing(values: Floats) -> float:
    return float(values[1] - values[0]) if len(values) > 1 else 1.0
