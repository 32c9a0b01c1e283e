"""What records cost: a pour to disk with those of its set-up, beside one that keeps the last only.

The share is that of the pour, and that of the command `stratify pour`, which starts up first. Steps
cost as the square of the number of cells, records as their number. A checkpoint is timed at the end
of the pour, when there is most to be written.
"""

import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import ca_model
import continuum
from benchmarks.archives import PRESETS
from benchmarks.clock import once, seconds
from experiment import Experiment, NotApplicableError, load
from experiment.pouring import Begin, Pouring, run_to_the_end
from experiment.pouring.streaming import pour_to_file
from experiment.pouring.work import Work, locked

FINER = (400, 800)
IMPORTS = "import compare.cli"


def checkpoint(begin: Begin, experiment: Experiment, path: Path) -> float:
    """Seconds that a checkpoint takes at the end of a pour."""
    with locked(path) as folder:
        work = Work(folder, every=1e9, stop=lambda: False)
        pouring: Pouring = begin(experiment, work)
        run_to_the_end(pouring, work)
        took = once(partial(work.checkpoint, pouring))
        work.clear()
    return took


def line(name: str, begin: Begin, experiment: Experiment, folder: Path, start: float) -> None:
    def poured(records: int) -> Callable[[], object]:
        pour = experiment.pour.model_copy(update={"records": records})
        setup = experiment.model_copy(update={"pour": pour})
        return partial(pour_to_file, begin, setup, folder / "run.nc", force=True)

    records = experiment.pour.records
    bare, recorded = seconds(poured(1), 5), seconds(poured(records), 5)
    share = (recorded - bare) / recorded
    of_command = (recorded - bare) / (start + recorded)
    took = checkpoint(begin, experiment, folder / "checkpoint.nc")
    size = (folder / "run.nc").stat().st_size
    print(
        f"{name:38s}{recorded * 1e3:7.0f}{(recorded - bare) / records * 1e6:10.0f}"
        f"{share:8.0%}{of_command:11.0%}{size / 1e6:8.1f}{took * 1e3:10.0f}"
    )


def main() -> None:
    start = seconds(partial(subprocess.run, [sys.executable, "-c", IMPORTS], check=True))
    print(
        f"start {start * 1e3:.0f} ms{'':24s}pour, ms  us/record  share  of command  MB  checkpoint"
    )
    setups = {preset: load(preset) for preset in PRESETS}
    for cells in FINER:
        settings = [f"continuum.cells={cells}"]
        setups[f"glass-sugar, {cells} cells"] = load("glass-sugar", settings)
    with tempfile.TemporaryDirectory() as folder:
        for name, experiment in setups.items():
            for model in (ca_model, continuum):
                try:
                    model.check(experiment)
                except NotApplicableError:
                    continue
                if model is continuum or "cells" not in name:
                    told = f"{name}, {model.__name__}"
                    line(told, model.begin, experiment, Path(folder), start)
