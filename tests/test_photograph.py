"""Photographs of deposits, against the archives that they were rendered from."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from PIL import Image

from compare.deposit import layers_of
from compare.photograph import (
    BROWN_ON_WHITE,
    GREYS,
    RED_AND_GREEN,
    Shot,
    View,
    measure_photograph,
    read_picture,
    render,
    see,
)
from compare.pictures import draw_photograph
from compare.quantities import coarseness
from experiment import PictureError, SetupError

POURS = {
    "sugar": ("ca_model", "glass-sugar"),
    "sugar, continuum": ("continuum", "glass-sugar"),
    "makse": ("ca_model", "makse-stratification"),
    "makse, continuum": ("continuum", "makse-stratification"),
}
LAYERED = list(POURS)


def span(middles: np.ndarray) -> float:
    """From the first edge to the last one of evenly spaced cells."""
    return float(middles[-1] - middles[0] + middles[1] - middles[0])


class Deposit:
    """The middle of a deposit (z, x) with some air above and ground below, and its layers."""

    def __init__(self, archive: xr.Dataset) -> None:
        coarse = coarseness(archive["deposit_fraction"], archive).transpose("z", "x")
        length = float(archive["x"][-1])
        middle = coarse.sel(x=slice(0.2 * length, 0.8 * length))
        filled = np.flatnonzero(np.isfinite(middle).any("x"))
        self.coarse = middle.isel(z=slice(max(filled[0] - 20, 0), filled[-1] + 40))
        self.width, self.height = (span(self.coarse[axis].values) for axis in "xz")
        self.layers = layers_of(self.coarse)

    def shot(self, shot: Shot) -> Shot:
        """A larger cell takes a smaller scale, and is of larger grains."""
        return shot if self.width < 40 else shot._replace(pixels=12.0, grain=0.1)


@pytest.fixture(scope="module")
def deposit(poured: Callable[..., xr.Dataset]) -> Callable[[str], Deposit]:
    kept: dict[str, Deposit] = {}

    def of(name: str) -> Deposit:
        if name not in kept:
            kept[name] = Deposit(poured(*POURS[name]))
        return kept[name]

    return of


def layers_in(deposit: Deposit, shot: Shot, large: str = "bright") -> xr.Dataset:
    picture, corners = render(deposit.coarse, deposit.shot(shot))
    view = View(deposit.width, rotate=shot.tilt)
    if shot.keystone:
        view = View(deposit.width, deposit.height, corners=corners)
    return layers_of(see(picture, view, large)["coarseness"])


def agree(found: xr.Dataset, archive: xr.Dataset, within: float) -> None:
    for name in ("wavelength", "wavelength_normal"):
        assert found[name].item() == pytest.approx(archive[name].item(), rel=within), name
    if archive["pairs_a_cycle"].item() == 1:  # two unlike pairs blur into one
        for name in ("thickness_small", "thickness_large", "wavelength_counted"):
            assert found[name].item() == pytest.approx(archive[name].item(), rel=0.25), name
    assert found["inclination"].item() == pytest.approx(archive["inclination"].item(), abs=0.06)
    assert found["layering"].item() == pytest.approx(archive["layering"].item(), rel=0.3)


@pytest.mark.parametrize("name", ["sugar", "makse"])
@pytest.mark.parametrize(
    ("colours", "air", "large"),
    [
        (BROWN_ON_WHITE, (0.02, 0.03, 0.06), "bright"),
        (BROWN_ON_WHITE[::-1], (0.02, 0.03, 0.06), "dark"),
        (GREYS, (0.9, 0.9, 0.9), "bright"),
        (RED_AND_GREEN, (0.02, 0.03, 0.06), "green"),
    ],
    ids=["brown on white", "white on brown", "greys", "red and green, as bright"],
)
def test_a_photograph_gives_the_layers_of_its_archive(deposit, name, colours, air, large) -> None:
    """Light that doubles across it, dark corners, grains, blur, noise, JPEG: within 3 %."""
    shot = Shot(colours=colours, air=air)
    agree(layers_in(deposit(name), shot, large), deposit(name).layers, 0.03)


@pytest.mark.parametrize("name", LAYERED)
def test_an_oblique_camera_is_set_right_by_the_corners(deposit, name) -> None:
    agree(layers_in(deposit(name), Shot(keystone=0.14)), deposit(name).layers, 0.03)


@pytest.mark.parametrize("name", ["sugar"])
@pytest.mark.parametrize("tilt", [-6.0, 9.0])
def test_a_tilted_camera_is_set_right_by_rotation(deposit, name, tilt) -> None:
    found = layers_in(deposit(name), Shot(tilt=tilt))
    assert found["wavelength"].item() == pytest.approx(
        deposit(name).layers["wavelength"].item(), rel=0.03
    )


def test_without_rotation_the_wavelength_is_that_of_tilted_layers(deposit) -> None:
    """Layers of slope 1 look 9 degrees less steep, and a vertical cut across them is shorter."""
    pile = deposit("makse, continuum")
    picture, _ = render(pile.coarse, pile.shot(Shot(tilt=9.0)))
    found = layers_of(see(picture, View(pile.width))["coarseness"])
    assert abs(found["wavelength"].item() / pile.layers["wavelength"].item() - 1) > 0.05


@pytest.mark.parametrize("name", ["sugar", "makse, continuum"])
def test_mild_perspective_without_corners_costs_its_mean_stretch(deposit, name) -> None:
    """An upper edge 6 % shorter, not set right, is some 3 % of lengths across: within 5 % here."""
    pile = deposit(name)
    picture, _ = render(pile.coarse, pile.shot(Shot(keystone=0.06)))
    crop = ((4.0, True), (0.0, True), (96.0, True), (100.0, True))
    found = layers_of(see(picture, View(0.92 * pile.width, crop=crop))["coarseness"])
    assert found["wavelength"].item() == pytest.approx(pile.layers["wavelength"].item(), rel=0.05)


def test_the_coarseness_of_each_place_is_found_under_uneven_light(deposit) -> None:
    """Pixel by pixel, in a deposit that grades: rms 0.2 and no drift from edge to edge."""
    pile = deposit("sugar, continuum")
    picture, _ = render(pile.coarse, Shot(light=2.0))
    coarse = see(picture, View(pile.width))["coarseness"]
    true = pile.coarse.assign_coords(
        x=pile.coarse["x"] - pile.coarse["x"][0] + 0.5 * pile.width / pile.coarse.sizes["x"],
        z=pile.coarse["z"] - pile.coarse["z"][0] + 0.5 * pile.height / pile.coarse.sizes["z"],
    )
    error = coarse - true.interp(x=coarse["x"], z=coarse["z"], method="nearest")
    assert float((error**2).mean() ** 0.5) < 0.2
    quarter = error.sizes["x"] // 4
    left, right = error[:, :quarter].mean(), error[:, -quarter:].mean()
    assert abs(float(right - left)) < 0.06


def test_air_and_ground_are_left_out_by_themselves(deposit) -> None:
    pile = deposit("sugar, continuum")
    picture, _ = render(pile.coarse, Shot())
    found = see(picture, View(pile.width))["coarseness"]
    thickness = np.isfinite(found).sum("z") * float(found["z"][1] - found["z"][0])
    true = np.isfinite(pile.coarse).sum("z") * float(pile.coarse["z"][1] - pile.coarse["z"][0])
    assert float(thickness.mean()) == pytest.approx(float(true.mean()), abs=0.5)


def test_a_picture_of_the_deposit_alone_is_all_deposit(deposit) -> None:
    pile = deposit("makse, continuum")
    inner = pile.coarse.isel(x=slice(100, 140)).dropna("z")
    picture, _ = render(inner, Shot(pixels=20.0, grain=0.1))
    found = see(picture, View(span(inner["x"].values)))["coarseness"]
    assert np.isfinite(found).all()
    assert layers_of(found)["wavelength"].item() == pytest.approx(
        layers_of(inner)["wavelength"].item(), rel=0.03
    )


def test_two_zones_under_uneven_light_stay_two_zones(poured) -> None:
    """Where the species part, the light must not explain them away."""
    zones = Deposit(poured("continuum", "makse-segregation"))
    picture, _ = render(zones.coarse, zones.shot(Shot()))
    coarse = see(picture, View(zones.width))["coarseness"]
    tenth = coarse.sizes["x"] // 10
    assert float(coarse[:, :tenth].mean() - coarse[:, -tenth:].mean()) == pytest.approx(
        float(zones.coarse[:, :24].mean() - zones.coarse[:, -24:].mean()), abs=0.2
    )


def test_our_own_picture_of_a_deposit_can_be_measured(poured, tmp_path: Path) -> None:
    """`stratify show`'s deposit, the inside of its axes: the layers of the archive, within 3 %."""
    from matplotlib.figure import Figure

    from compare.pictures import draw_deposit, style

    archive = poured("continuum", "glass-sugar")
    with style():
        figure = Figure(figsize=(9, 6))
        axes = figure.subplots()
        draw_deposit(axes, archive)
        figure.savefig(tmp_path / "shown.png", dpi=110)
        inside = axes.get_window_extent()
    rows = read_picture(tmp_path / "shown.png").shape[0]
    length = float(np.ptp(axes.get_xlim()))
    left, right = inside.x0 + 0.2 * inside.width, inside.x0 + 0.8 * inside.width
    _, top = axes.get_ylim()
    corners = [(left, inside.y1), (right, inside.y1), (right, inside.y0), (left, inside.y0)]
    told = tuple(f"{x:.1f},{rows - y:.1f}" for x, y in corners)
    view = View.parse(f"{0.6 * length:.3f}x{top:.3f}cm", corners=told)
    found = measure_photograph(tmp_path / "shown.png", view)
    pile = Deposit(archive)
    assert found["wavelength"].item() == pytest.approx(pile.layers["wavelength"].item(), rel=0.03)


