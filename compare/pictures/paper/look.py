"""What the figures of the paper have in common: colours of the species, letters of the panels."""

from collections.abc import Iterable
from string import ascii_lowercase
from typing import TYPE_CHECKING, Any

from compare.pictures.style import BLUE, VERMILION

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["LARGE", "SMALL", "THIN", "letter", "page"]

WIDTH = 7.2  # inches, of a page
DOTS = 150  # an inch, where a figure is made of them
SMALL: dict[str, Any] = {"color": BLUE}
LARGE: dict[str, Any] = {"color": VERMILION}
THIN: dict[str, Any] = {"linewidth": 0.8, "linestyle": "--"}


def page(height: float) -> "Figure":
    """A figure as wide as a page and so high [inches]."""
    from matplotlib.figure import Figure

    return Figure(figsize=(WIDTH, height), dpi=DOTS)


def letter(panels: Iterable["Axes"], titles: Iterable[str]) -> None:
    """Give the panels their letters, and a title each."""
    for axes, name, title in zip(panels, ascii_lowercase, titles, strict=False):
        axes.set_title(rf"$\mathbf{{{name}}}$  {title}", loc="left")
