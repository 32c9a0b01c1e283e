"""What a user sees while a command works: lines, and on a terminal bars of progress."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress, TimeElapsedColumn, TimeRemainingColumn

__all__ = ["counting", "open_bars", "open_console", "progress_on", "say"]


EVERY = 10.0  # s, lines of progress where there is no terminal


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
def progress_on(
    name: str, bars: Progress, done: str = "poured"
) -> Iterator[Callable[[float], object]]:
    """A bar while it works, a line once it is `done`, if there was anything to do."""
    started = time.perf_counter()
    task = bars.add_task(name, total=1.0)
    yield lambda share: bars.update(task, completed=share)
    if bars.tasks[task].completed:
        say(f"{name}: {done} in {time.perf_counter() - started:.1f} s", bars.console)


@contextmanager
def counting(name: str, total: int, console: Console) -> Iterator[Callable[[float], object]]:
    """A bar, or lines where there is no terminal, with an estimate of what remains of the jobs."""
    columns = (*Progress.get_default_columns()[:2], MofNCompleteColumn())
    times = (TimeElapsedColumn(), TimeRemainingColumn())
    silent = not console.is_terminal
    started = last = time.perf_counter()
    with Progress(*columns, *times, console=console, transient=True, disable=silent) as bars:
        task = bars.add_task(name, total=total)
        first: tuple[float, float] | None = None  # when the first came, and the share by then

        def tell(share: float) -> None:
            nonlocal last, first
            bars.update(task, completed=round(share * total))
            now = time.perf_counter()
            begun, before = first = first or (now, share)
            if silent and now - last > EVERY and share > before:
                left = (1 - share) / (share - before) * (now - begun)
                say(f"{name}: {share * total:.0f} of {total}, {_time(left)} left", console)
                last = now

        yield tell
    say(f"{name}: {total} jobs done in {_time(time.perf_counter() - started)}", console)


def _time(seconds: float) -> str:
    if seconds < 100:
        return f"{seconds:.1f} s"
    return f"{seconds / 60:.1f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"
