"""The instrument on pictures that are drawn: lines of known velocity, layers of known thickness."""

import math
from collections.abc import Sequence

import numpy as np
import xarray as xr

from compare.deposit import layers_of
from compare.kymograph import cycle_period, kinks_and_fronts, mean_velocity
from compare.validation.check import Check, Checks, Poured
from compare.validation.drawn import PERIOD, archive_of, deposit_of, parallel, wedges

__all__ = ["deposits", "kymographs"]

DRAWN = "drawn"
TOLD = "three standard errors, as the instrument tells them"
FRONT, KINK = 4.0, 2.0  # cm/s
DRAWINGS = 8
WAVELENGTH, SHARE, DIP = 1.2, 0.35, 0.02  # cm; of small grains; on a slope of 0.5
NOISE = 0.2  # of R0, and as the chance that a grain of the deposit is of the other kind


def kymographs(poured: Poured) -> Checks:  # noqa: ARG001
    """Ten cycles of a front going down and a kink coming up, with white noise on R."""
    pairs = [kinks_and_fronts(_noisy(seed)) for seed in range(DRAWINGS)]
    name = f"{DRAWINGS} kymographs with noise of {NOISE:g} R0"
    for k, (what, velocity) in enumerate((("kinks", -KINK), ("fronts", FRONT))):
        found = [mean_velocity(pair[k]) for pair in pairs]
        yield _mean_of(f"{name}: velocity of {what}", velocity, found, "cm/s")
        pulls = np.concatenate(
            [(pair[k]["velocity"] - velocity) / pair[k]["velocity_error"] for pair in pairs]
        )
        yield Check(
            f"{name}: rms of (velocity - true) / error, {len(pulls)} {what}",
            "honest errors have 1",
            1.0,
            float(np.sqrt(np.mean(pulls**2))),
            3 / math.sqrt(2 * len(pulls)),
            "three standard errors of an rms",
        )
    yield _mean_of(f"{name}: period", PERIOD, [cycle_period(up) for up, _ in pairs], "s")


def _noisy(seed: int) -> xr.Dataset:
    time = 2.0 * (np.arange(5 * PERIOD) + seed / DRAWINGS)
    return archive_of(wedges(FRONT, KINK), noise=NOISE, times=time, seed=seed)


def _mean_of(what: str, expected: float, found: Sequence[tuple[float, float]], unit: str) -> Check:
    """The mean of numbers and their errors, one of each drawing."""
    values, errors = np.transpose(found)
    bound = 3 * float(np.sqrt(np.sum(errors**2))) / len(found)
    return Check(what, DRAWN, expected, float(values.mean()), bound, TOLD, unit)


def deposits(poured: Poured) -> Checks:  # noqa: ARG001
    """Layers that dip into the slope, with grains of the other kind strewn in."""
    phase = parallel(WAVELENGTH, DIP)
    found = layers_of(deposit_of(phase, share=SHARE, noise=NOISE, grains=True))
    name = f"deposit with {NOISE:.0%} of stray grains"
    for what, number, expected in (
        ("wavelength by spectrum", "wavelength", WAVELENGTH),
        ("wavelength by counting", "wavelength_counted", WAVELENGTH),
        ("wavelength normal to the layers", "wavelength_normal", WAVELENGTH / _tilt()),
    ):
        yield Check(
            f"{name}: {what}",
            DRAWN,
            expected,
            _number(found, number),
            0.005 * expected,
            "a tenth of a bin of the deposit, 0.05 cm",
            "cm",
        )
    for what, share in (("small", SHARE), ("large", 1 - SHARE)):
        yield Check(
            f"{name}: sublayer of {what} grains",
            DRAWN,
            share * WAVELENGTH,
            _number(found, f"thickness_{what}"),
            0.01,
            "a fifth of a bin of the deposit",
            "cm",
        )
    yield Check(
        f"{name}: inclination of the layers",
        DRAWN,
        0.5 + DIP,
        _number(found, "inclination"),
        0.01,
        "a bin of the deposit over 5 cm along x",
    )


def _tilt() -> float:
    return math.hypot(1.0, 0.5 + DIP)


def _number(found: xr.Dataset, name: str) -> float:
    return float(found[name])
