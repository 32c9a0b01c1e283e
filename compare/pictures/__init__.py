"""Pictures: of archives, of the scaling, of photographs, all in one style."""

from compare.pictures.archives import draw, draw_deposit, draw_kymograph
from compare.pictures.film import animate
from compare.pictures.photograph import draw_photograph
from compare.pictures.scaling import draw_scaling
from compare.pictures.style import save, style

__all__ = [
    "animate",
    "draw",
    "draw_deposit",
    "draw_kymograph",
    "draw_photograph",
    "draw_scaling",
    "save",
    "style",
]
