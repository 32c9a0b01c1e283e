"""What a user's or a system's wish to stop does to a command that can go on later."""

import signal
from types import FrameType
from typing import Self

__all__ = ["Stop"]

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
