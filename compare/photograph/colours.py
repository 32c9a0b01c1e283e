"""Two colours of grains under uneven light, and how much of each a pixel shows.

A pixel's light is what falls on the deposit times what its grains give back,

    ln Y(x, z) = p(x, z) + ln Y_grain,

with p a low polynomial in place, so smooth that it follows no layers. The two colours and p are
found by turns: given p, the colours corrected for it are parted in two clusters (k-means in
CIELAB); given the clusters, p and one luminance for each are fitted together, which keeps p from
explaining what the clusters do. The light may hide the colours from the first clusters, or a
deposit of two zones look like uneven light: so both even light and the best single-colour fit are
tried first guesses, and the better end is kept.

Coarseness is the place of a colour on the line from pure small to pure large grains, 0 to 1, not
clipped, so that the noise of single grains has no mean. The middle of a cluster is no pure colour
where grains mix; that is taken near the far end of the cluster.
"""

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from experiment.arrays import Floats
from experiment.errors import PictureError

__all__ = ["Colours", "lab", "part", "polynomial", "smooth"]

DEGREE = 2
TURNS = 12
POINTS = 10_000  # that are clustered, of all
FAR_END = 0.05  # of a cluster, beyond which colours are noise
LEAST_CONTRAST = 5.0  # of two colours, in CIELAB
DARKEST = 1e-3  # luminance; less is taken for this
GRAIN = 1.5  # pixels over which colours are averaged before they are clustered


class Colours(NamedTuple):
    """The light p (row, column) and the CIELAB colours (2, 3) of both kinds of grain in even light.

    `middle` are those of the clusters, `pure` those of unmixed grains; `rest` is the part of the
    variance of colours that is within the clusters.
    """

    light: Floats
    middle: Floats
    pure: Floats
    rest: float

    def fraction(self, light: Floats) -> Floats:
        """Share (row, column) of the second kind in the picture `light` (row, column, 3) in XYZ."""
        line = self.pure[1] - self.pure[0]
        return np.asarray((lab(light, self.light) - self.pure[0]) @ line / (line @ line))


def part(light: Floats, inside: NDArray[np.bool_]) -> Colours:
    """The two colours of the picture `light` (row, column, 3) in XYZ, where it is `inside`.

    Raises :class:`PictureError` where there is only one.
    """
    averaged = smooth(light)
    terms = polynomial(*inside.shape)
    every = max(1, int(inside.sum()) // POINTS)
    colours, places = averaged[inside][::every], terms[inside][::every]
    luminance = np.log(np.maximum(colours[:, 1], DARKEST))
    even = np.zeros(places.shape[1])
    one_colour = np.linalg.lstsq(
        np.column_stack([places, np.ones(len(places))]), luminance, rcond=None
    )[0][:-1]
    ends = [_by_turns(colours, places, luminance, start) for start in (even, one_colour)]
    slopes, middle, pure, rest = min(ends, key=lambda end: end[-1])
    contrast = float(np.linalg.norm(middle[1] - middle[0]))
    if not contrast >= LEAST_CONTRAST:
        raise PictureError(
            f"the deposit shows one colour only: two differ by {contrast:.1f} in CIELAB; "
            f"allowed: at least {LEAST_CONTRAST:g}"
        )
    return Colours(np.asarray(terms @ slopes), middle, pure, rest)


def lab(light: Floats, field: Floats | float = 0.0) -> Floats:
    """CIELAB of XYZ colours (..., 3), once the light exp(`field`) is divided out."""
    from skimage.color import xyz2lab

    return np.asarray(xyz2lab(light / np.exp(np.asarray(field))[..., None]))


def smooth(light: Floats) -> Floats:
    """The picture (row, column, 3), averaged over a grain."""
    return np.asarray(scipy.ndimage.gaussian_filter(light, (GRAIN, GRAIN, 0)))


def polynomial(rows: int, columns: int, degree: int = DEGREE) -> Floats:
    """Every power of place but the constant, (row, column, term), each of mean 0."""
    z, x = np.meshgrid(np.linspace(-1, 1, rows), np.linspace(-1, 1, columns), indexing="ij")
    powers = [
        x**i * z**j for i in range(degree + 1) for j in range(degree + 1) if 0 < i + j <= degree
    ]
    return np.stack([power - power.mean() for power in powers], axis=-1)


def _by_turns(
    colours: Floats, places: Floats, luminance: Floats, slopes: Floats
) -> tuple[Floats, Floats, Floats, float]:
    """Slopes of p, middles and pure colours of two clusters, and the variance left within them."""
    seeds = None
    for _ in range(TURNS):
        even = lab(colours, places @ slopes)
        seeds = _two_seeds(even) if seeds is None else seeds
        try:
            seeds, kind = scipy.cluster.vq.kmeans2(
                even, seeds, iter=2, minit="matrix", missing="raise"
            )
        except scipy.cluster.vq.ClusterError:
            raise PictureError("the deposit shows one colour only; allowed: two") from None
        known = np.column_stack([places, kind == 0, kind == 1])
        slopes = np.linalg.lstsq(known, luminance, rcond=None)[0][: places.shape[1]]
    even = lab(colours, places @ slopes)
    middle = np.stack([even[kind == k].mean(axis=0) for k in (0, 1)])
    rest = sum(((even[kind == k] - middle[k]) ** 2).sum() for k in (0, 1))
    spread = ((even - even.mean(axis=0)) ** 2).sum()
    return slopes, middle, _pure(even, kind, middle), float(rest / spread)


def _two_seeds(colours: Floats) -> Floats:
    """Two colours (2, 3) apart along the direction in which `colours` (n, 3) differ most."""
    mean = colours.mean(axis=0)
    variance, directions = np.linalg.eigh(np.cov(colours.T))
    apart = directions[:, -1] * np.sqrt(variance[-1])
    return np.stack([mean - apart, mean + apart])


def _pure(colours: Floats, kind: NDArray[np.int32], middle: Floats) -> Floats:
    """Colours (2, 3) on the line through the clusters' middles, near each cluster's far end."""
    line = middle[1] - middle[0]
    along = (colours - middle[0]) @ line / (line @ line)
    ends = (
        np.quantile(along[kind == 0], FAR_END),
        np.quantile(along[kind == 1], 1 - FAR_END),
    )
    return np.stack([middle[0] + end * line for end in ends])
