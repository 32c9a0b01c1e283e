"""A pour by the surface-flow equations: set-up, schedule of records, archive."""

from collections.abc import Callable
from typing import Annotated, Literal

import numpy as np
import xarray as xr
from pydantic import Field

from continuum.kernel import substeps_at
from continuum.law import Law, law_of
from continuum.limiters import LIMITERS
from continuum.section import section_of_drum, section_of_pile
from continuum.slopes import Slope, across, lent_to_the_flow, slopes_of
from continuum.state import SCHEMES, Grid
from continuum.transport import dispersion_substeps
from experiment import Experiment, NotApplicableError, SetupError
from experiment.archive import assemble
from experiment.arrays import Floats
from experiment.fields import Part
from experiment.recorder import Recorder, edges_of_steps, record_steps

__all__ = ["Resolution", "check", "pour"]


MOST_SUBSTEPS = 100_000
MANY_SUBSTEPS = 20
MOST_BINS = 3e8


class Resolution(Part):
    """The `[continuum]` table of a set-up: how finely the equations are solved."""

    cells: Annotated[int, Field(strict=True, ge=3, le=1_000_000)] = 200
    bins_per_depth: Annotated[int, Field(strict=True, ge=1, le=100)] = 2  # deposit bins in d
    scheme: Literal["godunov", "muscl"] = "godunov"  # of first, of second order
    limiter: Literal["minmod", "van_leer", "monotonized_central", "superbee"] = "van_leer"

    def grid(self, experiment: Experiment) -> Grid:
        """The grid for a set-up: dt is the time in which the fastest species crosses a cell."""
        dx = experiment.cell.length / self.cells
        return Grid(
            dx=dx,
            dt=dx / max(experiment.mixture.drift_velocity),
            dz=experiment.mixture.surface_depth / self.bins_per_depth,
            limiter=LIMITERS.index(self.limiter),
            scheme=SCHEMES.index(self.scheme),
        )


def check(experiment: Experiment) -> None:
    """Raise what :func:`pour` would raise, without pouring."""
    resolution = Resolution.parse(experiment.continuum, "continuum")
    grid = resolution.grid(experiment)
    law = law_of(experiment.mixture)
    if experiment.feed.source is not None:
        raise NotApplicableError("feed.source: the continuum's feed falls at x = 0")
    record_steps(experiment.pour, grid.dt)
    if experiment.cell.shape == "drum" and resolution.cells % 2:
        raise SetupError(
            f"continuum.cells = {resolution.cells}: it should be even in a drum, the axis an edge"
        )
    _check_deposit(experiment, law, grid, resolution.cells)
    needed = {
        "mixture.collision_rate": substeps_at(_busiest_rate(experiment, law), law, grid),
        "mixture.dispersion": dispersion_substeps(law.dispersion, grid),
    }
    for name, substeps in needed.items():
        if substeps > MOST_SUBSTEPS:
            value = getattr(experiment.mixture, name.partition(".")[2])
            raise SetupError(
                f"{name} = {value}: each step of {grid.dt:.2g} s needs {substeps:.2g} sub-steps "
                f"at the most; at most {MOST_SUBSTEPS} are allowed"
            )


def _check_deposit(experiment: Experiment, law: Law, grid: Grid, cells: int) -> None:
    """Refuse a deposit of more bins than a machine holds, or a drum that would roll as a whole."""
    cell, mixture = experiment.cell, experiment.mixture
    if cell.shape == "drum":
        lent = lent_to_the_flow(experiment, law)
        if lent > cell.length / 2:
            raise SetupError(
                f"cell.turning_rate = {cell.turning_rate:g}: with these drift velocities and rates "
                f"{lent:.2g} cm of grains would roll; it should be less than the radius"
            )
        thickness = np.pi * cell.length / 2
    else:
        thickness = cell.base_height(np.array([0.0]))[0] + experiment.mean_growth
    bins = thickness / grid.dz * cells * mixture.species
    if bins > MOST_BINS:
        raise SetupError(
            f"mixture.surface_depth = {mixture.surface_depth:g}: bins of {grid.dz:.2g} cm make "
            f"{bins:.2g} of them in the deposit; it should make at most {MOST_BINS:.0e}"
        )


