"""Robust polynomials through scattered points, by least squares that are weighted anew each round.

    normal = sum w u^(j + k),    right = sum w t u^k,    normal c = right,    r = t - sum_k c_k u^k

The first half of the ROUNDS leads to the least absolute deviations, w = 1 / |r|; the others weigh
by Tukey's bisquare, w = (1 - (r / (CUT sigma))^2)^2 and 0 beyond, sigma from the median of |r|.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from experiment.arrays import Floats

__all__ = ["correlation_length", "robust"]

Bools = NDArray[np.bool_]

ROUNDS = 20
CUT = 4.685  # standard deviations at which a point counts for nothing


@njit(cache=True, nogil=True, error_model="numpy")
def robust(u: Floats, t: Floats, degree: int, least: float) -> tuple[Floats, Floats, Bools]:
    """Coefficients (line, degree + 1) of `t` over `u` (line, x), NaN where there is no point.

    And the residuals (line, x), and which points are no outliers; other residuals are 0. No sigma
    is taken to be below a tenth of `least`. All 0 of a line with less than degree + 2 points.
    """
    lines, columns = t.shape
    coefficient = np.zeros((lines, degree + 1))
    residual, kept = np.zeros((lines, columns)), np.zeros((lines, columns), np.bool_)
    for line in range(lines):
        there = np.flatnonzero(np.isfinite(t[line]))
        if len(there) > degree + 1:
            left, cut = _fit(u[line][there], t[line][there], coefficient[line], least)
            for k, i in enumerate(there):
                if abs(left[k]) < cut:
                    residual[line, i], kept[line, i] = left[k], True
    return coefficient, residual, kept


@njit(cache=True, nogil=True, error_model="numpy")
def _fit(u: Floats, t: Floats, coefficient: Floats, least: float) -> tuple[Floats, float]:
    """Find the coefficients of one line; its residuals, and beyond which a point is an outlier."""
    n = coefficient.size
    powers = np.ones((2 * n - 1, u.size))
    for k in range(2 * n - 2):
        powers[k + 1] = powers[k] * u
    basis, normal, weight = powers[:n], np.empty((n, n)), np.ones(u.size)
    residual, scale = t, 0.0
    for k in range(ROUNDS):
        moment, right = powers @ weight, basis @ (weight * t)
        for j in range(n):
            normal[j] = moment[j : j + n]
        _solve(normal, right, coefficient)
        residual = t - coefficient @ basis
        size = np.abs(residual)
        scale = max(1.4826 * upper_median(size.copy()), 0.1 * least)
        if k < ROUNDS // 2:
            weight = 1.0 / np.maximum(size, 0.1 * scale)
        else:
            weight = np.maximum(1.0 - (residual / (CUT * scale)) ** 2, 0.0) ** 2
    return residual, CUT * scale


@njit(cache=True, nogil=True, error_model="numpy")
def _solve(normal: Floats, right: Floats, solution: Floats) -> None:
    """Find the `solution` (k,) of `normal` (j, k) times it = `right` (j,); spoils both."""
    n = right.size
    for j in range(n):
        for i in range(j + 1, n):
            share = normal[i, j] / normal[j, j]
            for k in range(j, n):
                normal[i, k] -= share * normal[j, k]
            right[i] -= share * right[j]
    for j in range(n - 1, -1, -1):
        for k in range(j + 1, n):
            right[j] -= normal[j, k] * solution[k]
        solution[j] = right[j] / normal[j, j]


@njit(cache=True, nogil=True)
def upper_median(values: Floats) -> float:
    """The median of `values`, whose order is lost, the upper one of two; by Hoare's selection."""
    middle, first, last = values.size // 2, 0, values.size - 1
    while first < last:
        pivot, i, j = values[middle], first, last
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i, j = i + 1, j - 1
        if j < middle:
            first = i
        if middle < i:
            last = j
    return float(values[middle])


@njit(cache=True, nogil=True, error_model="numpy")
def correlation_length(residual: Floats, there: Bools, least: float) -> Floats:
    """1 + 2 sum_k rho_k (line,) of residuals (line, x) that are 0 where they are not `there`.

    rho_k is their autocorrelation at k columns, up to its first zero; there is none of residuals
    below the `least`.
    """
    lines, columns = residual.shape
    length = np.ones(lines)
    for line in range(lines):
        r, known = residual[line], there[line]
        variance = max(_mean_product(r, known, 0), least**2)
        for k in range(1, columns):
            rho = _mean_product(r, known, k) / variance
            if not rho > 0.0:
                break
            length[line] += 2.0 * rho
    return length


@njit(cache=True, nogil=True, error_model="numpy")
def _mean_product(values: Floats, there: Bools, apart: int) -> float:
    """The mean of v_i v_(i + apart), of those that are both `there`; 0 of none."""
    total, pairs = 0.0, 0
    for i in range(values.size - apart):
        total += values[i] * values[i + apart]
        pairs += there[i] & there[i + apart]
    return total / max(pairs, 1)
