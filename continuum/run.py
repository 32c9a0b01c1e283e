"""A pour by the surface-flow equations: set-up, schedule of records, archive."""

import math
from collections.abc import Callable
from typing import Annotated

import numpy as np
import xarray as xr
from pydantic import Field

from continuum.kernel import Flow, Grid, advance, find_composition, substeps_at
from continuum.law import Law, law_of
from experiment import Experiment, SetupError
from experiment.archive import assemble
from experiment.arrays import Floats
from experiment.fields import Part
from experiment.recorder import Recorder, record_steps, times_of_steps

__all__ = ["Resolution", "check", "pour"]


FIRST_BINS = 64
MOST_SUBSTEPS = 100_000


class Resolution(Part):
    """The `[continuum]` table of a set-up: how finely the equations are solved."""

    cells: Annotated[int, Field(strict=True, ge=3, le=1_000_000)] = 200
    bins_per_depth: Annotated[int, Field(strict=True, ge=1, le=100)] = 2  # deposit bins in d

    def grid(self, experiment: Experiment) -> Grid:
        """The grid for a set-up: dt is the time in which the fastest species crosses a cell."""
        dx = experiment.cell.length / self.cells
        return Grid(
            dx=dx,
            dt=dx / max(experiment.mixture.drift_velocity),
            dz=experiment.mixture.surface_depth / self.bins_per_depth,
        )


def check(experiment: Experiment) -> None:
    """Raise what :func:`pour` would raise, without pouring."""
    grid = Resolution.parse(experiment.continuum, "continuum").grid(experiment)
    law = law_of(experiment.mixture)
    record_steps(experiment.pour, grid.dt)
    fastest = law.collision_rate.max(axis=1) @ experiment.feed.mean_inflow
    substeps = substeps_at(float(fastest), law, grid)
    if substeps > MOST_SUBSTEPS:
        raise SetupError(
            f"mixture.collision_rate = {law.collision_rate.tolist()}: with this feed each step of "
            f"{grid.dt:.2g} s needs {substeps:.2g} sub-steps; at most {MOST_SUBSTEPS} are allowed"
        )


def pour(experiment: Experiment, progress: Callable[[float], object] | None = None) -> xr.Dataset:
    """Pour `experiment` by the equations of surface flow; the archive as a Dataset, in cm and s.

    `progress` is called with the share that is done. Raises :class:`SetupError` for a wrong
    `[continuum]` table and :class:`NotApplicableError` where the mixture has no collision rates.
    """
    check(experiment)
    law = law_of(experiment.mixture)
    resolution = Resolution.parse(experiment.continuum, "continuum")
    grid = resolution.grid(experiment)
    x = (np.arange(resolution.cells) + 0.5) * grid.dx
    velocity = np.array(experiment.mixture.drift_velocity)
    base = experiment.cell.base_height(x)
    flow = _still(experiment, base, grid)
    steps = record_steps(experiment.pour, grid.dt)
    recorder = Recorder(len(steps), len(x), experiment.mixture.species)
    poured = np.zeros(experiment.mixture.species)
    most = 0
    done = 0
    for record, step in enumerate(steps):
        for times in times_of_steps(done, step, grid.dt):
            inflow = experiment.feed.thickness(times)
            flow, substeps = _advance_all(flow, law, grid, velocity, inflow)
            most = max(most, substeps)
            poured += inflow.sum(axis=0) * velocity * grid.dt
        done = step
        _record(recorder, record, step * grid.dt, flow, law, grid, poured)
        if progress is not None:
            progress((record + 1) / len(steps))
    z, deposit_fraction = _deposit_fraction(flow, base, grid)
    arrays = recorder.arrays | {
        "x": x,
        "z": z,
        "base_height": base,
        "deposit_fraction": deposit_fraction,
    }
    notes = {"cell_width_cm": grid.dx, "time_step_s": grid.dt, "largest_substep_count": most}
    return assemble(experiment, "continuum", arrays, notes)


def _still(experiment: Experiment, base: Floats, grid: Grid) -> Flow:
    """The surface before pouring: nothing rolls, nothing is deposited."""
    shape = (experiment.mixture.species, len(base))
    return Flow(
        height=base.copy(),
        rolling=np.zeros(shape),
        surface=np.zeros(shape),
        filling=np.zeros(shape),
        deposit=np.zeros((*shape, FIRST_BINS)),
        top=np.zeros(len(base), dtype=np.int64),
        rigid=base - grid.dz * np.floor(base / grid.dz),
        rigid_fraction=np.array(experiment.start_composition),
    )


def _advance_all(
    flow: Flow, law: Law, grid: Grid, velocity: Floats, inflow: Floats
) -> tuple[Flow, int]:
    """Take all steps of `inflow`, adding bins to the deposit as the pile outgrows them."""
    most = 0
    while True:
        steps, substeps = advance(flow, law, grid, velocity, inflow)
        most = max(most, substeps)
        inflow = inflow[steps:]
        if not len(inflow):
            return flow, most
        flow = flow._replace(
            deposit=np.concatenate([flow.deposit, np.zeros_like(flow.deposit)], axis=2)
        )


def _record(
    recorder: Recorder, record: int, time: float, flow: Flow, law: Law, grid: Grid, poured: Floats
) -> None:
    phi = np.empty_like(flow.surface)
    find_composition(phi, flow.surface, flow.rigid_fraction, law.surface_depth)
    at_rest = (flow.surface + flow.filling + flow.deposit.sum(axis=2)).sum(axis=1)
    recorder.keep(
        record,
        time=time,
        height=flow.height,
        rolling_thickness=flow.rolling.T,
        surface_fraction=phi.T,
        poured_volume=poured,
        rolling_volume=flow.rolling.sum(axis=1) * grid.dx,
        deposited_volume=at_rest * grid.dx,
        outflow_volume=np.zeros_like(poured),
    )


def _deposit_fraction(flow: Flow, base: Floats, grid: Grid) -> tuple[Floats, Floats]:
    """Composition of what was poured, (z, x, species), on bins of height dz above the floor."""
    species, cells, _ = flow.deposit.shape
    first = np.floor(base / grid.dz).astype(np.int64)
    layer_bins = math.ceil(float(flow.surface.sum(axis=0).max()) / grid.dz) + 1
    volume = np.zeros((species, cells, int((first + flow.top).max()) + 1 + layer_bins))
    for i in range(cells):
        used = int(flow.top[i]) + 1
        column = np.zeros((species, used + layer_bins))
        column[:, : used - 1] = flow.deposit[:, i, : used - 1]
        column[:, used - 1] = flow.filling[:, i]
        _lay_on_top(column, flow.surface[:, i], used - 1, flow.rigid[i], grid.dz)
        volume[:, i, first[i] : first[i] + used + layer_bins] = column
    total = volume.sum(axis=0)
    fraction = np.full_like(volume, np.nan)
    np.divide(volume, total, out=fraction, where=total > 0)
    z = (np.arange(volume.shape[2]) + 0.5) * grid.dz
    return z, fraction.transpose(2, 1, 0)


def _lay_on_top(column: Floats, layer: Floats, top: int, rigid: float, dz: float) -> None:
    """Put the surface layer (species,) onto a column (species, bin), from bin `top` up."""
    left = layer.sum()
    mixture = layer / left if left > 0 else layer
    while left > 0 and top < column.shape[1]:
        room = dz - column[:, top].sum() - (rigid if top == 0 else 0.0)
        part = min(max(room, 0.0), left)
        column[:, top] += part * mixture
        left -= part
        top += 1
