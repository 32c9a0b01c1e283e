"""The README's examples run as they stand."""

import re
from pathlib import Path

from examples import ROOT, Example, examples, run, with_pictures

README = ROOT / "README.md"


def example_in(language: str) -> Example:
    (found,) = (example for example in examples(README) if example.language == language)
    return found


def test_the_python_example_runs(tmp_path: Path) -> None:
    assert "vertical wavelength of the layers" in run(example_in("python"), tmp_path)


def test_the_commands_run_in_their_order(tmp_path: Path) -> None:
    commands = example_in("sh")
    shorter = commands.text.replace("mine.toml --set", "mine.toml --set pour.duration=60.0 --set")
    printed = run(commands._replace(text=shorter), with_pictures(tmp_path))
    assert (tmp_path / "pours" / "mine" / "comparison.png").exists()
    found = re.search(r"by spectrum \(cm\) *│ (\S+)", printed)
    assert found
    assert abs(float(found[1]) - 1.2) < 0.02


def test_the_make_targets_it_names_are_there() -> None:
    named = set(re.findall(r"^    make (\w+)", README.read_text(), re.MULTILINE))
    assert named == {"run", "test"}
    assert named <= set(re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
