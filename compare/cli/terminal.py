"""What a user sees while a command works: lines, and on a terminal bars of progress."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import Progress

__all__ = ["open_bars", "open_console", "progress_on", "say"]


def open_console(*, stderr: bool = False) -> Console:
    """Where to print: as wide as the terminal, or as wide as the table needs."""
    stream = sys.stderr if stderr else sys.stdout
    return Console(highlight=False, stderr=stderr, width=None if stream.isatty() else 100)


def say(line: str, console: Console | None = None) -> None:
    """Print a line as it is, however long."""
    (console or open_console()).print(line, soft_wrap=True, markup=False)


@contextmanager
def open_bars(console: Console | None = None) -> Iterator[Progress]:
    """Where bars of progress are drawn, on a terminal only."""
    console = console or open_console()
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bars:
        yield bars


@contextmanager
def progress_on(name: str, bars: Progress) -> Iterator[Callable[[float], object]]:
    """A bar while it pours, a line once it has, if there was anything to pour."""
    started = time.perf_counter()
    task = bars.add_task(name, total=1.0)
    yield lambda share: bars.update(task, completed=share)
    if bars.tasks[task].completed:
        say(f"{name}: poured in {time.perf_counter() - started:.1f} s", bars.console)
