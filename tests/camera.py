"""A deposit as a camera sees it: two colours of grains, light, lens, angle, and a JPEG file."""

import io
from typing import NamedTuple

import numpy as np
import scipy
import xarray as xr
from PIL import Image
from skimage.transform import ProjectiveTransform, rotate, warp

BROWN_ON_WHITE = ((0.28, 0.16, 0.08), (0.80, 0.78, 0.72))
GREYS = ((0.12, 0.12, 0.12), (0.45, 0.45, 0.45))
RED_AND_GREEN = ((0.42, 0.12, 0.10), (0.10, 0.215, 0.10))  # linear light, equal luminance


class Shot(NamedTuple):
    """How a picture is taken. Colours are linear RGB, of small grains first."""

    colours: tuple[tuple[float, ...], tuple[float, ...]] = BROWN_ON_WHITE
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


def photograph(coarse: xr.DataArray, shot: Shot) -> tuple[np.ndarray, np.ndarray]:
    """The picture (row, column, 3) in sRGB, and the corners (4, 2) of the cell in it."""
    random = np.random.default_rng(7)
    light = _lit(_scene(coarse, shot, random), shot)
    light, corners = _from_an_angle(light, shot.keystone)
    if shot.tilt:
        light = rotate(light, -shot.tilt, mode="edge")
    light = scipy.ndimage.gaussian_filter(light, (shot.blur, shot.blur, 0))
    encoded = np.clip(light, 0, 1) ** (1 / 2.2) + shot.noise * random.standard_normal(light.shape)
    return _as_jpeg(np.clip(encoded, 0, 1), shot.quality), corners


def _scene(coarse: xr.DataArray, shot: Shot, random: np.random.Generator) -> np.ndarray:
    """What each grain of the deposit gives back, with air above and ground below it."""
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


def _pixels(middles: np.ndarray, pixels: float) -> np.ndarray:
    half = (middles[1] - middles[0]) / 2
    return np.arange(middles[0] - half + 0.5 / pixels, middles[-1] + half, 1 / pixels)


def _lit(scene: np.ndarray, shot: Shot) -> np.ndarray:
    rows, columns = scene.shape[:2]
    x, z = np.linspace(0, 1, columns), np.linspace(-1, 1, rows)[:, None]
    across = 1 / shot.light + (1 - 1 / shot.light) * x
    return scene * (across * (1 - shot.vignette * ((2 * x - 1) ** 2 + z**2) / 2))[..., None]


def _from_an_angle(light: np.ndarray, keystone: float) -> tuple[np.ndarray, np.ndarray]:
    rows, columns = light.shape[:2]
    inset = keystone * columns / 2
    cell = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * (columns - 1.0, rows - 1.0)
    corners = cell + np.array([[inset, 0], [-inset, 0], [0, 0], [0, 0]])
    to_scene = ProjectiveTransform.from_estimate(corners, cell)
    return warp(light, to_scene, mode="constant", cval=0.05), corners


def _as_jpeg(picture: np.ndarray, quality: int) -> np.ndarray:
    file = io.BytesIO()
    Image.fromarray((255 * picture).astype(np.uint8)).save(file, "jpeg", quality=quality)
    return np.asarray(Image.open(file)) / 255
