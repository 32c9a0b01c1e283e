"""Pours for the tests of what goes to disk: by the command as a user gives it, and stopped."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path


def stratify(*arguments: object, folder: Path) -> subprocess.CompletedProcess[str]:
    command = [str(Path(sys.executable).parent / "stratify"), *map(str, arguments)]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def stopping_after(pauses: int) -> Callable[[], bool]:
    """What says "stop" at the pause after so many, and ever after."""
    left = iter([False] * pauses)
    return lambda: next(left, True)
