"""What was seen in experiments, and in the paper's own numerical runs, beside what the models do.

Only numbers and statements that were read in the source that is named. None of the experiments
tells all that a pour needs (glass-sugar's cross rates, d and l are not measured), so a model that
is outside is not wrong for that.
"""

import numpy as np
import xarray as xr

from compare.kymograph import kinks
from compare.measurement import measure
from compare.quantities import coarseness, settled_since, total_inflow, values_of
from compare.scaling import fit
from compare.validation.check import Check, Checks, Poured
from compare.validation.steady import mixing_length
from continuum.theory import wavelength_of_kink

__all__ = ["experiments", "numerical_runs", "top_of_a_pair"]

PICTURES = "Makse group, Pictures of Stratification (Nature 386, 379)"
PRE_58 = "Makse et al., PRE 58, 3357, abstract"
PAPER = "Makse 1997"
MODELS = ("ca_model", "continuum")
FEEDS = {  # R0, cm; on the lattice a cycle lays two unlike pairs of layers where it is stronger
    "ca_model": (0.1, 0.2, 0.3, 0.4),
    "continuum": (0.1, 0.2, 0.4, 0.8),
}
POURED = 45.0  # R0 times the duration, cm s
NOT_TOLD = "as read; its error is not told"
AS_SAID = "as said"


def experiments(poured: Poured) -> Checks:
    """Glass beads and sugar, and three species, poured with what was measured of them.

    Kinks were seen to climb as fast as grains roll. In the models they climb by exchange, at some
    part of gamma R0, and fronts are slower than grains.
    """
    for model in MODELS:
        archive = poured(model, "glass-sugar")
        found = measure(archive)
        yield Check(
            f"{model}, glass-sugar: wavelength, R0 = 0.25 cm",
            f"{PICTURES}; at a flux not stated",
            1.2,
            float(found["wavelength"]),
            0.05,
            NOT_TOLD,
            "cm",
            observed=True,
        )
        yield Check(
            f"{model}, glass-sugar: v_k / v",
            f"{PRE_58}: kinks climb at the speed of the grains; v = 10 cm/s",
            1.0,
            float(found["kink_velocity_scaled"]),
            0.1,
            NOT_TOLD,
            observed=True,
        )
        yield Check(
            f"{model}, glass-sugar: wavelength over R0 (v + v_k) / v_k",
            "volume of a kink where fronts keep pace with grains (v_f = v)",
            1.0,
            float(found["wavelength"]) / volume_of_kink(archive, found),
            0.1,
            "v_f differs from v",
            observed=True,
        )
        yield linearity(poured, model)
        yield Check(
            f"{model}, glass-sugar: share of large grains on the surface that a kink leaves",
            f"Nature 386, 379, abstract; {PAPER}, sec. IV: large grains on top of each pair",
            1.0,
            top_of_a_pair(archive),
            0.15,
            "mostly large",
            observed=True,
        )
    yield Check(
        "continuum, makse-profile: length over which the species mix",
        f"{PAPER}, sec. III: observed from 1.5 to 5 cm",
        3.25,
        mixing_length(poured("continuum", "makse-profile").isel(time=-1)),
        1.75,
        "the range observed",
        "cm",
        observed=True,
    )
    yield Check(
        "continuum, ternary: order in a triplet, from below",
        f"{PICTURES}: three species",
        "small, medium, large",
        triplet(poured("continuum", "ternary")),
        why=AS_SAID,
        observed=True,
    )


def volume_of_kink(archive: xr.Dataset, found: xr.Dataset) -> float:
    """R0 (v + v_k) / v_k [cm]."""
    scaled = float(found["kink_velocity_scaled"])
    return wavelength_of_kink(total_inflow(archive), 1.0, scaled)


def linearity(poured: Poured, model: str) -> Check:
    """The largest relative departure of the wavelength from a straight line over R0."""
    drawn = ("ca_model.arrivals=drawn",) if model == "ca_model" else ()
    feeds = FEEDS[model]
    settings = [
        (f"feed.inflow=[{r0 / 2}, {r0 / 2}]", f"pour.duration={POURED / r0}", *drawn)
        for r0 in feeds
    ]
    found = [measure(poured(model, "glass-sugar", *chosen)) for chosen in settings]
    wavelengths, errors = (
        np.array([float(one[name]) for one in found]) for name in ("wavelength", "wavelength_error")
    )
    line = fit(np.array(feeds), wavelengths, errors)
    left = np.abs(np.polynomial.polynomial.polyval(feeds, line.values) / wavelengths - 1)
    return Check(
        f"{model}, glass-sugar: wavelength off a line in R0, {feeds[0]} to {feeds[-1]} cm",
        f"{PRE_58}: wavelength linear in the flow",
        0.0,
        float(left.max()),
        3 * float((errors / wavelengths).max()),
        "three standard errors, of the least certain",
        observed=True,
    )


def top_of_a_pair(archive: xr.Dataset) -> float:
    """Median share of large grains on the surface a tenth of a period after a kink has passed."""
    surface = coarseness(archive["surface_fraction"], archive)
    lines = kinks(archive)
    after = lines["passage"] + 0.1 * float(lines["passage"].diff("event").median())
    seen = surface.interp(time=after.where(after < archive["time"][-1]), x=lines["x"])
    return float(seen.median())


def triplet(archive: xr.Dataset) -> str:
    """The species in their order from below, by the phase of each one's share half-way down."""
    wavelength = float(measure(archive)["wavelength"])
    column = archive["deposit_fraction"].isel(x=archive.sizes["x"] // 2)
    since = archive["height"].sel(x=column["x"]).interp(time=settled_since(archive))
    column = column.where(column["z"] > since).dropna("z")
    wave = np.exp(2j * np.pi * column["z"] / wavelength)
    phases = np.angle((column * wave).sum("z")) / (2 * np.pi)
    order = np.argsort((phases - phases[0]) % 1)
    return ", ".join(np.array(["small", "medium", "large"])[order])


def numerical_runs(poured: Poured) -> Checks:
    """What the paper says of its own numerical runs, in words; it gives neither L, nor d, nor l.

    With its thin surface layer (d = 0.1 cm) `makse-segregation` keeps weak layers where the species
    meet, over a third of the slope; with d = 0.5 cm they are gone (continuum.segregation).
    """
    for delta, preset, expected in (
        (0.25, "makse-stratification", "stratified"),
        (-0.1, "makse-segregation", "segregated"),
    ):
        for model in MODELS:
            yield Check(
                f"{model}, {preset}: regime",
                f"{PAPER}, sec. V: delta = {delta}",
                expected,
                str(measure(poured(model, preset))["regime"].item()),
                why=AS_SAID,
                observed=True,
            )
    archive = poured("continuum", "makse-stratification", "cell.start_slope=0.7")
    yield Check(
        "continuum, makse-stratification: share of large grains in the first sublayer",
        f"{PAPER}, sec. IV: the first kink is of large grains only",
        1.0,
        first_sublayer(archive),
        1e-3,
        AS_SAID,
        observed=True,
    )


def first_sublayer(archive: xr.Dataset) -> float:
    """Share of large grains in the lowest 0.8 cm of the lower half of the slope."""
    coarse = coarseness(archive["deposit_fraction"], archive)
    above = coarse["z"] - archive["base_height"]
    x = values_of(archive, "x")
    lower_half = (x > 50) & (x < 90)
    first = coarse.where((above > 0) & (above < 0.8)).isel(x=lower_half)
    return float(first.mean())
