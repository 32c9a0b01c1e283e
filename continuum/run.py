"""A pour by the surface-flow equations: set-up, schedule of records, archive."""

import math
from collections.abc import Callable
from itertools import chain
from typing import Annotated, Literal

import numpy as np
import xarray as xr
from pydantic import Field

from continuum.body import Body
from continuum.kernel import substeps_at
from continuum.limiters import LIMITERS
from continuum.section import heights_in_drum, heights_in_pile, section_of_drum, section_of_pile
from continuum.slopes import across, lent_to_the_flow, slopes_of
from continuum.state import SCHEMES, Grid
from continuum.transport import dispersion_substeps
from experiment import Experiment, NotApplicableError, SetupError
from experiment.arrays import Floats, Ints
from experiment.fields import Part
from experiment.law import Law, law_of
from experiment.pouring import Section, Sliced, pour_in_memory
from experiment.pouring.recorder import record_steps
from experiment.pouring.slabs import Slabs
from experiment.pouring.state import State, put_back

__all__ = ["FlowPouring", "Resolution", "begin", "check", "pour"]


MOST_SUBSTEPS = 100_000
MANY_SUBSTEPS = 20
MOST_BINS = 3e8
BLOCK = 65_536  # steps
CELLS_AT_ONCE = 2**23  # times steps


class Resolution(Part):
    """The `[continuum]` table of a set-up: how finely the equations are solved."""

    cells: Annotated[int, Field(strict=True, ge=3, le=1_000_000)] = 200  #: in a length L
    #: deposit bins in the surface depth d
    bins_per_depth: Annotated[int, Field(strict=True, ge=1, le=100)] = 2
    scheme: Literal["godunov", "muscl"] = "godunov"  #: of first, of second order
    #: of what moves slower than the fastest species, and of slopes where the scheme is muscl
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
    return pour_in_memory(begin, experiment, progress)


def begin(experiment: Experiment, slabs: Slabs, most_bins: int | None = None) -> "FlowPouring":
    """The pour before its first step; what lies deep goes to `slabs`.

    At most `most_bins` bins of a cell's deposit are kept, by default as many as the steepest pile
    is high. Raises :class:`SetupError` and :class:`NotApplicableError`, as :func:`pour`.
    """
    return FlowPouring(experiment, slabs, most_bins)


class FlowPouring:
    """A pour under way, as :class:`experiment.pouring.Pouring` tells."""

    model = "continuum"
    whole_grains = pure_bins = False

    def __init__(self, experiment: Experiment, slabs: Slabs, most_bins: int | None) -> None:
        resolution = Resolution.parse(experiment.continuum, "continuum")
        grid, law = resolution.grid(experiment), law_of(experiment.mixture)
        slopes = slopes_of(experiment, grid, resolution.cells, law)
        self.experiment, self.grid_of_cells, self.dt = experiment, grid, grid.dt
        self.columns = len(slopes) * resolution.cells
        self.block = max(1, min(BLOCK, CELLS_AT_ONCE // self.columns))
        self.velocity = np.array(experiment.mixture.drift_velocity)
        self.body = Body(slopes, slabs, most_bins or _bins_of_relief(experiment, grid))
        self.poured = self.body.volume
        self.substeps = np.zeros(1, dtype=np.int64)  # the most that a step needed

    def advance(self, edges: Floats) -> None:
        """Take the steps between the times `edges` (step + 1,) [s]."""
        inflow = self.experiment.feed.mean_thickness(edges)
        for slope in self.body.slopes:
            substeps = self.body.advance(slope, self.velocity, inflow)
            self.substeps[0] = max(self.substeps[0], substeps)
        sides = len(self.body.slopes)
        self.poured += sides * inflow.sum(axis=0) * self.velocity * self.dt

    def record(self) -> dict[str, Floats]:
        """What there is now."""
        slopes, dx = self.body.slopes, self.grid_of_cells.dx
        return {
            "height": across(slopes, lambda slope: slope.flow.height),
            "rolling_thickness": across(slopes, lambda slope: slope.flow.rolling).T,
            "surface_fraction": across(slopes, lambda slope: slope.composition).T,
            "poured_volume": self.poured,
            "rolling_volume": sum(slope.flow.rolling.sum(axis=1) for slope in slopes) * dx,
            "deposited_volume": self.body.volume,
            "outflow_volume": sum(slope.flow.outflow for slope in slopes) * dx,
        }

    def bury(self) -> None:
        """Nothing: whatever was laid down may be dug up again."""

    def floor(self) -> Ints:
        """The lowest bin (column,) of what is still in memory."""
        return self.body.floor

    def state(self) -> State:
        """All that the steps to come depend on."""
        return {"poured": self.poured, "substeps": self.substeps} | self.body.state()

    def restore(self, state: State) -> None:
        """Go on from a state. Raises LookupError or ValueError where it is not of this set-up."""
        self.body.restore(state)
        put_back({"poured": self.poured, "substeps": self.substeps}, state)

    def grid(self) -> dict[str, Floats]:
        """x, z and the surface before pouring [cm]."""
        slopes = self.body.slopes
        return {
            "x": across(slopes, lambda slope: slope.x),
            "z": heights_in_drum(slopes[0]) if self._is_drum else heights_in_pile(slopes),
            "base_height": across(slopes, lambda slope: slope.base),
        }

    def section(self, slabs: Slabs) -> Section:
        """The deposit_fraction, by rows."""
        if self._is_drum:
            whole = section_of_drum(self.body.slopes[0], self.experiment.cell.length / 2)
            return lambda low, high: whole[low:high]
        rest, species = self.body.rest(), self.experiment.mixture.species

        def rows(low: int, high: int) -> Floats:
            shape = high - low, self.columns, species
            return section_of_pile(chain(slabs.reaching(low, high), rest), shape, low)

        return rows

    @property
    def _is_drum(self) -> bool:
        return self.experiment.cell.shape == "drum"

    def notes(self, height: Sliced) -> dict[str, object]:  # noqa: ARG002
        """Attributes of the archive."""
        return _notes(self.grid_of_cells, int(self.substeps[0]))


def _bins_of_relief(experiment: Experiment, grid: Grid) -> int:
    """Bins in the height of the steepest pile: what a change of the feed may dig up of it."""
    steepest = float(np.max(experiment.mixture.repose_slope))
    return math.ceil(steepest * experiment.cell.length / grid.dz)


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
