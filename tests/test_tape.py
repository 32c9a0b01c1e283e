"""Tapes of sealed bins: rings of places, of which nothing is lost as they grow or hand on."""

import numpy as np
import pytest
from flows import law_with, still

from continuum.state import Flow
from continuum.tape import (
    lowest_bins,
    put_lowest_bins,
    sealed_bins,
    with_more_bins,
    with_sealed_bins,
)

TOP, SEALED = [13, 6, 9], [5, 6, 0]  # on tapes of 8 places: the first one's bins run past the end


def filled() -> tuple[Flow, np.ndarray]:
    """Tapes of three cells, and what their bins hold, cell after cell, from below."""
    flow, rng = still(law_with(), cells=3, bins=8), np.random.default_rng(1)
    flow.top[:], flow.sealed[:] = TOP, SEALED
    content = []
    for i, (top, sealed) in enumerate(zip(TOP, SEALED, strict=True)):
        for place in range(top - sealed, top):
            content.append(rng.random(2))
            flow.tape[:, i, place % 8] = content[-1]
    return flow, np.array(content)


def test_a_longer_tape_holds_the_same_bins() -> None:
    flow, content = filled()
    longer = with_more_bins(flow)
    assert longer.tape.shape == (2, 3, 16)
    assert longer.tape.sum() == pytest.approx(flow.tape.sum())
    for tapes in (flow, longer):
        np.testing.assert_array_equal(sealed_bins(tapes), content)


def test_the_lowest_bins_of_any_cells_are_read_and_replaced() -> None:
    flow, content = filled()
    cells, counts = np.array([1, 0]), np.array([2, 4])
    lowest = lowest_bins(flow, cells, counts)
    np.testing.assert_array_equal(lowest, content[[5, 6, 0, 1, 2, 3]])
    put_lowest_bins(flow, cells, counts, 2.0 * lowest)
    content[[5, 6, 0, 1, 2, 3]] *= 2.0
    np.testing.assert_array_equal(sealed_bins(flow), content)


def test_bins_of_another_number_are_refused() -> None:
    flow, content = filled()
    for wrong in (content[1:], np.repeat(content, 2, axis=0), content[:, :1]):
        with pytest.raises(ValueError, match="its sealed bins are"):
            with_sealed_bins(flow, 16, wrong)
