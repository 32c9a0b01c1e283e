"""How a picture is looked at: which part of it is the deposit, upright, and how many cm it spans.

A camera that looks at the cell from an angle maps its plane by a projective transform; the four
corners of the cell in the picture undo it. A tilted camera is undone by a rotation. Both are done
in linear light (CIE XYZ), in which what a lens blurs or a coarser grid of pixels averages adds up.
"""

import re
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from experiment.arrays import Floats
from experiment.errors import PictureError, SetupError

__all__ = ["Frame", "View", "straighten"]

CM = {"mm": 0.1, "cm": 1.0, "m": 100.0, "": 1.0}
Crop = tuple[tuple[float, bool], ...]  # left, top, right, bottom: each a number, and whether in %
LENGTH = r"(\d*\.?\d+|\d+\.)\s*(mm|cm|m|)"
SCALE = re.compile(rf"{LENGTH}(?:\s*x\s*{LENGTH})?")
EDGE = re.compile(r"(\d*\.?\d+|\d+\.)\s*(%?)")
MOST_COLUMNS = 1000  # a finer picture is averaged down to this
FEWEST = 40  # rows and columns that a deposit takes
STEEPEST = 45.0  # degrees that a camera may be tilted


class View(NamedTuple):
    """What the user says of a picture; see :meth:`parse` for what each text may be."""

    width: float
    height: float | None = None
    crop: Crop | None = None
    corners: Floats | None = None
    rotate: float = 0.0

    @classmethod
    def parse(
        cls,
        scale: str,
        crop: str | None = None,
        corners: tuple[str, ...] | None = None,
        rotate: float = 0.0,
    ) -> Self:
        """The view that these texts tell. Raises :class:`SetupError` for one that is none.

        scale: 30cm, 300mm, 0.3m or 30 (cm) wide; with corners, also 30x20cm, wide and high.
        crop: left,top,right,bottom, each in pixels or, as in 5%, in parts of the picture.
        corners: four x,y in pixels, clockwise from the upper left. rotate: degrees, anticlockwise.
        """
        width, height = _scale(scale)
        if height is not None and not corners:
            raise SetupError(f"scale = {scale}: a height is told only with corners; allowed: 30cm")
        if corners and rotate:
            raise SetupError(f"rotate = {rotate:g}: with corners the picture is upright already")
        if not abs(rotate) <= STEEPEST:
            raise SetupError(f"rotate = {rotate:g}: it should be between -45 and 45 degrees")
        edges = None if crop is None else _crop(crop)
        return cls(width, height, edges, _corners(corners) if corners else None, rotate)


class Frame(NamedTuple):
    """An upright picture: XYZ colours (row, column, 3), where it has any, and its size in cm."""

    light: Floats
    seen: NDArray[np.bool_]
    width: float
    height: float


def straighten(light: Floats, view: View) -> Frame:
    """The part of the picture `light` (row, column, 3), in XYZ, that `view` tells, upright.

    Raises :class:`SetupError` for corners or edges outside of the picture, and for a part that is
    too small.
    """
    from skimage.transform import resize

    rows, columns = light.shape[:2]
    seen: Floats = np.ones((rows, columns))
    cm = view.width
    if view.corners is not None:
        light = _rectify(light, view.corners)
        rows, columns = light.shape[:2]
        seen = np.ones((rows, columns))
    elif view.rotate:
        light, seen = _turn(light, view.rotate), _turn(seen, view.rotate, outside=0.0)
    left, top, right, bottom = _edges(view.crop, columns, rows)
    light, seen = light[top:bottom, left:right], seen[top:bottom, left:right]
    if view.corners is None:
        height = cm * (bottom - top) / (right - left)
    else:
        height = (view.height or cm * rows / columns) * (bottom - top) / rows
        cm *= (right - left) / columns
    if right - left > MOST_COLUMNS:
        size = (round(MOST_COLUMNS * (bottom - top) / (right - left)), MOST_COLUMNS)
        light = resize(light, (*size, 3), order=1, anti_aliasing=True)
        seen = resize(seen, size, order=1, anti_aliasing=True)
    return Frame(light, seen > 1 - 1e-6, cm, height)


