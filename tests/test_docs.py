"""The documentation: its examples run, its links lead somewhere, and it tells all that there is."""

import re
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from pathlib import Path

import click
import pytest
import xarray as xr
from examples import ROOT, Example, commands_in, examples, prints_as_shown, with_pictures

from compare.cli import cli, main
from experiment.archive.variables import COORDINATES, VARIABLES

DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *DOCS.glob("*.md"), *DOCS.glob("[!_]*/**/*.md")]
RECIPES = sorted((DOCS / "how-to").glob("*.md"))
LINK = re.compile(r"\]\(([^)#:\s]+)(?:#[\w-]*)?\)")

sys.path.insert(0, str(DOCS / "_ext"))

import generated  # noqa: E402  that of the documentation, from its own folder


@pytest.fixture
def try_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> Callable[[Example], str]:
    """What an example prints, in one folder for all of a page; all in this process."""
    monkeypatch.chdir(with_pictures(tmp_path))

    def tried(example: Example) -> str:
        name = re.match(r"# (\S+\.toml)\n", example.text)
        if example.language == "toml" and name:
            Path(name[1]).write_text(example.text, encoding="utf-8")
        for line in commands_in(example.text) if example.language.startswith("sh") else ():
            monkeypatch.setattr(sys, "argv", shlex.split(line))
            assert sys.argv[0] == "stratify"
            with pytest.raises(SystemExit) if "fails" in example.language else nullcontext():
                main()
        if example.language == "python":
            exec(example.text, {})  # noqa: S102
        return "".join(capfd.readouterr())

    return tried


def test_the_tutorial_prints_what_it_shows(try_out: Callable[[Example], str]) -> None:
    for example in examples(DOCS / "tutorial.md"):
        printed = try_out(example)
        assert example.shown is None or prints_as_shown(printed, example.shown), printed


@pytest.mark.parametrize("page", RECIPES, ids=lambda page: page.stem)
def test_the_recipes_work(page: Path, try_out: Callable[[Example], str]) -> None:
    for example in examples(page):
        try_out(example)


def test_the_documentation_builds_without_a_warning(tmp_path: Path) -> None:
    building = subprocess.run(
        [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-n", "-q", DOCS, tmp_path],
        capture_output=True,
        text=True,
    )
    assert building.returncode == 0, building.stderr
    assert "wavelength" in (tmp_path / "results.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("printed", "shown", "alike"),
    [
        ("wavelength 1.21 cm", "wavelength 1.20 cm", True),
        ("wavelength 1.31 cm", "wavelength 1.20 cm", False),
        ("a wrote b", "a ... b", True),
        ("a wrote b", "... b", True),
        ("a wrote b", "... wrote ...", True),
        ("a wrote b", "... b ...  wrote ...", False),
        ("a wrote b", "a", False),
        ("a", "a ... a", False),
    ],
)
def test_other_words_or_numbers_are_not_what_is_shown(
    printed: str, shown: str, alike: bool
) -> None:
    assert prints_as_shown(printed, shown) is alike


def named_commands() -> Iterator[str]:
    for page in PAGES:
        for language, text, _ in examples(page):
            if language in ("console", "sh"):
                yield from (line for line in commands_in(text) if line.startswith("stratify "))


@pytest.mark.parametrize("line", sorted(set(named_commands())))
def test_the_commands_that_pages_name_are_there(line: str) -> None:
    verb, *arguments = shlex.split(line.partition(">")[0].partition(" # ")[0])[1:]
    command = cli.get_command(click.Context(cli), verb)
    assert command is not None
    known = {option for parameter in command.params for option in parameter.opts}
    assert {part for part in arguments if part.startswith("-")} <= known


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_file_that_a_page_names_is_there(page: Path) -> None:
    text = re.sub(
        r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE
    )
    for name in LINK.findall(text):
        assert (page.parent / name).exists(), name


@pytest.mark.parametrize("name", generated.PARTS)
def test_the_page_of_set_ups_says_of_every_field_what_it_means(name: str) -> None:
    page = (DOCS / "reference" / "set-up.md").read_text(encoding="utf-8")
    assert f"```{{generated}} set-up {name}\n" in page
    told = generated.set_up(name)
    for field in generated.PARTS[name].model_fields:
        (row,) = (line for line in told.splitlines() if line.startswith(f"| `{field}` |"))
        assert all(cell.strip() for k, cell in enumerate(row.strip("|").split("|")) if k != 2), row
    known = generated.PARTS[name].known_fields({"names": ["small", "large"]})
    if known > set(generated.PARTS[name].model_fields):
        assert all(f"`{shorthand}`" in told + generated.shorthands(name) for shorthand in known)
        assert f"```{{generated}} shorthands {name}\n" in page


def test_the_page_of_the_archive_names_all_that_an_archive_holds(
    poured: Callable[..., xr.Dataset],
) -> None:
    told = generated.variables()
    for variable in (COORDINATES | VARIABLES).values():
        assert f"| `{variable.name}` | {', '.join(variable.dims)} | {variable.units} |" in told
    page = (DOCS / "reference" / "archive.md").read_text(encoding="utf-8")
    for model in ("ca_model", "continuum"):
        attributes = poured(model, "makse-stratification").attrs
        assert [name for name in attributes if f"`{name}`" not in page] == []


def test_every_preset_has_its_place() -> None:
    told = generated.presets()
    assert all(f"## `{name}`\n" in told for name in generated.preset_names())
    assert len(generated.preset_names()) > 10


@pytest.mark.parametrize("package", generated.PACKAGES)
def test_every_public_name_is_documented(package: str) -> None:
    told = generated.api(package)
    homes = rf"(auto\w+:: {package}|`compare\.pictures|`experiment\.law)"
    for name in __import__(package, fromlist=["__all__"]).__all__:
        assert re.search(rf"{homes}\.{name}\b", told), name
    assert f"{{generated}} api {package}\n" in (DOCS / f"reference/api/{package}.md").read_text()