@pytest.mark.parametrize(
    ("shot", "refusal"),
    [
        (Shot(pixels=0.0), "shot.pixels = 0: it should be at least 1"),
        (Shot(blur=-1.0), "shot.blur = -1: it should be at least 0"),
        (Shot(keystone=1.0), "shot.keystone = 1: it should be at least 0 and at most 0.9"),
        (Shot(light=float("nan")), "shot.light = nan: it should be at least 0.01"),
    ],
)
def test_a_shot_that_no_camera_takes_is_refused(deposit, shot: Shot, refusal: str) -> None:
    with pytest.raises(SetupError, match=refusal):
        render(deposit("sugar").coarse, shot)


# How a picture is read and framed.


@pytest.mark.parametrize(
    ("scale", "size"),
    [
        ("30cm", (30.0, None)),
        ("0.3m", (30.0, None)),
        ("300 mm", (30.0, None)),
        ("30", (30.0, None)),
        ("30x20cm", (30.0, 20.0)),
        ("0.3m x 200mm", (30.0, 20.0)),
    ],
)
def test_a_scale_is_a_length_or_two(scale: str, size: tuple[float, float | None]) -> None:
    corners = ("0,0", "9,0", "9,9", "0,9") if size[1] else None
    view = View.parse(scale, corners=corners)
    assert (view.width, view.height) == pytest.approx(size)


