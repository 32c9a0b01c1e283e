"""What of a picture is not the deposit: air above it, and ground beneath.

Assumed of a background: it covers at least half of the picture's upper (lower) edge, in one colour
that changes only slowly along the picture and is no mixture of the deposit's two, and it does not
run through to the other edge in most columns. What is not of this kind has to be cropped away.
"""

import numpy as np
import scipy
from numpy.typing import NDArray

from compare.photograph.colours import lab, part, polynomial, smooth
from experiment.arrays import Floats
from experiment.errors import PictureError

__all__ = ["deposit_in"]

Mask = NDArray[np.bool_]

STRIP = 0.01  # of the rows: what is looked at first
NEAR = 6.0  # how far a background's colour may be from its own smooth course, in CIELAB
UNLIKE = 0.35  # how far it should be from mixtures of the deposit's two, of their distance
REACH = 0.5  # of the edge that it covers at least, and of the columns that it may run through
MARGIN = 0.006  # of the columns: what is left out along its edge, where colours blur


def deposit_in(light: Floats, seen: Mask) -> Mask:
    """Where the picture `light` (row, column, 3), in XYZ, of which `seen` is known, is deposit."""
    inside = seen.copy()
    for way in (slice(None), slice(None, None, -1)):
        covered = _covered(light[way], inside[way])
        if covered is not None:
            inside &= ~covered[way]
    return inside


def _covered(light: Floats, inside: Mask) -> Mask | None:
    """What of the picture is a background that comes in from its upper edge; None if nothing."""
    grown = _grown(lab(smooth(light)), inside)
    if grown is None:
        return None
    rows, columns = inside.shape
    reaches = grown.any(axis=0)
    depth = np.where(reaches, rows - grown[::-1].argmax(axis=0), 0)
    if reaches.mean() < REACH or (depth == rows).mean() > REACH:
        return None
    margin = 2 + round(MARGIN * columns)
    depth = scipy.ndimage.maximum_filter1d(scipy.ndimage.median_filter(depth, margin), margin)
    covered = np.arange(rows)[:, None] < depth + margin * (depth > 0)
    return covered if _is_unlike(light, grown, inside & ~covered) else None


def _grown(colours: Floats, inside: Mask) -> Mask | None:
    """The region of one smooth course of colour that holds most of the upper edge."""
    rows, columns = inside.shape
    strip = inside & (np.arange(rows)[:, None] < max(2, round(STRIP * rows)))
    if not strip.any():
        return None
    level = np.median(colours[strip], axis=0)
    near = np.linalg.norm(colours - level, axis=-1) < NEAR
    terms = polynomial(rows, columns)
    terms = np.concatenate([terms, np.ones((rows, columns, 1))], axis=-1)
    for _ in range(4):
        grown = _touching_the_top(near & inside, strip)
        if not grown.any():
            return None
        course = np.linalg.lstsq(terms[grown], colours[grown], rcond=None)[0]
        near = np.linalg.norm(colours - terms @ course, axis=-1) < NEAR
    return grown


def _touching_the_top(near: Mask, strip: Mask) -> Mask:
    """The parts of `near`, threads left out, that hold some of the `strip`."""
    padded = np.pad(near, 2, mode="edge")
    solid = scipy.ndimage.binary_opening(padded, np.ones((3, 3), dtype=np.bool_))[2:-2, 2:-2]
    labels, _ = scipy.ndimage.label(solid)
    return np.asarray(np.isin(labels, np.unique(labels[strip & solid])) & solid)


def _is_unlike(light: Floats, background: Mask, deposit: Mask) -> bool:
    """Whether the background's colour is no mixture of the deposit's two, in its light."""
    if not deposit.any():
        return False
    try:
        colours = part(light, deposit)
    except PictureError:
        return True
    field = np.clip(colours.light, colours.light[deposit].min(), colours.light[deposit].max())
    colour = lab(light[background], field[background]).mean(axis=0)
    first, second = colours.middle
    line = second - first
    mixed = np.clip((colour - first) @ line / (line @ line), 0, 1)
    apart = np.linalg.norm(colour - first - mixed * line)
    return bool(apart > UNLIKE * np.linalg.norm(line))
