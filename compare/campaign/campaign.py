"""Many set-ups, poured by both models: all that is measured, in one Dataset."""

from collections.abc import Sequence
from contextlib import closing

import xarray as xr

from compare.campaign.jobs import POUR, Pour
from compare.campaign.schedulers import scheduler_of
from compare.campaign.table import Table
from experiment import Experiment
from experiment.pouring import Progress

__all__ = ["campaign"]


def campaign(
    experiments: Sequence[Experiment],
    models: Sequence[str] = tuple(POUR),
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
) -> xr.Dataset:
    """What :func:`measure` finds in each of `experiments`, poured by each of `models`.

    A Dataset over `model` and `pour`, with the scales of each pour beside it: slope_length L [cm],
    total_inflow R0 [cm], drift_velocity v [cm/s] and collision_rate gamma [1/s]. Where a pour
    fails, `failure` says why, numbers are NaN and the regime is empty; the others go on.

    Pours are shared among as many processes as `workers`, by default one a processor; with one, all
    is done in this process. A script that calls this with more does so below
    `if __name__ == "__main__"`. Or they are shared among the workers of the Dask cluster whose
    `scheduler` has this address. `progress` is called with the share that is done. Raises
    :class:`StratifyError` where every pour fails.
    """
    jobs = [Pour(model, experiment) for model in models for experiment in experiments]
    found = Table(len(jobs))
    share_out = scheduler_of(workers, scheduler, len(jobs))
    with closing(share_out(jobs)) as outcomes:
        for number, outcome in outcomes:
            found.put(number, outcome)
            if progress is not None:
                progress(found.told / len(jobs))
    told = found.variables({"model": len(models), "pour": len(experiments)})
    names = {"model_name": ("model", list(models))}
    return xr.Dataset(told).assign_coords(names).set_xindex("model_name")