@pytest.mark.parametrize("mode", ["L", "RGB", "RGBA", "P", "LA", "I;16", "1", "CMYK"])
def test_any_kind_of_picture_is_read(tmp_path: Path, mode: str) -> None:
    ramp = np.tile(np.linspace(0, 255, 64).astype(np.uint8), (50, 1))
    ending = "tif" if mode == "CMYK" else "png"
    if mode == "I;16":
        image = Image.fromarray(ramp.astype(np.uint16) * 257)
    else:
        image = Image.fromarray(ramp).convert(mode)
    image.save(tmp_path / f"ramp.{ending}")
    pixels = read_picture(tmp_path / f"ramp.{ending}")
    assert pixels.shape == (50, 64, 3)
    assert pixels[:, :8].mean() < 0.1
    assert pixels[:, -8:].mean() > 0.9


def test_a_picture_is_upright_as_its_camera_noted(tmp_path: Path) -> None:
    image = Image.fromarray(np.zeros((50, 64), dtype=np.uint8))
    exif = image.getexif()
    exif[0x0112] = 6
    image.save(tmp_path / "held.jpg", exif=exif)
    assert read_picture(tmp_path / "held.jpg").shape == (64, 50, 3)


@pytest.mark.parametrize(
    ("told", "refusal"),
    [
        ({"scale": "30 feet"}, "scale = 30 feet: it should be a length, as in 30cm"),
        ({"scale": "-3cm"}, "scale = -3cm: it should be a length"),
        ({"scale": "0cm"}, "scale = 0cm: a length should be greater than 0"),
        ({"scale": "30x20cm"}, "a height is told only with corners"),
        ({"scale": "30", "crop": "1,2,3"}, "crop = 1,2,3: it should be left,top,right,bottom"),
        ({"scale": "30", "crop": "a,2,3,4"}, "crop = a,2,3,4: it should be left,top,right"),
        ({"scale": "30", "rotate": 60.0}, "rotate = 60: it should be between -45 and 45"),
        ({"scale": "30", "rotate": float("nan")}, "rotate = nan: it should be between"),
        (
            {"scale": "30", "corners": ("0,0", "9,0", "9,9", "0")},
            "corners = 0,0 9,0 9,9 0: it should be four x,y",
        ),
        (
            {"scale": "30", "corners": ("0,0", "0,9", "9,9", "9,0")},
            "they should go clockwise",
        ),
        (
            {"scale": "30", "corners": ("0,0", "9,0", "9,9", "0,9"), "rotate": 3.0},
            "rotate = 3: with corners the picture is upright already",
        ),
    ],
)
def test_a_view_that_is_none_is_refused(told: dict[str, object], refusal: str) -> None:
    with pytest.raises(SetupError, match=refusal):
        View.parse(**told)


