"""A deposit as a camera would see it: two colours of grains, light, lens, angle, a JPEG file.

Whoever wants to know what a set-up can measure renders a deposit whose layers are known, with the
light and the camera at hand, and reads the picture as any other:

    grains      each gives back the colour of its species, by a random factor of its own
    light       grows from left to right, and falls off towards the corners
    lens        blur; an oblique camera's perspective, a tilted camera's rotation
    sensor      sRGB (as a power of 2.2), noise, JPEG
"""

import io
from typing import NamedTuple

import numpy as np
import scipy
import xarray as xr

from experiment.arrays import Floats
from experiment.errors import SetupError

__all__ = ["BROWN_ON_WHITE", "GREYS", "RED_AND_GREEN", "Shot", "render"]

BROWN_ON_WHITE = ((0.28, 0.16, 0.08), (0.80, 0.78, 0.72))
GREYS = ((0.12, 0.12, 0.12), (0.45, 0.45, 0.45))
RED_AND_GREEN = ((0.42, 0.12, 0.10), (0.10, 0.215, 0.10))  # linear light, equal luminance

LOWEST = {"pixels": 1.0, "grain": 1e-4, "light": 0.01, "quality": 1}  # of the others: 0, or any
HIGHEST = {"keystone": 0.9, "vignette": 1.0, "quality": 95}
SIGNED = {"tilt", "colours", "air", "ground"}


class Shot(NamedTuple):
    """How a picture is taken. Colours are linear RGB, from 0 to 1."""

    colours: tuple[tuple[float, ...], tuple[float, ...]] = BROWN_ON_WHITE  # small grains first
    air: tuple[float, ...] = (0.02, 0.03, 0.06)
    ground: tuple[float, ...] = (0.10, 0.20, 0.35)
    pixels: float = 25.0  # a cm
    grain: float = 0.05  # cm
    texture: float = 0.15  # standard deviation of what single grains give back
    light: float = 2.0  # right edge over left edge
    vignette: float = 0.15  # darker in the corners
    blur: float = 1.5  # pixels
    noise: float = 0.01  # of the sensor
    keystone: float = 0.0  # by how much the upper edge is shorter
    tilt: float = 0.0  # degrees, clockwise
    quality: int = 85  # of the JPEG
    seed: int = 7  # of grains and noise


def render(coarse: xr.DataArray, shot: Shot | None = None) -> tuple[Floats, Floats]:
    """The picture of a deposit, and where the corners of its cell are in it.

    `coarse` (z, x), on even grids in cm, is the fraction of large grains, NaN where there are none:
    air above the deposit, ground below. The picture (row, column, 3) is in sRGB from 0 to 1; the
    corners (4, 2) are in pixels, clockwise from the upper left, as
    :class:`compare.photograph.View` takes them. A `tilt` turns the picture only. Raises
    :class:`SetupError` for a shot that no camera takes.
    """
    from skimage.transform import rotate

    shot = shot or Shot()
    _check(shot)
    random = np.random.default_rng(shot.seed)
    light = _lit(_scene(coarse.transpose("z", "x"), shot, random), shot)
    light, corners = _from_an_angle(light, shot.keystone)
    if shot.tilt:
        light = rotate(light, -shot.tilt, mode="edge")
    light = scipy.ndimage.gaussian_filter(light, (shot.blur, shot.blur, 0))
    encoded = np.clip(light, 0, 1) ** (1 / 2.2) + shot.noise * random.standard_normal(light.shape)
    return _as_jpeg(np.clip(encoded, 0, 1), shot.quality), corners


def _check(shot: Shot) -> None:
    for name, value in shot._asdict().items():
        low, high = LOWEST.get(name, 0.0), HIGHEST.get(name, np.inf)
        if name not in SIGNED and not low <= value <= high:
            upper = f" and at most {high:g}" if np.isfinite(high) else ""
            raise SetupError(f"shot.{name} = {value:g}: it should be at least {low:g}{upper}")


def _scene(coarse: xr.DataArray, shot: Shot, random: np.random.Generator) -> Floats:
    """What each grain (row, column, rgb) gives back, with air above and ground below."""
    x, z = (_pixels(coarse[axis].values, shot.pixels) for axis in ("x", "z"))
    seen = coarse.sel(x=x, z=z[::-1], method="nearest").values
    step = max(1, round(shot.grain * shot.pixels))
    grains = 1 + shot.texture * random.standard_normal((len(z) // step + 1, len(x) // step + 1))
    texture = np.kron(grains, np.ones((step, step)))[: len(z), : len(x), None]
    small, large = (np.array(colour) for colour in shot.colours)
    share = np.nan_to_num(seen)[..., None]
    deposit = np.isfinite(seen)
    above = np.cumsum(deposit, axis=0) == 0
    scene = np.where(above[..., None], shot.air, shot.ground)
    return np.where(deposit[..., None], texture * (small + share * (large - small)), scene)


def _pixels(middles: Floats, pixels: float) -> Floats:
    """Where [cm] the middles of pixels are, so many a cm."""
    half = (middles[1] - middles[0]) / 2
    return np.arange(middles[0] - half + 0.5 / pixels, middles[-1] + half, 1 / pixels)


def _lit(scene: Floats, shot: Shot) -> Floats:
    """The scene under light that is brighter on the right, and darker in the corners."""
    rows, columns = scene.shape[:2]
    x, z = np.linspace(0, 1, columns), np.linspace(-1, 1, rows)[:, None]
    across = 1 / shot.light + (1 - 1 / shot.light) * x
    return scene * (across * (1 - shot.vignette * ((2 * x - 1) ** 2 + z**2) / 2))[..., None]


def _from_an_angle(light: Floats, keystone: float) -> tuple[Floats, Floats]:
    """The picture from below its middle, its upper edge shorter, and the cell's corners in it."""
    from skimage.transform import ProjectiveTransform, warp

    rows, columns = light.shape[:2]
    inset = keystone * columns / 2
    cell = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * (columns - 1.0, rows - 1.0)
    corners = cell + np.array([[inset, 0], [-inset, 0], [0, 0], [0, 0]])
    to_scene = ProjectiveTransform.from_estimate(corners, cell)
    return warp(light, to_scene, mode="constant", cval=0.05), corners


def _as_jpeg(picture: Floats, quality: int) -> Floats:
    """The picture as it is read back from a JPEG file."""
    from PIL import Image

    file = io.BytesIO()
    Image.fromarray((255 * picture).astype(np.uint8)).save(file, "jpeg", quality=quality)
    return np.asarray(Image.open(file)) / 255
