"""The look of the pictures: colours that all eyes tell apart, axes that say what they are of."""

import re
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from colorspacious import cspace_convert
from matplotlib import colormaps
from matplotlib.colors import to_rgb

from compare.phase.figure import COLOURS
from compare.pictures.style import FRONT, KINK, MARKS, style
from experiment.arrays import Floats

ROOT = Path(__file__).parent.parent
JUST_SEEN = 1.0  # distance in CAM02-UCS of two colours that are barely told apart
EYES = ["", "protanomaly", "deuteranomaly", "tritanomaly"]


def as_seen(colours: list[str], eyes: str) -> Floats:
    """Lightness and hue of colours (colour, 3) in CAM02-UCS, to those who lack one kind of cone."""
    space = {"name": "sRGB1+CVD", "cvd_type": eyes, "severity": 100} if eyes else "sRGB1"
    return cspace_convert(np.array([to_rgb(colour) for colour in colours]), space, "CAM02-UCS")


@pytest.mark.parametrize("eyes", EYES)
@pytest.mark.parametrize(
    "colours",
    [
        list(COLOURS.values()),
        [mark["color"] for mark in MARKS.values()],
        [KINK["color"], FRONT["color"], "white", "0.4"],
    ],
    ids=["regimes", "models", "lines"],
)
def test_all_eyes_tell_the_colours_apart(colours: list[str], eyes: str) -> None:
    seen = as_seen(colours, eyes)
    nearest = min(float(np.linalg.norm(one - other)) for one, other in combinations(seen, 2))
    assert nearest > 12.0 * JUST_SEEN


@pytest.mark.parametrize("eyes", EYES)
def test_to_all_eyes_a_deposit_grows_brighter_with_its_grains(eyes: str) -> None:
    with style():
        import matplotlib

        colours = colormaps[matplotlib.rcParams["image.cmap"]](np.linspace(0.0, 1.0, 33))
    lightness = as_seen([tuple(colour) for colour in colours], eyes)[:, 0]
    assert (np.diff(lightness) > 0.5 * JUST_SEEN).all()


def test_colours_are_named_in_one_file_only() -> None:
    """What stands in a picture has its colour from the style, or is a grey."""
    for file in (ROOT / "compare").rglob("*.py"):
        if file.name != "style.py":
            found = re.search(r"[\"']#[0-9a-f]{6}[\"']", file.read_text())
            assert found is None, (file, found)