@pytest.mark.parametrize(
    ("view", "error", "refusal"),
    [
        (View.parse("9", "0,0,900,50"), SetupError, r"crop = 0,0,900,50: allowed: left < right"),
        (View.parse("9", "0,0,30,50"), PictureError, "30 x 50 pixels are too few"),
        (
            View.parse("9", corners=("0,0", "900,0", "900,90", "0,90")),
            SetupError,
            "corners: they should lie in the picture, 200 x 100 pixels",
        ),
        (View.parse("9"), PictureError, "the deposit shows one colour only"),
    ],
)
def test_a_part_that_the_picture_has_not_is_refused(view, error, refusal) -> None:
    grey = 0.5 + 0.02 * np.random.default_rng(1).standard_normal((100, 200, 3))
    with pytest.raises(error, match=refusal):
        see(grey, view)


@pytest.mark.parametrize("level", [0.0, 0.4])
def test_a_picture_of_one_colour_is_refused(level: float) -> None:
    with pytest.raises(PictureError, match="one colour only"):
        see(np.full((200, 200, 3), level), View(30.0))


def test_random_pixels_have_no_layers(tmp_path: Path) -> None:
    noise = np.random.default_rng(1).integers(0, 256, (200, 300, 3), dtype=np.uint8)
    Image.fromarray(noise).save(tmp_path / "noise.png")
    found = measure_photograph(tmp_path / "noise.png", View(30.0))
    assert np.isnan(found["wavelength"])
    assert found["layered_share"] < 0.1


def test_a_colour_that_is_none_is_refused_and_one_as_bright_is_a_guess(deposit) -> None:
    pile = deposit("sugar, continuum")
    picture, _ = render(pile.coarse, Shot(colours=RED_AND_GREEN))
    with pytest.raises(SetupError, match="large = heavy: allowed: bright, dark, or a colour"):
        see(picture, View(pile.width), "heavy")
    assert "about as bright" in see(picture, View(pile.width)).attrs["comment"]
    red, green = (see(picture, View(pile.width), name)["coarseness"] for name in ("red", "green"))
    np.testing.assert_allclose(red, 1 - green, atol=1e-9)
    assert see(picture, View(pile.width), "green").attrs["comment"] == ""


# The command.


def stratify(*arguments: object, folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "compare.cli", *map(str, arguments)]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


