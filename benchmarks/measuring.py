"""What measuring costs beside pouring: a set-up of a phase diagram, by both models, part by part.

Milliseconds, the shortest of several rounds, in each of which a new archive is poured.
"""

from collections.abc import Callable
from functools import partial

import xarray as xr

import ca_model
import continuum
from benchmarks.clock import once
from compare import layers, measure
from compare.balances import volume_residual
from compare.deposit.profiles import settled
from compare.deposit.spectrum import correlate
from compare.kymograph import kinks_and_fronts
from compare.kymograph.flow import quieten
from compare.kymograph.slope import slope_of
from compare.quantities import rise_velocity
from experiment import load

PRESET, RECORDS = "makse-stratification", "pour.records=300"
SETTINGS = {
    continuum: (RECORDS, "continuum.cells=200"),
    ca_model: (RECORDS, "ca_model.column_width=0.5", "ca_model.unit=0.05"),
}
ROUNDS = 15


def flow(archive: xr.Dataset) -> object:
    slope = slope_of(archive)
    return quieten(slope.thickness.sum(axis=-1) / slope.inflow, 1.0)


PARTS: dict[str, Callable[[xr.Dataset], object]] = {
    "measure": measure,
    "  layers": layers,
    "    settled deposit": settled,
    "    and its correlation": lambda archive: correlate(settled(archive).coarse),
    "  kinks and fronts": kinks_and_fronts,
    "    flow made quiet": flow,
    "  numbers of the pour": lambda archive: (rise_velocity(archive), volume_residual(archive)),
}


def costs(pour: Callable[[], xr.Dataset]) -> dict[str, float]:
    best = dict.fromkeys(("pour", *PARTS), float("inf"))
    for _ in range(ROUNDS):
        best["pour"] = min(best["pour"], once(pour))
        archive = pour()
        for name, part in PARTS.items():
            best[name] = min(best[name], once(partial(part, archive.copy())))
    return best


def main() -> None:
    found = [costs(partial(model.pour, load(PRESET, told))) for model, told in SETTINGS.items()]
    print(f"{'ms':26s}" + "".join(f"{model.__name__:>12s}" for model in SETTINGS))
    for name in found[0]:
        print(f"{name:26s}" + "".join(f"{cost[name] * 1e3:12.1f}" for cost in found))