def _rectify(light: Floats, corners: Floats) -> Floats:
    """What lies between the four `corners`, as the camera would see it from the front."""
    from skimage.transform import ProjectiveTransform, warp

    rows, columns = light.shape[:2]
    if not ((corners >= 0) & (corners <= (columns, rows))).all():
        raise SetupError(f"corners: they should lie in the picture, {columns} x {rows} pixels")
    sides = np.linalg.norm(corners - np.roll(corners, -1, axis=0), axis=1)
    wide, high = (round(float(side)) for side in (sides[::2].mean(), sides[1::2].mean()))
    _refuse_small(wide, high)
    upright = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * (wide - 1, high - 1)
    to_picture = ProjectiveTransform.from_estimate(upright, corners)
    return np.asarray(warp(light, to_picture, output_shape=(high, wide), mode="edge"))


def _turn(values: Floats, degrees: float, outside: float | None = None) -> Floats:
    """The picture turned about its middle, of unchanged size; what comes in repeats the edge."""
    from skimage.transform import rotate

    mode = "edge" if outside is None else "constant"
    return np.asarray(rotate(values, degrees, mode=mode, cval=outside or 0.0))


def _edges(crop: Crop | None, columns: int, rows: int) -> tuple[int, int, int, int]:
    """Left, top, right and bottom edge in pixels of a picture of `columns` and `rows`."""
    if crop is None:
        crop = ((0.0, False), (0.0, False), (columns, False), (rows, False))
    sizes = (columns, rows, columns, rows)
    left, top, right, bottom = (
        round(edge * size / 100 if percent else edge)
        for (edge, percent), size in zip(crop, sizes, strict=True)
    )
    if not (0 <= left < right <= columns and 0 <= top < bottom <= rows):
        raise SetupError(
            f"crop = {left},{top},{right},{bottom}: allowed: left < right <= {columns} and "
            f"top < bottom <= {rows} pixels"
        )
    _refuse_small(right - left, bottom - top)
    return left, top, right, bottom


def _refuse_small(columns: int, rows: int) -> None:
    if min(columns, rows) < FEWEST:
        raise PictureError(
            f"{columns} x {rows} pixels are too few; allowed: at least {FEWEST} each way"
        )


def _scale(text: str) -> tuple[float, float | None]:
    """Width and, where it is told, height in cm."""
    matched = SCALE.fullmatch(text.strip())
    if matched is None:
        raise SetupError(f"scale = {text}: it should be a length, as in 30cm, 300mm, 0.3m or 30")
    width, unit, height, unit_of_height = matched.groups()
    last = unit_of_height or unit or ""
    sides = [float(width) * CM[unit or last]]
    if height is not None:
        sides.append(float(height) * CM[last])
    if not min(sides) > 0:
        raise SetupError(f"scale = {text}: a length should be greater than 0")
    return sides[0], sides[1] if height is not None else None


def _crop(text: str) -> Crop:
    edges = [EDGE.fullmatch(edge.strip()) for edge in text.split(",")]
    if len(edges) != 4 or None in edges:
        raise SetupError(
            f"crop = {text}: it should be left,top,right,bottom in pixels or %, as in 10,5%,900,95%"
        )
    return tuple((float(edge[1]), bool(edge[2])) for edge in edges if edge)


def _corners(texts: tuple[str, ...]) -> Floats:
    """Corners (4, 2), clockwise from the upper left."""
    try:
        corners = np.array([[float(number) for number in text.split(",")] for text in texts])
        shaped = corners.shape == (4, 2)
    except ValueError:
        shaped = False
    told = f"corners = {' '.join(texts)}"
    if not shaped:
        raise SetupError(f"{told}: it should be four x,y in pixels, as in 12,8 630,5 640,410 9,400")
    sides = np.roll(corners, -1, axis=0) - corners
    after = np.roll(sides, -1, axis=0)
    bends = sides[:, 0] * after[:, 1] - sides[:, 1] * after[:, 0]
    if not ((bends > 0).all() and corners[0].sum() == corners.sum(axis=1).min()):
        raise SetupError(f"{told}: they should go clockwise (x right, y down) from the upper left")
    return corners
