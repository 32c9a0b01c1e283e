"""The look of the pictures: colours that all eyes tell apart, axes that say what they are of."""

import re
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from colorspacious import cspace_convert
from matplotlib import colormaps, rcParams
from matplotlib.colors import to_rgb
from matplotlib.typing import ColorType

from compare.phase.figure import COLOURS
from compare.pictures.paper.look import LARGE, SMALL
from compare.pictures.style import (
    BLUE,
    FRONT,
    GREEN,
    KINK,
    LIGHT_BLUE,
    MARKS,
    ORANGE,
    PURPLE,
    style,
)
from experiment.arrays import Floats

ROOT = Path(__file__).parent.parent
GREY = 0.05  # the most that red, green and blue of a grey differ
JUST_SEEN = 1.0  # distance in CAM02-UCS of two colours that are barely told apart
with style():
    DEPOSIT = colormaps[rcParams["image.cmap"]]
EYES = ["", "protanomaly", "deuteranomaly", "tritanomaly"]


def as_seen(colours: Sequence[ColorType], eyes: str) -> Floats:
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
        ["black", GREEN, PURPLE],
        [*DEPOSIT([0.0, 1.0])[:, :3], SMALL["color"], LARGE["color"], "white"],
        [BLUE, LIGHT_BLUE, ORANGE, "white"],
    ],
    ids=["regimes", "models", "lines", "functions", "onset", "phase"],
)
def test_all_eyes_tell_the_colours_apart(colours: list[str], eyes: str) -> None:
    seen = as_seen(colours, eyes)
    nearest = min(float(np.linalg.norm(one - other)) for one, other in combinations(seen, 2))
    assert nearest > 12.0 * JUST_SEEN


@pytest.mark.parametrize("eyes", EYES)
def test_to_all_eyes_a_deposit_grows_brighter_with_its_grains(eyes: str) -> None:
    lightness = as_seen(list(DEPOSIT(np.linspace(0.0, 1.0, 33))[:, :3]), eyes)[:, 0]
    assert (np.diff(lightness) > 0.5 * JUST_SEEN).all()


@pytest.mark.parametrize("eyes", EYES)
@pytest.mark.parametrize("line", [KINK, FRONT], ids=["kink", "front"])
def test_all_eyes_tell_a_line_from_every_deposit(line: dict[str, str], eyes: str) -> None:
    """Marks stand on pure layers and on every mixture of them."""
    mark, *deposits = as_seen([line["color"], *DEPOSIT(np.linspace(0.0, 1.0, 33))[:, :3]], eyes)
    assert min(float(np.linalg.norm(mark - deposit)) for deposit in deposits) > 12.0 * JUST_SEEN


def test_colours_are_named_in_one_file_only() -> None:
    """What stands in a picture has its colour from the style, or is a grey."""
    for file in (ROOT / "compare").rglob("*.py"):
        if file.name != "style.py":
            found = re.findall(r"[\"'](#[0-9a-f]{6})[\"']", file.read_text(), re.IGNORECASE)
            assert all(np.ptp(to_rgb(colour)) < GREY for colour in found), (file, found)
