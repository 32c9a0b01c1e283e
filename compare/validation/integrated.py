"""The steady pile of any mixture, by another program for the equations than the solver.

    v_a dR_a/dx = Gamma_a = - phi_a W        W = sum_a v_a R_a^0 / L, the rise of the pile

At each x the rolling thicknesses tell, through the law of the paper, which surface and slope go
with them; scipy finds both, and integrates downhill from the feed. So the law stands here a second
time, by matrices, and no step of the kernel has a part in it: what is wrong in either shows.
"""

import numpy as np
import xarray as xr
from scipy.integrate import solve_ivp
from scipy.optimize import root

from compare.quantities import cell_width, values_of
from compare.validation.check import POWER, SCHEME, Check, Checks, Poured
from compare.validation.steady import orders_of
from experiment import Experiment
from experiment.archive import experiment_of
from experiment.arrays import Floats

__all__ = ["MIXTURES", "any_mixture", "errors_of", "exchange", "integrated"]

SOURCE = "Makse 1997, eqs. (mcs-r) and (bdg-phi), integrated by scipy"
CELLS = (75, 150, 300)
CLOSE = 1e-10  # of the integration
FIELDS = ("R / R0", "phi_1", "theta")
BOUND = 5e-4
SMOOTH = (
    "mixture.smoothing=0.05",
    "mixture.curvature_length=0.0",
    "mixture.surface_depth=0.2",
    "cell.start_slope=0.5",
    "pour.duration=400.0",
    "pour.records=2",
)
MIXTURES = {  # preset: settings; all that a closed form needs alike is unlike
    "canonical": (
        "mixture.repose_slope=[[0.6, 0.67], [0.5, 0.55]]",
        "mixture.drift_velocity=[8.0, 10.0]",
        "mixture.collision_rate=[[20.0, 6.0], [14.0, 25.0]]",
        "mixture.cross_amplification=[[0.0, 0.3], [0.5, 0.0]]",
        "feed.inflow=[0.1, 0.15]",
    ),
    "ternary": (
        "mixture.repose_slope=[[0.6, 0.66, 0.7], [0.52, 0.57, 0.63], [0.45, 0.5, 0.54]]",
        "mixture.drift_velocity=[8.0, 9.0, 10.0]",
        "mixture.collision_rate=[[20.0, 6.0, 3.0], [14.0, 25.0, 8.0], [5.0, 11.0, 18.0]]",
        "feed.inflow=[0.1, 0.08, 0.12]",
    ),
}


def any_mixture(poured: Poured) -> Checks:
    """Unlike speeds, rates and m, a smooth P, cross-amplification at a constant rate.

    There is no closed form. The steady pile is integrated from the paper's equations by another
    program, and the solver comes to it.
    """
    for preset, settings in MIXTURES.items():
        chosen = [(*SMOOTH, *settings, f"continuum.cells={n}") for n in CELLS]
        errors = np.array([errors_of(poured("continuum", preset, *one)) for one in chosen])
        for field, of_field in zip(FIELDS, errors.T, strict=True):
            what = f"{preset}, changed: mean |error| of {field}"
            yield Check(
                f"{what}, 300 cells", SOURCE, 0.0, float(of_field[-1]), BOUND, "O(dx), 300 cells"
            )
            yield Check(
                f"{what}, order from 150 to 300 cells",
                SCHEME,
                1.0,
                float(orders_of(of_field.tolist())[-1]),
                0.15,
                POWER,
            )


def errors_of(archive: xr.Dataset) -> tuple[float, float, float]:
    """Mean errors of R / R0, phi_1 and theta, away from the last tenth of the cell."""
    experiment = experiment_of(archive)
    last, dx, length = archive.isel(time=-1), cell_width(archive), experiment.cell.length
    x = values_of(last, "x")
    edges = x + dx / 2
    inside = edges < 0.9 * length
    r0 = sum(experiment.feed.inflow)
    rolling, _, slope = integrated(experiment, edges[inside])
    _, phi, _ = integrated(experiment, x[inside])
    theta = -np.diff(values_of(last, "height")) / dx
    return (
        float(np.abs(values_of(last, "rolling_thickness")[inside] - rolling).mean()) / r0,
        float(np.abs(values_of(last, "surface_fraction")[inside] - phi)[:, 0].mean()),
        float(np.abs(theta[inside[:-1]] - slope).mean()),
    )


def integrated(experiment: Experiment, x: Floats) -> tuple[Floats, Floats, Floats]:
    """R_a (x, species) [cm], phi_a (x, species) and theta (x,) of the steady pile in a silo."""
    mixture = experiment.mixture
    velocity, fed = np.array(mixture.drift_velocity), np.array(experiment.feed.inflow)
    rise = float(velocity @ fed) / experiment.cell.length
    guess = np.append(fed[:-1] / fed.sum(), mixture.repose_slope[0][0])

    def surface(rolling: Floats) -> Floats:
        """The phi_a of all species but the last, and theta, with Gamma_a = - phi_a W."""

        def unbalanced(unknown: Floats) -> Floats:
            phi = np.append(unknown[:-1], 1.0 - unknown[:-1].sum())
            return np.asarray(exchange(experiment, rolling, phi, unknown[-1]) / rise + phi)

        nonlocal guess
        found = root(unbalanced, guess, tol=CLOSE)
        if not found.success:
            raise RuntimeError(found.message)
        guess = found.x
        return np.asarray(found.x)

    def downhill(_: float, rolling: Floats) -> Floats:
        phi = surface(rolling)[:-1]
        return np.asarray(-rise * np.append(phi, 1.0 - phi.sum()) / velocity)

    span = (0.0, float(x[-1]))
    rolling = solve_ivp(downhill, span, fed, t_eval=x, rtol=1e-8, atol=CLOSE).y.T
    found = np.array([surface(here) for here in rolling])
    phi = np.column_stack([found[:, :-1], 1.0 - found[:, :-1].sum(axis=1)])
    return rolling, phi, found[:, -1]


def exchange(experiment: Experiment, rolling: Floats, phi: Floats, slope: float) -> Floats:
    """Gamma_a (species,) [cm/s]."""
    mixture = experiment.mixture
    rate = np.array(mixture.collision_rate)
    above = slope - np.array(mixture.repose_slope) @ phi
    bend = np.hypot(above, mixture.smoothing)
    constant = 0.0 if mixture.cross_amplification is None else np.array(mixture.cross_amplification)
    captured = np.diag(rate) * (bend - above) / 2 * rolling
    pushed = rolling @ (constant + rate * ((bend + above) / 2)[:, None])
    return np.asarray(phi * pushed - captured)
