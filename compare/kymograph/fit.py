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

from experiment.arrays import Floats

__all__ = ["Curves", "fit"]

Bools = NDArray[np.bool_]

ROUNDS = 20
CUT = 4.685  # standard deviations at which a passage counts for nothing


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
    u = np.where(there, (x - middle[:, None]) / half[:, None], 0.0)
    basis = _powers(u, degree)
    start = np.where(enough, _median(passage, there), 0.0)
    t = np.where(there, passage - start[:, None], 0.0)
    coefficient, residual, kept = _robust(basis, t, there, enough, least)
    error, scatter, independent = _errors(basis, residual, kept, enough, least)
    coefficient[:, 0] += start
    coefficient[~enough], error[~enough] = np.nan, np.nan
    return Curves(coefficient, error, middle, half, scatter, independent)


def _robust(
    basis: Floats, t: Floats, there: Bools, enough: Bools, least: float
) -> tuple[Floats, Floats, Bools]:
    """Coefficients, residuals (line, x), and which passages are no outliers."""
    weight = there.astype(float)
    for k in range(ROUNDS):
        coefficient = _solve(basis, t, weight, enough)
        residual = np.where(there, t - np.einsum("lk,lxk->lx", coefficient, basis), 0.0)
        size = np.abs(residual)
        scale = np.maximum(1.4826 * _median(size, there), 0.1 * least)[:, None]
        if k < ROUNDS // 2:
            weight = there / np.maximum(size, 0.1 * scale)
        else:
            weight = there * np.maximum(1.0 - (residual / (CUT * scale)) ** 2, 0.0) ** 2
    kept: Bools = there & (size < CUT * scale)
    return coefficient, np.where(kept, residual, 0.0), kept


def _errors(
    basis: Floats, residual: Floats, kept: Bools, enough: Bools, least: float
) -> tuple[Floats, Floats, Floats]:
    """Standard errors of the coefficients, scatter, and how many passages are independent."""
    p = basis.shape[-1]
    n = np.maximum(kept.sum(axis=1), 1)
    tau = np.clip(_correlation_length(residual, kept), 1.0, np.maximum(1.0, n / (p + 1.0)))
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


def _solve(basis: Floats, t: Floats, weight: Floats, enough: Bools) -> Floats:
    """Coefficients (line, degree + 1) by weighted least squares, 0 where there is not enough."""
    weighted = np.swapaxes(basis, 1, 2) * weight[:, None]
    normal = weighted @ basis
    normal[~enough] = np.eye(basis.shape[-1])
    solved: Floats = np.linalg.solve(normal, weighted @ t[..., None])[..., 0]
    return solved


def _correlation_length(residual: Floats, there: Bools) -> Floats:
    """Columns tau (line,) that count as one, from residuals (line, x)."""
    n = residual.shape[1]
    size = 2 ** int(np.ceil(np.log2(2 * n)))

    def correlate(values: Floats) -> Floats:
        spectrum = np.fft.rfft(values, size, axis=1)
        return np.fft.irfft(np.abs(spectrum) ** 2, size, axis=1)[:, :n]

    total = correlate(residual)
    pairs = np.maximum(np.round(correlate(there.astype(float))), 1.0)
    variance = np.maximum(total[:, :1] / pairs[:, :1], np.finfo(float).tiny)
    rho = total / pairs / variance
    positive = np.logical_and.accumulate(rho > 0.0, axis=1)
    length: Floats = 1.0 + 2.0 * (rho * positive)[:, 1:].sum(axis=1)
    return length
