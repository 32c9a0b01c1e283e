"""Examples in pages: they are run, and what stands below them is compared with what they print.

Below commands (`sh`; `sh fails`, of one that is bad input) or Python a block of `text` is what they
print: words as they are, numbers to 5 %, and `...` for anything. A block of `toml` whose
first line is a comment is the file of that name. What is in a block of `console` is not run.
"""

import math
import os
import re
import shutil
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parent.parent
BLOCK = re.compile(r"^```([\w ]*)\n(.*?)^```", re.DOTALL | re.MULTILINE)
TOKEN = re.compile(r"-?\d+(?:\.\d+)?(?:e[-+]\d+)?|[^\W\d]+|[^\s\w\u2500-\u257f]")
ANYTHING = re.compile(r"(?<!\S)\.\.\.(?!\S)")


class Example(NamedTuple):
    """A block of a page, and what it is said to print."""

    language: str
    text: str
    shown: str | None


def examples(page: Path) -> list[Example]:
    """The blocks of a page that are no output, in their order."""
    blocks = [*BLOCK.findall(page.read_text(encoding="utf-8")), ("", "")]
    return [
        Example(language, text, below if kind == "text" else None)
        for (language, text), (kind, below) in pairwise(blocks)
        if language != "text"
    ]


def with_pictures(folder: Path) -> Path:
    """`folder`, with the pictures that pages measure where they say."""
    (folder / "docs").mkdir()
    shutil.copy(ROOT / "docs" / "glass-sugar.png", folder / "docs")
    return folder


def commands_in(text: str) -> list[str]:
    """The lines of a block of commands, those that end in a backslash joined."""
    return text.replace("\\\n", " ").splitlines()


def run(example: Example, folder: Path) -> str:
    """What the commands, or the Python, of an example print when they are run in `folder`."""
    tool = [sys.executable, "-W", "error"] if example.language == "python" else ["/bin/sh", "-e"]
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        [*tool, "-c", example.text],
        cwd=folder,
        env={**os.environ, "PATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def prints_as_shown(printed: str, shown: str) -> bool:
    """Whether what is `printed` begins, goes on between each `...` and ends as is `shown`."""
    tokens = TOKEN.findall(printed)
    first, *others = [TOKEN.findall(part) for part in ANYTHING.split(shown)]
    if not others:
        return _alike(tokens, first)
    *between, last = others
    begin, end = len(first), len(tokens) - len(last)
    return (
        begin <= end
        and _alike(tokens[:begin], first)
        and _in_turn(tokens[begin:end], between)
        and _alike(tokens[end:], last)
    )


def _in_turn(tokens: list[str], parts: list[list[str]]) -> bool:
    """Whether all `parts` are among the tokens, one after the other."""
    for part in parts:
        starts = range(len(tokens) - len(part) + 1)
        found = next((k for k in starts if _alike(tokens[k : k + len(part)], part)), None)
        if found is None:
            return False
        tokens = tokens[found + len(part) :]
    return True


def _alike(printed: list[str], shown: list[str]) -> bool:
    return len(printed) == len(shown) and all(map(_is_alike, printed, shown))


def _is_alike(printed: str, shown: str) -> bool:
    try:
        return math.isclose(float(printed), float(shown), rel_tol=0.05)
    except ValueError:
        return printed == shown
