"""Curves t(x) through the passages of a line, by robust regression, with honest errors.

A polynomial in u = (x - middle) / half is fitted with Tukey's bisquare weights, from a start by
least absolute deviations. Neighbouring columns share grains and records, so their residuals r_i
are alike: with

    tau = 1 + 2 sum_k rho_k        rho_k: autocorrelation of r at k columns, up to its first zero

only n / tau of the n passages count as independent.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from compare.kymograph.regression import correlation_length, robust
from experiment.arrays import Floats

__all__ = ["Curves", "fit"]

Bools = NDArray[np.bool_]

ROUNDING = 1e-9  # of what is known at best: residuals that are rounding alone


class Curves(NamedTuple):
    """Polynomials t = sum_k c_k u^k of several lines, and what they leave."""

    coefficient: Floats  # (line, degree + 1) [s]
    error: Floats  # their standard errors
    middle: Floats  # (line,) [cm]
    half: Floats  # (line,) [cm]
    scatter: Floats  # (line,) [s] of the passages about the curve
    independent: Floats  # (line,) passages that count

    def at(self, x: Floats) -> Floats:
        """Times (line, x) [s] on the curves."""
        u = (x - self.middle[:, None]) / self.half[:, None]
        t: Floats = np.einsum("lk,lxk->lx", self.coefficient, _powers(u, self.degree))
        return t

    @property
    def degree(self) -> int:
        """Of the polynomials."""
        return int(self.coefficient.shape[1] - 1)


def fit(x: Floats, passage: Floats, degree: int, least: float) -> Curves:
    """Polynomials through `passage` (line, x) [s], NaN where there is none, all lines at once.

    No time is taken to be known better than `least` [s] for each independent one. NaN where a line
    has too few passages.
    """
    there = np.isfinite(passage)
    enough: Bools = there.sum(axis=1) > degree + 1
    low, high = x[there.argmax(axis=1)], x[::-1][there[:, ::-1].argmax(axis=1)]
    middle = (low + high) / 2
    half = np.where(enough, (high - low) / 2, 1.0)
    u = (x - middle[:, None]) / half[:, None]
    start = np.where(enough, _median(passage, there), 0.0)
    t = passage - start[:, None]
    coefficient, residual, kept = robust(u, t, degree, least)
    basis = _powers(np.where(there, u, 0.0), degree)
    error, scatter, independent = _errors(basis, residual, kept, enough, least)
    coefficient[:, 0] += start
    coefficient[~enough], error[~enough] = np.nan, np.nan
    return Curves(coefficient, error, middle, half, scatter, independent)


def _errors(
    basis: Floats, residual: Floats, kept: Bools, enough: Bools, least: float
) -> tuple[Floats, Floats, Floats]:
    """Standard errors of the coefficients, scatter, and how many passages are independent."""
    p = basis.shape[-1]
    n = np.maximum(kept.sum(axis=1), 1)
    alike = correlation_length(residual, kept, ROUNDING * least)
    tau = np.clip(alike, 1.0, np.maximum(1.0, n / (p + 1.0)))
    independent = n / tau
    variance = (residual**2).sum(axis=1) / n * independent / np.maximum(independent - p, 1.0)
    normal = np.einsum("lxi,lxj->lij", basis * kept[..., None], basis)
    normal[~enough] = np.eye(p)
    spread = np.einsum("lkk->lk", np.linalg.inv(normal)) * tau[:, None]
    return np.sqrt((variance + least**2)[:, None] * spread), np.sqrt(variance), independent


def _median(values: Floats, there: Bools) -> Floats:
    """Median (line,) of those `values` (line, x) that are `there`, the upper one of two."""
    ordered = np.sort(np.where(there, values, np.inf), axis=1)
    middle: Floats = ordered[np.arange(len(values)), there.sum(axis=1) // 2]
    return middle


def _powers(u: Floats, degree: int) -> Floats:
    return np.stack([u**k for k in range(degree + 1)], axis=-1)
