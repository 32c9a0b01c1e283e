"""Photographs of a deposit: made upright, parted in two colours, and measured as an archive is.

Or rendered from one (`rendering`), to know beforehand what a camera and its light can measure.

Needs scikit-image, `pip install 'stratify[photo]'`; nothing of it is imported before it is used.
"""

from compare.photograph.measuring import measure_photograph, read_picture, see
from compare.photograph.rendering import BROWN_ON_WHITE, GREYS, RED_AND_GREEN, Shot, render
from compare.photograph.view import View

__all__ = [
    "BROWN_ON_WHITE",
    "GREYS",
    "RED_AND_GREEN",
    "Shot",
    "View",
    "measure_photograph",
    "read_picture",
    "render",
    "see",
]
