"""The README's examples run as they stand."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text()


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


def test_the_python_example_runs(tmp_path: Path) -> None:
    (example,) = blocks("python")
    command = [sys.executable, "-W", "error", "-c", example]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "vertical wavelength of the layers" in done.stdout


def test_the_commands_run_in_their_order(tmp_path: Path) -> None:
    (commands,) = blocks("sh")
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    shorter = commands.replace("mine.toml --set", "mine.toml --set pour.duration=60.0 --set")
    shutil.copytree(ROOT / "docs", tmp_path / "docs")
    done = subprocess.run(
        ["/bin/sh", "-e", "-c", shorter],
        cwd=tmp_path,
        env={**os.environ, "PATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "pours" / "mine" / "comparison.png").exists()
    found = re.search(r"by spectrum \(cm\) *│ (\S+)", done.stdout)
    assert found
    assert abs(float(found[1]) - 1.2) < 0.02


def test_every_file_it_names_is_there() -> None:
    named = re.findall(r"\]\(([^)#:]+)\)", README)
    assert named
    assert all((ROOT / name).exists() for name in named)


def test_the_make_targets_it_names_are_there() -> None:
    named = set(re.findall(r"^    make (\w+)", README, re.MULTILINE))
    assert named == {"run", "test"}
    assert named <= set(re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
