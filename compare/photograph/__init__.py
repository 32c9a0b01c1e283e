"""Photographs of a deposit: made upright, parted in two colours, and measured as an archive is.

Needs scikit-image, `pip install 'stratify[photo]'`; nothing of it is imported before it is used.
"""

from compare.photograph.measuring import measure_photograph, read_picture, see
from compare.photograph.view import View

__all__ = ["View", "measure_photograph", "read_picture", "see"]
