"""All that is checked, by group and subject."""

from collections.abc import Callable, Sequence
from functools import cache
from typing import NamedTuple

import xarray as xr

import ca_model
import continuum
from compare.validation import (
    instrument,
    integrated,
    lattice,
    layers,
    published,
    rates,
    steady,
    translation,
    waves,
)
from compare.validation.check import Check, Poured, Subject
from experiment import SetupError, load

__all__ = ["GROUPS", "SUBJECTS", "Finding", "chosen", "pour_once", "validate"]

GROUPS = {
    "continuum": "The continuum's solver against closed forms, theory and itself",
    "lattice": "The lattice",
    "instrument": "The instrument, on drawn kymographs and deposits",
    "published": "What was observed",
}
SUBJECTS: dict[str, Subject] = {  # by group.subject
    "continuum.profile": steady.profile,
    "continuum.any-mixture": integrated.any_mixture,
    "continuum.one-species": steady.one_species,
    "continuum.minimal-model": steady.minimal_model,
    "continuum.bcre": waves.bcre,
    "continuum.patch": waves.patch,
    "continuum.spectrum": waves.spectrum,
    "continuum.oscillations": waves.oscillations,
    "continuum.stratification": layers.stratification,
    "continuum.segregation": layers.segregation,
    "continuum.volumes": layers.volumes,
    "continuum.refinement": layers.refinement,
    "continuum.prototype": layers.prototype,
    "lattice.translation": translation.translation,
    "lattice.kernels": lattice.kernels,
    "lattice.patterns": lattice.patterns,
    "lattice.checkpoints": lattice.checkpoints,
    "lattice.rates": rates.rates,
    "instrument.kymographs": instrument.kymographs,
    "instrument.deposits": instrument.deposits,
    "published.experiments": published.experiments,
    "published.numerical-runs": published.numerical_runs,
}
POUR = {"ca_model": ca_model.pour, "continuum": continuum.pour}


class Finding(NamedTuple):
    """A check and the subject it belongs to."""

    subject: str
    check: Check

    @property
    def group(self) -> str:
        """The first part of the subject's name."""
        return self.subject.partition(".")[0]


def chosen(names: Sequence[str] = ()) -> list[str]:
    """The subjects of these groups or subjects, in their order; all where none is named.

    Raises :class:`SetupError` for a name that is neither.
    """
    allowed = {*GROUPS, *SUBJECTS}
    for name in names:
        if name not in allowed:
            raise SetupError(f"only = {name}: it should be one of {', '.join(sorted(allowed))}")
    return [
        subject
        for subject in SUBJECTS
        if not names or subject in names or subject.partition(".")[0] in names
    ]


def validate(
    names: Sequence[str] = (),
    progress: Callable[[float], object] | None = None,
    poured: Poured | None = None,
) -> list[Finding]:
    """Every check of the subjects or groups in `names`, by real pours; a minute or two for all.

    `poured` makes the archive of (model, preset, *settings), by default each once; `progress` is
    called with the share of the subjects that is done. Raises :class:`SetupError` as
    :func:`chosen`.
    """
    poured = poured or pour_once()
    subjects, found = chosen(names), []
    for k, subject in enumerate(subjects, start=1):
        found += [Finding(subject, check) for check in SUBJECTS[subject](poured)]
        if progress is not None:
            progress(k / len(subjects))
    return found


def pour_once() -> Poured:
    """What makes the archive of (model, preset, *settings), and keeps it for the next to ask."""

    @cache
    def poured(model: str, preset: str, *settings: str) -> xr.Dataset:
        return POUR[model](load(preset, settings))

    return poured