def _busiest_rate(experiment: Experiment, law: Law) -> float:
    """Gamma R [cm/s] where the flow is thickest: at the pouring point, or a drum's axis."""
    fastest = np.max(law.collision_rate, axis=1)
    if experiment.cell.turning_rate is None:
        return float(fastest @ experiment.feed.largest_inflow)
    lifted = experiment.cell.turning_rate * (experiment.cell.length / 2) ** 2 / 2
    return float(fastest.max() * lifted / min(experiment.mixture.drift_velocity))


def pour(experiment: Experiment, progress: Callable[[float], object] | None = None) -> xr.Dataset:
    """Pour `experiment` by the equations of surface flow; the archive as a Dataset, in cm and s.

    `progress` is called with the share that is done. Raises :class:`SetupError` for a wrong
    `[continuum]` table and :class:`NotApplicableError` where the mixture has no collision rates,
    or the source moves.
    """
    check(experiment)
    law = law_of(experiment.mixture)
    resolution = Resolution.parse(experiment.continuum, "continuum")
    grid = resolution.grid(experiment)
    velocity = np.array(experiment.mixture.drift_velocity)
    slopes = slopes_of(experiment, grid, resolution.cells, law)
    steps = record_steps(experiment.pour, grid.dt)
    recorder = Recorder(len(steps), len(slopes) * resolution.cells, experiment.mixture.species)
    poured = np.sum([slope.volume_at_rest for slope in slopes], axis=0)
    most = 0
    done = 0
    for record, step in enumerate(steps):
        for edges in edges_of_steps(done, step, grid.dt):
            inflow = experiment.feed.mean_thickness(edges)
            most = max([most, *(slope.advance(velocity, inflow) for slope in slopes)])
            poured = poured + len(slopes) * inflow.sum(axis=0) * velocity * grid.dt
        done = step
        _record(recorder, record, step * grid.dt, slopes, poured)
        if progress is not None:
            progress((record + 1) / len(steps))
    arrays = recorder.arrays | _section(experiment, slopes)
    return assemble(experiment, "continuum", arrays, _notes(grid, most))


def _record(
    recorder: Recorder, record: int, time: float, slopes: list[Slope], poured: Floats
) -> None:
    dx = slopes[0].grid.dx
    recorder.keep(
        record,
        time=time,
        height=across(slopes, lambda slope: slope.flow.height),
        rolling_thickness=across(slopes, lambda slope: slope.flow.rolling).T,
        surface_fraction=across(slopes, lambda slope: slope.composition).T,
        poured_volume=poured,
        rolling_volume=sum(slope.flow.rolling.sum(axis=1) for slope in slopes) * dx,
        deposited_volume=sum(slope.volume_at_rest for slope in slopes),
        outflow_volume=sum(slope.flow.outflow for slope in slopes) * dx,
    )


def _section(experiment: Experiment, slopes: list[Slope]) -> dict[str, Floats]:
    if experiment.cell.shape == "drum":
        z, fraction = section_of_drum(slopes[0], experiment.cell.length / 2)
    else:
        z, fraction = section_of_pile(slopes)
    return {
        "x": across(slopes, lambda slope: slope.x),
        "z": z,
        "base_height": across(slopes, lambda slope: slope.base),
        "deposit_fraction": fraction,
    }


def _notes(grid: Grid, most: int) -> dict[str, object]:
    notes: dict[str, object] = {
        "cell_width_cm": grid.dx,
        "time_step_s": grid.dt,
        "largest_substep_count": most,
    }
    if most > MANY_SUBSTEPS:
        notes["comment"] = (
            f"a step of {grid.dt:.3g} s took up to {most} sub-steps: disturbances of the slope "
            "climb so much faster than grains roll, or the cells are shorter than curvature_length"
        )
    return notes
