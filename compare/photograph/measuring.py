"""The layers of a photographed deposit, as numbers: those that an archive's deposit gives.

A picture is read, made upright (`view`) and freed of air and ground (`background`); its colours
become coarseness (`colours`), which :func:`compare.deposit.layers_of` measures as any deposit's.
"""

import warnings
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from compare.deposit import layers_of
from compare.photograph.background import deposit_in
from compare.photograph.colours import Colours, lab, part
from compare.photograph.view import FEWEST, View, straighten
from experiment.archive import CONVENTIONS, history
from experiment.arrays import Floats
from experiment.errors import PictureError, SetupError

__all__ = ["measure_photograph", "read_picture", "see"]

THICK = 0.5  # of the thickest column: what a column should be to be measured
AS_BRIGHT = 5.0  # CIELAB lightness by which two colours differ if one is to be the brighter


def measure_photograph(path: Path, view: View, large: str = "bright") -> xr.Dataset:
    """Layers of the deposit in the picture at `path`, looked at as `view` tells.

    `large` is the colour of the large grains: bright, dark, or the name of a colour that it is
    nearest to. The Dataset is that of :func:`compare.deposit.layers_of`, with what is seen.
    """
    seen = see(read_picture(path), view, large)
    found = layers_of(seen["coarseness"])
    taken = f"the large grains are {large}"
    comments = [found.attrs.get("comment", ""), seen.attrs["comment"], taken]
    return found.assign(seen.astype(np.float32).data_vars).assign_attrs(
        Conventions=CONVENTIONS,
        title=path.name,
        source="photograph",
        history=history("measured"),
        comment="\n".join(filter(None, comments)),
    )


def read_picture(path: Path) -> Floats:
    """The picture at `path` as sRGB (row, column, 3) from 0 to 1, upright as its camera noted.

    What is transparent is white. Raises :class:`PictureError` where there is no whole picture.
    """
    _need_scikit_image()
    from PIL import Image, ImageOps
    from skimage.util import img_as_float32

    if not path.is_file():
        raise PictureError(f"{str(path)!r}: no such picture")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(path) as opened:
                picture = ImageOps.exif_transpose(opened)
                if picture.mode not in ("I;16", "I;16B"):
                    picture = picture.convert("RGBA")
                pixels = img_as_float32(np.asarray(picture))
    except (Image.DecompressionBombWarning, Image.DecompressionBombError):
        raise PictureError(
            f"{str(path)!r} is too large; allowed: {Image.MAX_IMAGE_PIXELS or 0:,} pixels"
        ) from None
    except (OSError, SyntaxError, ValueError) as error:
        raise PictureError(f"{str(path)!r} is not a whole picture: {error}") from None
    if pixels.ndim == 2:
        return np.repeat(pixels[..., None], 3, axis=-1)
    opaque = pixels[..., 3:]
    return np.asarray(pixels[..., :3] * opaque + (1 - opaque))


def see(picture: Floats, view: View, large: str = "bright") -> xr.Dataset:
    """The deposit in the sRGB `picture` (row, column, 3) from 0 to 1, looked at as `view` tells.

    coarseness (z, x), 0 small to 1 large grains, NaN outside of the deposit, and the upright
    picture (z, x, rgb); z is in cm above the lower edge of what `view` leaves, x from its left.
    Thin columns at either side are left out. Raises :class:`SetupError` for a view or colour that
    the picture has not, :class:`PictureError` where no deposit of two colours is seen.
    """
    from skimage.color import rgb2xyz, xyz2rgb

    frame = straighten(rgb2xyz(picture), view)
    rows, columns = frame.seen.shape
    inside = deposit_in(frame.light, frame.seen)
    thick = _thick_columns(inside)
    light, inside = frame.light[:, thick], inside[:, thick]
    colours, comment = _small_first(part(light, inside), large)
    coarse = np.where(inside, colours.fraction(light), np.nan)
    named = {"units": "1", "long_name": "coarseness (0 small, 1 large)"}
    z = (np.arange(rows) + 0.5) * frame.height / rows
    x = (np.arange(columns)[thick] + 0.5) * frame.width / columns
    return xr.Dataset(
        {
            "coarseness": (("z", "x"), coarse[::-1], named),
            "picture": (
                ("z", "x", "rgb"),
                np.clip(xyz2rgb(light), 0, 1)[::-1],
                {"units": "1", "long_name": "picture, upright"},
            ),
        },
        {
            "z": ("z", z, {"units": "cm", "long_name": "height in the picture"}),
            "x": ("x", x, {"units": "cm", "long_name": "distance from the left edge"}),
        },
        {"comment": comment},
    )


def _thick_columns(inside: NDArray[np.bool_]) -> slice:
    """The longest run of columns that are at least half as thick as the thickest."""
    thickness = inside.sum(axis=0)
    thick = thickness >= max(FEWEST, THICK * thickness.max())
    edges = np.flatnonzero(np.diff(np.concatenate([[0], thick, [0]])))
    starts, stops = edges[::2], edges[1::2]
    if not len(starts) or (stops - starts).max() < FEWEST:
        raise PictureError(f"no deposit is seen; allowed: at least {FEWEST} x {FEWEST} pixels")
    longest = int((stops - starts).argmax())
    return slice(int(starts[longest]), int(stops[longest]))


def _small_first(colours: Colours, large: str) -> tuple[Colours, str]:
    """The colours with the small grains' first, and what is to be said of that."""
    from matplotlib.colors import is_color_like, to_rgb
    from skimage.color import rgb2xyz

    lightness = colours.middle[:, 0]
    comment = ""
    if large in ("bright", "dark"):
        second = int(lightness.argmax() if large == "bright" else lightness.argmin())
        if abs(lightness[1] - lightness[0]) < AS_BRIGHT:
            comment = f"both colours are about as bright: large = {large} is a guess; name a colour"
    elif is_color_like(large):
        named = lab(rgb2xyz(np.array(to_rgb(large))))
        second = int(np.linalg.norm(colours.pure - named, axis=-1).argmin())
    else:
        raise SetupError(f"large = {large}: allowed: bright, dark, or a colour (red, #aa7744)")
    order = [1 - second, second]
    return colours._replace(middle=colours.middle[order], pure=colours.pure[order]), comment


def _need_scikit_image() -> None:
    if find_spec("skimage") is None:
        raise PictureError("pictures are read by scikit-image: pip install 'stratify[photo]'")
