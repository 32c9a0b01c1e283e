"""Notebooks: what is kept in them is what a run from top to bottom gives."""

import re
import runpy
from collections.abc import Iterator
from pathlib import Path

import nbformat
import pytest

FOLDER = Path(__file__).parent.parent / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
RUN = runpy.run_path(str(FOLDER / "execute.py"))
NUMBER = re.compile(r"-?\d+(?:\.(\d+))?(?:e(-?\d+))?")
MOST_BYTES = 1_500_000
of_each = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def code_cells(notebook: nbformat.NotebookNode) -> list[nbformat.NotebookNode]:
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


def printed(cell: nbformat.NotebookNode) -> str:
    return "".join(output.get("text", "") for output in cell["outputs"])


def pictures(cell: nbformat.NotebookNode) -> int:
    return sum("image/png" in output.get("data", {}) for output in cell["outputs"])


def numbers(text: str) -> Iterator[tuple[float, float]]:
    """Each number in a text, and what its last digit counts."""
    for found in NUMBER.finditer(text):
        digits, power = len(found[1] or ""), int(found[2] or 0)
        yield float(found[0]), 10.0 ** (power - digits)


def assert_same(fresh: str, kept: str) -> None:
    """The same words, and numbers to 2 % or two in the last digit: processors round unlike."""
    words, kept_words = (NUMBER.sub("#", text).split() for text in (fresh, kept))
    assert words == kept_words
    for (value, _), (expected, last) in zip(numbers(fresh), numbers(kept), strict=True):
        assert value == pytest.approx(expected, rel=0.02, abs=2.01 * last), kept


@of_each
@pytest.mark.filterwarnings("default")  # those of the notebook machinery are not ours
def test_a_run_gives_what_is_kept(path: Path) -> None:
    """Asserts in the cells hold, numbers are those kept, and pictures are where they were."""
    kept, fresh = code_cells(nbformat.read(path, as_version=4)), code_cells(RUN["executed"](path))
    for before, after in zip(kept, fresh, strict=True):
        assert_same(printed(after), printed(before))
        assert pictures(after) == pictures(before)


@of_each
def test_outputs_are_kept_of_one_run(path: Path) -> None:
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    cells = code_cells(notebook)
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    assert sum(map(pictures, cells)) >= 2
    assert any(map(printed, cells))
    told = [output for cell in cells for output in cell["outputs"]]
    assert all(output["output_type"] != "error" for output in told)
    assert all(output.get("name", "stdout") == "stdout" for output in told)


@of_each
def test_nothing_of_a_machine_is_kept(path: Path) -> None:
    """No folders, no dates, no kernel's version; what runs again unchanged stays as it is."""
    notebook = nbformat.read(path, as_version=4)
    assert notebook["metadata"] == RUN["METADATA"]
    assert [cell["id"] for cell in notebook["cells"]] == [
        f"cell-{k:02d}" for k in range(len(notebook["cells"]))
    ]
    assert not any(cell["metadata"] for cell in notebook["cells"])
    for cell in code_cells(notebook):
        assert not re.search(r"(^|[\s'\"])/\w+/|\d{4}-\d\d-\d\d", printed(cell))


def test_notebooks_are_small() -> None:
    assert len(NOTEBOOKS) == 6
    assert sum(path.stat().st_size for path in NOTEBOOKS) < MOST_BYTES


@pytest.mark.parametrize(
    "fresh", ["wavelength 1.30 ± 0.01 cm", "wavelength 1.2 ± 0.01 m", "wavelength 1.20 cm"]
)
def test_another_number_or_word_is_seen(fresh: str) -> None:
    assert_same("wavelength 1.21 ± 0.02  cm", "wavelength 1.20 ± 0.01 cm")
    with pytest.raises(AssertionError):
        assert_same(fresh, "wavelength 1.20 ± 0.01 cm")
