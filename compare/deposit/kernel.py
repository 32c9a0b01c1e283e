"""Walks along the columns of a deposit (z, x), from below; NaN is what lies outside of it."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from experiment.arrays import Floats

__all__ = [
    "average_along",
    "boundaries",
    "extent",
    "fallen",
    "highest_near",
    "smooth",
    "squares_of_first",
    "summit",
]

Rows = NDArray[np.intp]


@njit(cache=True, nogil=True)
def extent(values: Floats, lowest: Rows) -> tuple[Rows, Rows]:
    """The row where each column begins, and the one past its end; 0 and 0 of an empty one.

    Of a column what lies below the row `lowest` (x,) does not count.
    """
    rows, columns = values.shape
    begin, end = np.zeros(columns, np.intp), np.zeros(columns, np.intp)
    for k in range(lowest.min(), rows):
        for i in range(columns):
            if k >= lowest[i] and np.isfinite(values[k, i]):
                if end[i] == 0:
                    begin[i] = k
                end[i] = k + 1
    return begin, end


@njit(cache=True, nogil=True)
def fallen(fraction: Floats, diameter: Floats, floor: Rows, top: Rows) -> Floats:
    """sum_a diameter_a fraction_a (z, x) of columns let down from the row `floor`, up to `top`.

    From `fraction` (z, x, species), `diameter` (species,), `floor` and `top` (x,); NaN above.
    """
    rows, columns = max(1, (top - floor).max()), floor.size
    mean = np.full((rows, columns), np.nan)
    for k in range(rows):
        for i in range(columns):
            if floor[i] + k < top[i]:
                mean[k, i] = 0.0
                for a in range(diameter.size):
                    mean[k, i] += diameter[a] * fraction[floor[i] + k, i, a]
    return mean


@njit(cache=True, nogil=True, error_model="numpy")
def average_along(values: Floats, place: Floats, width: int) -> Floats:
    """Averages (z, x) over `width` columns, of which each is shifted to its own `place` (x,)."""
    rows, columns = values.shape
    filled, inside = np.zeros((columns, rows)), np.zeros((columns, rows))
    for k in range(rows):
        for i in range(columns):
            if np.isfinite(values[k, i]):
                filled[i, k], inside[i, k] = values[k, i], 1.0
    averages = np.full((rows, columns), np.nan)
    total, number = np.empty(rows), np.empty(rows)
    for i in range(columns):
        total[:] = 0.0
        number[:] = 0.0
        for beside in range(max(0, i - width // 2), min(columns, i + width // 2 + 1)):
            shift = int(np.rint(place[beside] - place[i]))
            for k in range(max(0, -shift), min(rows, rows - shift)):
                total[k] += filled[beside, k + shift]
                number[k] += inside[beside, k + shift]
        for k in range(rows):
            if inside[i, k] > 0.0:
                averages[k, i] = total[k] / number[k]
    return averages


@njit(cache=True, nogil=True)
def close_gaps(column: Floats, closed: Floats) -> int:
    """Put what lies in a `column` (z,) one upon the other, and tell how many cells that is."""
    n = 0
    for value in column:
        if np.isfinite(value):
            closed[n] = value
            n += 1
    return n


@njit(cache=True, nogil=True, error_model="numpy")
def smooth(values: Floats, width: int) -> Floats:
    """Running means (z, x) over `width` cells of each column, gaps closed, mirrored at its ends."""
    rows, columns = values.shape
    smoothed = np.full((rows, columns), np.nan)
    column, mirrored = np.empty(rows), np.empty(rows + width)
    for i in range(columns):
        n = close_gaps(values[:, i], column)
        if n == 0:
            continue
        for k in range(n + width):
            image = (k - width // 2) % (2 * n)
            mirrored[k] = column[min(image, 2 * n - 1 - image)]
        total, first = 0.0, 0
        for k in range(width):
            total += mirrored[k]
        for k in range(rows):
            if np.isfinite(values[k, i]):
                smoothed[k, i] = total / width
                total += mirrored[first + width] - mirrored[first]
                first += 1
    return smoothed


@njit(cache=True, nogil=True, error_model="numpy")
def boundaries(profiles: Floats, lower: Floats, upper: Floats) -> Floats:
    """Where columns, gaps closed, fall, rise, fall ... between two levels (x,), from below.

    Places (boundary, x) in cells, half-way between where a column passes the two levels; NaN past
    the last one of a column.
    """
    rows, columns = profiles.shape
    places, number = np.full((rows, columns), np.nan), np.zeros(columns, np.intp)
    column = np.empty(rows)
    for i in range(columns):
        falls, last = True, -1  # whether the next one falls; the last cell before it
        for k in range(close_gaps(profiles[:, i], column)):
            leaves, reaches = (upper[i], lower[i]) if falls else (lower[i], upper[i])
            if (column[k] > leaves) if falls else (column[k] < leaves):
                last = k
            elif last >= 0 and ((column[k] < reaches) if falls else (column[k] > reaches)):
                left = last + (leaves - column[last]) / (column[last + 1] - column[last])
                right = k - (column[k] - reaches) / (column[k] - column[k - 1])
                places[number[i], i] = 0.5 * (left + right)
                number[i] += 1
                falls, last = not falls, k
    return places[: number.max()]


@njit(cache=True, nogil=True, error_model="numpy")
def highest_near(
    sums: Floats, terms: Floats, fewest: float, lag: float, reach: float
) -> tuple[Floats, Floats]:
    """Place and height (x,) of the highest peak of sums / terms (lag, x) within `reach` of `lag`.

    At lags that leave more than the share `fewest` of the terms; NaN and 0 where there is none
    above 0.
    """
    rows, columns = sums.shape
    place, height = np.full(columns, np.nan), np.zeros(columns)
    a = np.empty(rows)
    for i in range(columns):
        n = 0
        while n < rows and terms[n, i] > 0.0 and not terms[n, i] / terms[0, i] < fewest:
            a[n] = sums[n, i] / terms[n, i]
            n += 1
        k = 1
        while k < n - 1:
            end = k  # of a peak that may be flat
            while end < n - 1 and a[end + 1] == a[k]:
                end += 1
            peak = (k + end) // 2
            is_peak = a[k - 1] < a[k] and end < n - 1 and a[end + 1] < a[k]
            if is_peak and abs(peak - lag) < reach and a[peak] > height[i]:
                place[i], height[i] = summit(a, peak), a[peak]
            k = end + 1
    return place, height


@njit(cache=True, nogil=True)
def summit(values: Floats, k: int) -> float:
    """Place of the maximum of the parabola through three neighbouring values."""
    left, middle, right = values[k - 1], values[k], values[k + 1]
    bend = left - 2 * middle + right
    return k + 0.5 * (left - right) / bend if bend < 0 else float(k)


@njit(cache=True, nogil=True)
def squares_of_first(values: Floats) -> Floats:
    """(sum |value - median|)^2 / k of the first k of `values`, for each k from 1 on."""
    n = len(values)
    squares, ordered = np.empty(n), np.empty(n)
    for k in range(n):
        place = k
        while place > 0 and ordered[place - 1] > values[k]:
            ordered[place] = ordered[place - 1]
            place -= 1
        ordered[place] = values[k]
        median = 0.5 * (ordered[k // 2] + ordered[(k + 1) // 2])
        total = 0.0
        for value in ordered[: k + 1]:
            total += abs(value - median)
        squares[k] = total**2 / (k + 1)
    return squares
