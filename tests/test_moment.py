"""A pour at an instant: between its records, with its kinks on the pile."""

from collections.abc import Callable

import numpy as np
import pytest
import xarray as xr

import continuum
from compare.pictures.moment import Course
from experiment import NotApplicableError, load


@pytest.fixture(scope="module")
def archive() -> xr.Dataset:
    setup = load("makse-stratification")
    return continuum.pour(setup.with_values({"pour.duration": 900.0, "pour.records": 300}))


@pytest.fixture(scope="module")
def course(archive: xr.Dataset) -> Course:
    return Course(archive)


def test_at_a_record_it_is_the_record(archive: xr.Dataset, course: Course) -> None:
    moment = course.at(float(archive["time"][120]))
    np.testing.assert_array_equal(moment.height, archive["height"][120])
    np.testing.assert_array_equal(moment.rolling, archive["rolling_thickness"][120])


def test_between_records_it_is_between_them(archive: xr.Dataset, course: Course) -> None:
    moment = course.at(float(archive["time"][120:122].mean()))
    np.testing.assert_allclose(moment.height, archive["height"][120:122].mean("time"), rtol=1e-14)


def test_outside_the_records_it_is_the_first_or_the_last(
    archive: xr.Dataset, course: Course
) -> None:
    np.testing.assert_array_equal(course.at(-1.0).height, archive["height"][0])
    np.testing.assert_array_equal(course.at(1e9).height, archive["height"][-1])


def test_a_kink_is_where_it_passes_and_on_the_surface_of_the_pile(
    archive: xr.Dataset, course: Course
) -> None:
    """Within a cell, of the columns that it was seen to pass."""
    kink = archive.strata.kinks().isel(event=0)
    seen = kink["passage"].dropna("x")
    for passage in seen[::30]:
        moment = course.at(float(passage))
        [[x, z]] = moment.kinks
        assert x == pytest.approx(float(passage["x"]), abs=0.25)
        assert z == pytest.approx(np.interp(x, course.x, moment.height))


def test_a_kink_only_climbs_and_a_front_only_runs_down(poured: Callable[..., xr.Dataset]) -> None:
    """Though the records scatter: on the lattice columns seem to be passed out of their order."""
    archive = poured("ca_model", "makse-stratification")
    kinks, fronts = (
        lines.isel(event=2) for lines in (archive.strata.kinks(), archive.strata.fronts())
    )
    assert (kinks["passage"].dropna("x").diff("x") > 0).any()
    course = Course(archive)
    for line, name, way in ((kinks, "kinks", -1), (fronts, "fronts", 1)):
        times = np.linspace(float(line["birth_time"]), float(line["end_time"]), 1000)
        way_on = way * np.diff([getattr(course.at(time), name)[0, 0] for time in times])
        assert (way_on >= 0).all()
        assert way_on.sum() > 50.0


def test_a_kink_is_seen_from_its_birth_to_its_end(archive: xr.Dataset, course: Course) -> None:
    kink = archive.strata.kinks().isel(event=0)
    assert len(course.at(float(kink["birth_time"]) - 1.0).kinks) == 0
    assert len(course.at(float(kink["birth_time"]) + 1.0).kinks) == 1
    assert len(course.at(float(kink["end_time"]) + 1.0).kinks) == 0


def test_a_drum_has_no_course() -> None:
    setup = load("drum-mixture").with_values({"pour.duration": 1.0, "pour.records": 3})
    with pytest.raises(NotApplicableError, match=r"cell.shape = 'drum'"):
        Course(continuum.pour(setup))