@pytest.fixture
def cell(deposit, tmp_path: Path) -> Path:
    picture, _ = render(deposit("sugar, continuum").coarse, Shot())
    Image.fromarray((255 * picture).astype(np.uint8)).save(tmp_path / "cell.png")
    return tmp_path


def test_measure_prints_a_table_and_writes_numbers_and_a_picture(cell: Path, deposit) -> None:
    done = stratify("measure", "cell.png", "--scale", "18cm", folder=cell)
    assert done.returncode == 0, done.stderr
    assert "vertical wavelength of the layers, by spectrum (cm)" in done.stdout
    assert "±" in done.stdout
    assert {path.name for path in cell.iterdir()} == {
        "cell.png",
        "cell.layers.nc",
        "cell.layers.png",
    }
    with xr.open_dataset(cell / "cell.layers.nc") as found:
        assert found.attrs["title"] == "cell.png"
        for name in found.data_vars:
            assert found[name].attrs["long_name"]
            assert found[name].attrs["units"]
        agree(found, deposit("sugar, continuum").layers, 0.03)
        assert len(draw_photograph(found.load()).axes[1].lines) == 1
    again = stratify("measure", "cell.png", "--scale", "18cm", folder=cell)
    assert again.returncode == 2
    assert "exists already" in again.stderr
    forced = ["measure", "cell.png", "--scale", "180mm", "--force", "--json"]
    printed = json.loads(stratify(*forced, folder=cell).stdout)
    assert printed["wavelength"] == pytest.approx(found["wavelength"].item())


def test_half_the_scale_is_half_the_wavelength_and_a_crop_keeps_it(cell: Path) -> None:
    whole, half, part = (
        json.loads(stratify("measure", "cell.png", *told, "--json", "--force", folder=cell).stdout)
        for told in (
            ("--scale", "18cm"),
            ("--scale", "9"),
            ("--scale", "9cm", "--crop", "25%,0,75%,100%"),
        )
    )
    assert half["wavelength"] == pytest.approx(whole["wavelength"] / 2)
    assert part["wavelength"] == pytest.approx(whole["wavelength"], rel=0.03)


@pytest.mark.parametrize(
    ("arguments", "refusal"),
    [
        (["cell.png"], "Missing option '--scale'"),
        (["none.png", "--scale", "30cm"], "'none.png': no such picture"),
        (["words.png", "--scale", "30cm"], "'words.png' is not a whole picture"),
        (["cut.png", "--scale", "30cm"], "'cut.png' is not a whole picture"),
        (["cell.png", "--scale", "wide"], "scale = wide: it should be a length"),
        (["cell.png", "--scale", "30cm", "--large", "big"], "large = big: allowed: bright"),
        (["cell.png", "--scale", "30cm", "--crop", "9,9,8,8"], "crop = 9,9,8,8: allowed"),
        (["cell.png", "--scale", "30cm", "-o", "cell.png"], "would replace the picture"),
        (["cell.png", "--scale", "30cm", "-o", "cell.nc", "--force"], "would replace the picture"),
    ],
)
def test_a_refusal_is_one_line_and_writes_nothing(
    cell: Path, arguments: list[str], refusal: str
) -> None:
    (cell / "words.png").write_text("no picture")
    (cell / "cut.png").write_bytes((cell / "cell.png").read_bytes()[:5000])
    before = {path.name for path in cell.iterdir()}
    done = stratify("measure", *arguments, folder=cell)
    assert done.returncode == 2
    assert refusal in done.stderr
    assert done.stderr.count("\n") == 1
    assert {path.name for path in cell.iterdir()} == before


def test_without_scikit_image_one_line_says_how_to_install_it(cell: Path, monkeypatch) -> None:
    monkeypatch.setattr("compare.photograph.measuring.find_spec", lambda _: None)
    with pytest.raises(PictureError, match=r"pip install 'stratify\[photo\]'"):
        read_picture(cell / "cell.png")


def test_scikit_image_is_not_imported_before_it_is_used() -> None:
    script = "import sys, compare.cli; assert not {'skimage', 'PIL'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", script], check=True)
