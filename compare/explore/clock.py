"""The clock of a pour that is played: how much of it is over."""

from dataclasses import dataclass

__all__ = ["Clock"]


@dataclass
class Clock:
    """Runs from 0, before the first grain, to 1, after the last, and stops there."""

    share: float = 0.0
    playing: bool = False
    lasts: float = 30.0  # s, on the wall

    def play(self) -> None:
        """Go on; at the end, begin again."""
        if self.share >= 1.0:
            self.share = 0.0
        self.playing = True

    def pause(self) -> None:
        """Stand still."""
        self.playing = False

    def toggle(self) -> None:
        """Pause what plays, play what stands still."""
        if self.playing:
            self.pause()
        else:
            self.play()

    def restart(self) -> None:
        """Play from the first grain."""
        self.turn(0.0)
        self.play()

    def turn(self, share: float) -> None:
        """Set it to a `share`; what plays, plays on from there."""
        self.share = min(max(share, 0.0), 1.0)

    def tick(self, seconds: float) -> bool:
        """So many seconds have passed on the wall: whether that moved it."""
        if not self.playing:
            return False
        self.turn(self.share + seconds / self.lasts)
        self.playing = self.share < 1.0
        return True
