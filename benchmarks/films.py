"""What films cost: how long one takes to make, and how much longer it is to watch.

A minute of film, 1500 frames of each preset by each model that pours it, all in one process and
ffmpeg in another; what was poured before does not count.
"""

import tempfile
from pathlib import Path

import ca_model
import continuum
from benchmarks.clock import once
from compare import animate
from experiment import load

PRESETS = ("glass-sugar", "makse-stratification", "heap", "ternary")
SECONDS = 60.0


def main() -> None:
    print(f"{'':22s}{'model':>12s}{'made in (s)':>14s}{'watched / made':>16s}{'MB':>8s}")
    for preset in PRESETS:
        for model in (ca_model, continuum):
            archive = model.pour(load(preset))
            with tempfile.TemporaryDirectory() as folder:
                film = Path(folder) / "pour.mp4"
                made = once(lambda a=archive, to=film: animate(a, to, seconds=SECONDS))
                size = film.stat().st_size / 1e6
            name = model.__name__
            print(f"{preset:22s}{name:>12s}{made:14.1f}{SECONDS / made:16.1f}{size:8.1f}")
