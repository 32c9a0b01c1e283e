"""Layers: the period of the deposit along the vertical.

The coarseness c(z) of each column, from the settled part of the pour, is correlated with itself,

    A(lag) = < c'(z) c'(z + lag) >,        c' = c - <c> in its column,

averaged over the measured columns. A cycle may lay more than one pair of layers, so the wavelength
is not the first peak but the shortest lag whose peak comes close to the highest one: the lag at
which the whole pattern repeats. Each peak counts by the share of a column that its lag leaves to
compare: of irregular layers, a peak of which little is left may be high by chance. The strength of
the layering is the amplitude of what repeats, 2 sqrt(A(wavelength)): 1 for equal layers of pure
small and pure large grains.
"""

import numpy as np
import scipy
import xarray as xr

from compare.quantities import coarseness, measured_columns, settled_since
from experiment.arrays import Floats

__all__ = ["layers", "layers_of", "settled_coarseness", "settled_profiles"]


AS_HIGH_AS = 0.8  # of the highest peak
WEAKEST = 0.1  # strength that still counts as a layering
NEAR = 0.3  # how far from the mean wavelength a single column's may be


def layers(archive: xr.Dataset) -> xr.Dataset:
    """Layers of the settled part of a pour, in its measured columns; see :func:`layers_of`."""
    return layers_of(settled_coarseness(archive).isel(x=np.flatnonzero(measured_columns(archive))))


def layers_of(coarse: xr.DataArray) -> xr.Dataset:
    """Layers of a deposit of coarseness `coarse` (z, x), evenly spaced in cm, NaN outside of it.

    wavelength and its standard error wavelength_error [cm], along the vertical; wavelength_normal
    [cm], across the layers; wavelength_at(x) [cm] of single columns and their standard deviation
    wavelength_spread; layering, the strength. NaN where there are no layers.
    """
    z, inside = coarse["z"].values, np.isfinite(coarse.values)
    profiles = [coarse.values[inside[:, i], i] for i in range(coarse.sizes["x"])]
    dz = float(z[1] - z[0])
    thinnest = min(len(profile) for profile in profiles)
    longest = thinnest * 2 // 3
    single = np.array([_autocorrelation(profile, longest) for profile in profiles])
    peak, strength = _repeat(single.mean(axis=0), thinnest)
    at = np.array([_nearest_peak(one, peak) for one in single]) * dz
    spread = float(np.nanstd(at)) if np.isfinite(at).any() else np.nan
    repeats = thinnest / peak
    slope = _mean_slope(coarse["x"].values, np.where(inside, z[:, None], -np.inf).max(axis=0))

    def cm(value: float, long_name: str) -> tuple[tuple[()], float, dict[str, str]]:
        return (), value, {"units": "cm", "long_name": long_name}

    return xr.Dataset(
        {
            "wavelength": cm(peak * dz, "vertical wavelength of the layers"),
            "wavelength_error": cm(spread / np.sqrt(repeats), "standard error of wavelength"),
            "wavelength_spread": cm(spread, "standard deviation of wavelength over x"),
            "wavelength_normal": cm(
                peak * dz / np.hypot(1.0, slope), "wavelength normal to the layers"
            ),
            "wavelength_at": (
                "x",
                at,
                {"units": "cm", "long_name": "vertical wavelength of single columns"},
            ),
            "layering": ((), strength, {"units": "1", "long_name": "strength of the layering"}),
        },
        {"x": coarse["x"]},
    )


def settled_coarseness(archive: xr.Dataset) -> xr.DataArray:
    """Coarseness (z, x) of what was laid after the transient; NaN elsewhere."""
    start = archive["height"].interp(time=settled_since(archive))
    coarse = coarseness(archive["deposit_fraction"], archive).astype(np.float64)
    return coarse.where(archive["z"] > start).transpose("z", "x")


def settled_profiles(archive: xr.Dataset) -> list[Floats]:
    """Coarseness (z,) of each column of the deposit, as far as it was laid after the transient."""
    coarse = settled_coarseness(archive).values
    return [column[np.isfinite(column)] for column in coarse.T]


def _autocorrelation(profile: Floats, longest: int) -> Floats:
    """A of one column at lags 0, 1, ... below `longest`."""
    if not longest:
        return np.zeros(0)
    varying = profile - profile.mean()
    n = len(varying)
    product = scipy.signal.correlate(varying, varying, mode="full")[n - 1 : n - 1 + longest]
    return np.asarray(product / (n - np.arange(len(product))))


def _repeat(correlation: Floats, thickness: int) -> tuple[float, float]:
    """The lag at which the pattern repeats, and its strength; NaN and 0 where none does.

    `correlation` (lag,) is of columns of which the thinnest is of this `thickness`, as lags are.
    """
    negative = np.flatnonzero(correlation < 0)
    if not len(negative):
        return np.nan, 0.0
    first = int(negative[0])
    peaks = first + scipy.signal.find_peaks(correlation[first:])[0]
    counted = correlation[peaks] * (1.0 - peaks / thickness)
    if not len(peaks) or counted.max() <= 0:
        return np.nan, 0.0
    chosen = int(peaks[counted >= AS_HIGH_AS * counted.max()][0])
    strength = float(2.0 * np.sqrt(correlation[chosen]))
    return (_summit(correlation, chosen), strength) if strength >= WEAKEST else (np.nan, 0.0)


def _summit(values: Floats, k: int) -> float:
    """Place of the maximum of the parabola through three neighbouring values."""
    left, middle, right = values[k - 1 : k + 2]
    bend = left - 2 * middle + right
    return float(k + 0.5 * (left - right) / bend) if bend < 0 else float(k)


def _nearest_peak(correlation: Floats, lag: float) -> float:
    """The highest peak of a single column near `lag`, NaN where it has none there."""
    if not np.isfinite(lag):
        return np.nan
    peaks = scipy.signal.find_peaks(correlation)[0]
    near = peaks[np.abs(peaks - lag) < NEAR * lag]
    if not len(near):
        return np.nan
    return _summit(correlation, int(near[correlation[near].argmax()]))


def _mean_slope(x: Floats, top: Floats) -> float:
    """Slope of the surface `top` (x,), its ends compared; NaN for less than two columns."""
    if len(x) < 2 or not np.isfinite(top[[0, -1]]).all():
        return np.nan
    return float(-(top[-1] - top[0]) / (x[-1] - x[0]))
