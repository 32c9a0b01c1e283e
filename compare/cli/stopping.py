"""What a user's or a system's wish to stop does to a command that can go on later."""

import shlex
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn, Self

import click

__all__ = ["Stop", "tell_how_to_go_on", "told_how_to_go_on"]

HEEDED = (signal.SIGINT, signal.SIGTERM)


class Stop:
    """Whether somebody pressed Ctrl-C or asked the process to end; the second time it ends.

    A signal that the process was started to ignore stays ignored.
    """

    def __init__(self) -> None:
        self.signal = 0
        handlers = {number: signal.getsignal(number) for number in HEEDED}
        self._before = {n: heard for n, heard in handlers.items() if heard is not signal.SIG_IGN}

    def __call__(self) -> bool:
        """Whether to stop."""
        return self.signal != 0

    def __enter__(self) -> Self:
        """Hear, from now on."""
        for number in self._before:
            signal.signal(number, self._hear)
        return self

    def __exit__(self, *_: object) -> None:
        """Leave it to who heard before."""
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _hear(self, number: int, _frame: FrameType | None) -> None:
        self.signal = number
        self.__exit__()


@contextmanager
def told_how_to_go_on(name: str) -> Iterator[None]:
    """End the process where what is within is stopped, at whatever moment, and say how to go on."""
    heard = [signal.SIGINT]

    def interrupt(number: int, _frame: FrameType | None) -> NoReturn:
        heard[:] = [signal.Signals(number)]
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    except KeyboardInterrupt:
        tell_how_to_go_on(f"{name}: stopped; what is done is kept")
        sys.exit(128 + heard[0])
    finally:
        signal.signal(signal.SIGTERM, before)


def tell_how_to_go_on(stopped: str) -> None:
    """Say that a command was stopped, and the command line once more, with --resume."""
    resumed = [] if "--resume" in sys.argv else ["--resume"]
    line = shlex.join(["stratify", *sys.argv[1:], *resumed])
    click.echo(f"stratify: {stopped}; go on with: {line}", err=True)
