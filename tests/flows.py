"""States for the tests of the continuum's kernel: bare slopes, what they hold, steps taken."""

import numpy as np

from continuum.kernel import advance
from continuum.state import Flow, Grid, bare_flow
from continuum.tape import with_more_bins
from experiment.law import Law

MATRICES = ("repose_slope", "collision_rate", "cross_amplification")


def law_with(species: int = 2, **changes: object) -> Law:
    base = Law(
        repose_slope=np.array([[1.0, 1.55, 1.6], [0.7, 1.25, 1.4], [0.5, 0.9, 1.3]]),
        collision_rate=np.array([[1.0, 0.2, 0.3], [0.1, 2.0, 0.4], [0.5, 0.6, 3.0]]),
        cross_amplification=np.zeros((3, 3)),
        smoothing=0.0,
        surface_depth=0.1,
        curvature_length=0.1,
    )
    cut = {name: np.array(getattr(base, name))[:species, :species] for name in MATRICES} | changes
    matrices = {name: tuple(map(tuple, np.array(cut[name]).tolist())) for name in MATRICES}
    return base._replace(**changes)._replace(**matrices)


def still(law: Law, cells: int, bins: int = 200, base: np.ndarray | None = None) -> Flow:
    """Nothing rolls and nothing was poured on a rigid surface of the first species."""
    return bare_flow(
        np.zeros(cells) if base is None else base, np.eye(len(law.repose_slope))[0], bins
    )


def volume(flow: Flow) -> np.ndarray:
    """Rolling, at rest, and fallen off, of each species, in units of dx."""
    held = (flow.rolling + flow.surface + flow.filling).sum(axis=1)
    return held + flow.tape.sum(axis=(1, 2)) + flow.outflow


def take(flow: Flow, law: Law, grid: Grid, velocity: np.ndarray, inflow: np.ndarray) -> Flow:
    """Take all steps of `inflow`, with more bins where the pile needs them."""
    while len(inflow):
        inflow = inflow[advance(flow, law, grid, velocity, inflow).steps :]
        if len(inflow):
            flow = with_more_bins(flow)
    return flow
