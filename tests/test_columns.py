"""Walks along columns of a deposit: each is what scipy, or a count, says of single columns."""

import numpy as np
import pytest
import scipy
import xarray as xr

from compare import layers, layers_of
from compare.deposit import settled_coarseness
from compare.deposit.counting import _quantiles, count_pairs
from compare.deposit.kernel import average_along, highest_near, smooth, squares_of_first
from compare.deposit.spectrum import correlate
from compare.quantities import measured_columns
from compare.validation.drawn import archive_of, calm, stripes


def ragged(seed: int = 0, gaps: bool = True) -> np.ndarray:
    """Columns (z, x) of several heights, the first without any cell, some with gaps."""
    random = np.random.default_rng(seed)
    values = random.uniform(size=(60, 12))
    values[np.arange(60)[:, None] >= np.linspace(0, 60, 12)] = np.nan
    if gaps:
        values[20:26, 7:9] = np.nan
    return values


def known(column: np.ndarray) -> np.ndarray:
    return column[np.isfinite(column)]


@pytest.mark.parametrize("width", [1, 2, 5, 40])
def test_running_means_are_those_of_each_column_with_its_gaps_closed(width: int) -> None:
    values = ragged()
    for column, told in zip(values.T, smooth(values, width).T, strict=True):
        np.testing.assert_array_equal(np.isfinite(column), np.isfinite(told))
        if known(column).size:
            expected = scipy.ndimage.uniform_filter1d(known(column), width)
            np.testing.assert_allclose(known(told), expected, rtol=1e-12)


def test_averages_follow_the_layers_and_leave_out_what_is_outside() -> None:
    values, place = ragged(), np.random.default_rng(1).normal(0.0, 3.0, 12)
    told = average_along(values, place, 5)
    for k, i in np.argwhere(np.isfinite(values)):
        beside = np.arange(max(0, i - 2), min(12, i + 3))
        row = k + np.round(place[beside] - place[i]).astype(int)
        there = (row >= 0) & (row < 60)
        assert told[k, i] == pytest.approx(known(values[row[there], beside[there]]).mean())
    np.testing.assert_array_equal(np.isfinite(told), np.isfinite(values))


def test_terms_of_a_correlation_are_counted_in_columns_with_gaps_and_without() -> None:
    values = ragged()
    inside = np.isfinite(values)
    for lag in (0, 1, 7, 30, 59):
        pairs = (inside[: 60 - lag] & inside[lag:]).sum(axis=0)
        np.testing.assert_array_equal(correlate(values).terms[lag], pairs)


def test_the_highest_peak_near_a_lag_is_found_though_it_be_flat() -> None:
    random = np.random.default_rng(3)
    a = np.round(random.normal(size=(80, 40)), 1)  # in steps, so that many peaks are flat
    place, height = highest_near(a, np.ones_like(a), 0.3, 40.0, 12.0)
    for column, at, top in zip(a.T, place, height, strict=True):
        peaks = scipy.signal.find_peaks(column)[0]
        near = peaks[(np.abs(peaks - 40) < 12) & (column[peaks] > 0)]
        assert top == pytest.approx(column[near].max())
        assert abs(at - near[column[near].argmax()]) <= 0.5


def test_quantiles_are_those_of_each_column() -> None:
    values = ragged()
    low, high = _quantiles(values, (0.05, 0.95))
    for column, *told in zip(values.T[1:], low[1:], high[1:], strict=True):
        np.testing.assert_array_equal(told, np.quantile(known(column), (0.05, 0.95)))
    assert np.isnan([low[0], high[0]]).all()


def test_pairs_are_whole_and_their_sublayers_add_up() -> None:
    """Triangles of period 12 from 1: the first fall is at 3, the last rise has no fall after it."""
    z = np.arange(46)
    wave = np.abs((z % 12) / 6 - 1.0)
    pairs = count_pairs(np.stack([wave, np.full(46, 0.5)], axis=1))
    np.testing.assert_allclose(pairs.pair[:, 0], [12.0, 12.0, 12.0])
    np.testing.assert_allclose(pairs.small + pairs.large, pairs.pair)
    assert np.isnan(pairs.pair[:, 1]).all()


def test_squares_are_about_the_median_of_the_first_of_the_values() -> None:
    values = np.random.default_rng(4).normal(size=20)
    for k, told in enumerate(squares_of_first(values), start=1):
        first = values[:k]
        assert told == pytest.approx(np.abs(first - np.median(first)).sum() ** 2 / k)


@pytest.mark.parametrize("shape", ["silo", "heap"])
def test_layers_of_a_pour_are_those_of_its_settled_coarseness_in_place(shape: str) -> None:
    archive = archive_of(calm, stripes(1.0), shape=shape)
    right = archive["x"].values > 0
    coarse = settled_coarseness(archive).isel(x=right)
    grain = float(archive["grain_diameter"].mean())
    in_place = layers_of(coarse, measured_columns(archive)[right], grain)
    for name, told in layers(archive).data_vars.items():
        xr.testing.assert_allclose(told, in_place[name], rtol=1e-9)
