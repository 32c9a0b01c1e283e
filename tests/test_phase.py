"""Phase diagrams: what varies, what is kept of each point, and where layers begin."""

import math

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from compare import measure, phase
from compare.campaign import POUR
from compare.deposit.picture import picture_of
from compare.phase.axes import axes_of, varied
from compare.phase.boundary import boundary
from compare.phase.figure import COLOURS, draw_phase
from compare.phase.patterns import patterns
from compare.phase.plan import plan_of
from compare.phase.theory import pure_slopes
from continuum.theory.spectrum import critical_delta
from experiment import Experiment, SetupError, load

QUICK = [
    "cell.length=20.0",
    "pour.duration=100.0",
    "pour.records=100",
    "continuum.cells=40",
    "ca_model.unit=0.05",
    "ca_model.column_width=0.5",
]
COLOURS_IN_ORDER = list(COLOURS)
DELTAS, PSIS = [-0.2, 0.1, 0.3], [0.1, 0.3, 1.5]  # the last psi makes no set-up


@pytest.fixture(scope="module")
def setup() -> Experiment:
    return load("makse-segregation", QUICK)


@pytest.fixture(scope="module")
def diagram(setup: Experiment) -> xr.Dataset:
    vary = {"mixture.delta": DELTAS, "mixture.psi": PSIS}
    return phase(setup, vary, deposits=4, lines=2, workers=1)


# what varies


@pytest.mark.parametrize(
    ("text", "key", "values"),
    [
        ("mixture.delta=-0.3:0.5:5", "mixture.delta", [-0.3, -0.1, 0.1, 0.3, 0.5]),
        ("mixture.delta=-0.3:0.3:7", "mixture.delta", [-0.3, -0.2, -0.1, 0.0, 0.1, 0.2, 0.3]),
        ("feed.total_inflow=0.1:10:3:log", "feed.total_inflow", [0.1, 1.0, 10.0]),
        ("ca_model.contacts=1,2,all", "ca_model.contacts", [1, 2, "all"]),
        ("continuum.scheme=godunov,muscl", "continuum.scheme", ["godunov", "muscl"]),
        ("feed.inflow=[0.1, 0.2],[0.2, 0.1]", "feed.inflow", [[0.1, 0.2], [0.2, 0.1]]),
        ("mixture.psi=0.3", "mixture.psi", [0.3]),
    ],
)
def test_a_field_varies_on_a_grid_or_a_list(text: str, key: str, values: list) -> None:
    listed, drawn = varied([text])
    assert listed == {key: values}
    assert not drawn


@pytest.mark.parametrize(
    ("texts", "complaint"),
    [
        (["mixture.delta"], "--vary 'mixture.delta': it should be KEY=LOW:HIGH:COUNT"),
        (["=1:2:3"], "it should be KEY="),
        (["mixture..delta=1"], "it should be KEY="),
        (["mixture.delta=a:b:c"], "it should be KEY="),
        (["mixture.delta=0:1:2:3"], "LOW should be less than HIGH"),
        (["mixture.delta=1:0:8"], "LOW should be less than HIGH"),
        (["mixture.delta=0:1:1"], "COUNT from 2"),
        (["mixture.delta=0:inf:8"], "LOW should be less than HIGH"),
        (["feed.total_inflow=0:1:8:log"], "LOW should be greater than 0"),
        (["mixture.psi=1,2", "mixture.psi=0:1:8"], "mixture.psi varies already"),
    ],
)
def test_what_does_not_say_how_a_field_varies_is_refused(texts: list[str], complaint: str) -> None:
    with pytest.raises(SetupError, match=r"^--vary") as refused:
        varied(texts)
    assert complaint in str(refused.value)
    assert "\n" not in str(refused.value)


def test_ranges_and_draws_go_together() -> None:
    ranged = {"mixture.psi": (0.1, 0.3)}
    with pytest.raises(SetupError, match=r"draws = 0: .* to draw mixture\.psi"):
        axes_of({}, ranged)
    with pytest.raises(SetupError, match="draws = 5: there is no KEY=LOW:HIGH"):
        axes_of({"mixture.psi": [0.1]}, draws=5)
    with pytest.raises(SetupError, match="vary: missing"):
        axes_of({})


@settings(max_examples=10, deadline=None)
@given(st.integers(1, 50), st.integers(0, 100))
def test_of_n_draws_one_lies_in_each_nth_of_every_range(draws: int, seed: int) -> None:
    ranges = {"mixture.psi": (0.1, 0.3), "mixture.delta": (-1.0, 1.0)}
    (axis,) = axes_of({}, ranges, draws, seed)
    assert axis.size == draws
    for key, (low, high) in ranges.items():
        parts = np.floor((np.array(axis.fields[key]) - low) / (high - low) * draws)
        assert sorted(parts) == list(range(draws))


def test_dimensions_are_named_after_the_end_of_their_fields() -> None:
    listed = {"mixture.delta": [1], "mixture.grain_diameter.1": [1], "a.cells": [1], "b.cells": [2]}
    listed["published.wavelength"] = [1.0]
    names = [axis.dim for axis in axes_of(listed)]
    assert names == [
        "delta", "grain_diameter_1", "a_cells", "b_cells", "published_wavelength"
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("key", "values", "complaint"),
    [
        ("mixture.detla", [0.1], "no field 'detla'"),
        ("mixture.psi", [5.0, 6.0], r"mixture\.psi = 5: it makes a repose slope of -4"),
        ("mixture.names.7", ["x"], "there is no '7' to set"),
        ("continuum.cell", [40], "continuum: no field 'cell'"),
    ],
)
def test_a_field_that_cannot_vary_so_is_refused_before_anything_is_poured(
    setup: Experiment, key: str, values: list, complaint: str
) -> None:
    with pytest.raises(SetupError, match=complaint):
        plan_of(setup, axes_of({key: values}), list(POUR))


def test_a_model_that_nobody_knows_is_refused(setup: Experiment) -> None:
    with pytest.raises(SetupError, match=r"models = \['dem'\]: allowed: ca_model, continuum"):
        phase(setup, {"mixture.psi": [0.1]}, ["dem"])


def test_a_field_cannot_be_listed_and_drawn_and_nothing_is_kept_less_than_no_times(setup) -> None:
    with pytest.raises(SetupError, match=r"mixture\.psi: it varies twice"):
        phase(setup, {"mixture.psi": [0.1]}, draw={"mixture.psi": (0.1, 0.2)}, draws=2)
    with pytest.raises(SetupError, match="lines = -2: it should be at least 0"):
        phase(setup, {"mixture.psi": [0.1]}, lines=-2)


def test_fields_that_do_not_go_together_are_refused_before_anything_is_poured(setup) -> None:
    vary = {"mixture.delta": [0.1, 0.2], "mixture.theta_22": [1.1]}
    with pytest.raises(SetupError, match="theta_22"):
        plan_of(setup, axes_of(vary), list(POUR))


@pytest.mark.parametrize("values", [np.array([0.1, 0.2]), [np.float64(0.1), 0.2], (0.1, 0.2)])
def test_numbers_may_come_from_numpy(values) -> None:
    (axis,) = axes_of({"mixture.delta": values})
    assert axis.fields == {"mixture.delta": [0.1, 0.2]}
    (piles,) = axes_of({"pour.pile": np.arange(2)})
    assert piles.fields == {"pour.pile": [0, 1]}


# what is kept of each point


def test_each_point_has_what_its_pour_alone_gives(setup: Experiment, diagram: xr.Dataset) -> None:
    assert diagram["regime"].dims == ("delta", "psi", "model")
    for model, pour in POUR.items():
        alone = measure(pour(setup.with_values({"mixture.delta": 0.3, "mixture.psi": 0.1})))
        point = diagram.sel(delta=0.3, psi=0.1, model_name=model)
        for name in alone.data_vars:
            np.testing.assert_array_equal(point[name], alone[name])
            assert diagram[name].attrs == alone[name].attrs


def test_a_point_that_fails_says_why_and_stops_no_other(diagram: xr.Dataset) -> None:
    failure = diagram["failure"]
    assert (failure.sel(psi=PSIS[:2]) == "").all()
    for reason in failure.sel(psi=1.5).values.ravel():
        assert "mixture.psi = 1.5: it makes a repose slope of -0.5" in reason
    assert (diagram["regime"].sel(psi=1.5) == "").all()
    assert diagram["layering"].sel(psi=1.5).isnull().all()
    assert diagram["layering"].sel(psi=PSIS[:2]).notnull().all()


def test_deposits_are_kept_at_points_that_are_spread_over_the_diagram(
    setup: Experiment, diagram: xr.Dataset
) -> None:
    points = diagram["picture_point"].values.tolist()
    assert len(set(points)) == 2  # of four, two make no set-up
    assert diagram["picture_model"].values.tolist() == [0, 1] * 2
    assert all(point % len(PSIS) < 2 for point in points)
    picture = diagram["deposit"].values
    inside = np.isfinite(picture)
    assert inside[:, 0].all()
    assert (picture[inside] >= 0).all()
    assert (picture[inside] <= 1).all()
    none = phase(setup, {"mixture.delta": [0.1]}, ["ca_model"], deposits=0, workers=1)
    assert "deposit" not in none


def test_a_diagram_over_one_field_words_and_draws_has_all_of_their_dimensions(setup) -> None:
    found = phase(
        setup,
        {"ca_model.contacts": [1, "all"]},
        ["ca_model"],
        draw={"mixture.psi": (0.1, 0.3), "mixture.delta": (0.1, 0.2)},
        draws=3,
        workers=1,
    )
    assert dict(found["regime"].sizes) == {"contacts": 2, "draw": 3, "model": 1}
    assert found["psi"].dims == found["delta"].dims == ("draw",)
    assert (found["failure"] == "").all()
    chosen = found.sel(contacts_name='"all"')
    assert chosen["regime"].shape == (3, 1)
    assert "spectrum_onset" not in found
    assert "layered_from" not in found


def test_pictures_say_what_they_are_of(setup: Experiment) -> None:
    vary = {"mixture.delta": [-0.3, 0.3], "mixture.psi": [0.2, 0.3]}
    found = phase(setup, vary, ["continuum"], deposits=2, lines=0, workers=1)
    assert found["picture_point"].values.tolist() == [1, 3]
    for picture, delta in zip(found["deposit"].values, (-0.3, 0.3), strict=True):
        there = setup.with_values({"mixture.delta": delta, "mixture.psi": 0.3})
        np.testing.assert_array_equal(picture, picture_of(POUR["continuum"](there)))


def test_plans_that_keep_other_deposits_are_told_apart(setup: Experiment) -> None:
    axes = axes_of({"mixture.delta": [0.1, 0.2, 0.3]})
    told = [plan_of(setup, axes, ["ca_model"], n).digest for n in (0, 1, 2)]
    assert len(set(told)) == 3


def test_a_diagram_carries_the_set_up_it_was_made_from(setup, diagram) -> None:
    assert Experiment.from_toml(diagram.attrs["experiment"]) == setup
    assert diagram["delta"].attrs["field"] == "mixture.delta"
    slopes = pure_slopes(diagram).reshape(3, 3, 2)
    np.testing.assert_allclose(np.diff(slopes[:, :2])[..., 0], np.outer(DELTAS, [1, 1]))
    assert np.isnan(slopes[:, 2]).all()


# where layers begin


def test_the_onset_in_the_spectrum_is_the_critical_delta_of_each_line(setup, diagram) -> None:
    assert math.isnan(diagram["spectrum_onset"].sel(psi=1.5))
    assert "it makes a repose slope of -0.5" in diagram["spectrum_onset"].attrs["comment"]
    expected = critical_delta(setup.with_values({"mixture.psi": 0.1}), (-0.2, 0.3))
    assert float(diagram["spectrum_onset"].sel(psi=0.1)) == pytest.approx(expected, abs=1e-3)


def row_of(regimes: list[str], share: list[float]) -> xr.Dataset:
    x = xr.DataArray(
        np.arange(len(share)) / 10, dims="delta", attrs={"field": "mixture.delta", "units": "1"}
    )
    return xr.Dataset(
        {"regime": (("delta", "model"), [[r] for r in regimes]),
         "layered_share": (("delta", "model"), [[s] for s in share])},
        {"delta": x},
    )  # fmt: skip


S, M, L, LS, U = "segregated", "mixed", "stratified", "layered-and-segregated", "unsettled"


@pytest.mark.parametrize(
    ("regimes", "share", "place", "strays"),
    [
        ([S, S, L, L], [0, 0, 0.4, 1], 0.15, 0),
        ([S, M, LS, L], [0, 0.1, 0.3, 1], 0.15, 0),
        ([S, L, S, S, L, L, L], [0, 0.5, 0, 0, 0.2, 1, 1], 0.4, 1),
        ([S, S, L, L, S, L], [0, 0, 0.2, 1, 0, 1], 0.2, 1),
        ([S, U, "", L], [0, 0.9, np.nan, 1.0], 0.06, 0),
        ([L, L], [1, 1], np.nan, 0),
        ([L, L, S], [1, 1, 0], np.nan, 1),
        ([S, S], [0, 0], np.nan, 0),
        (["", ""], [np.nan, np.nan], np.nan, 0),
    ],
)
def test_layers_begin_where_fewest_points_are_on_the_wrong_side(
    regimes: list[str], share: list[float], place: float, strays: int
) -> None:
    found = boundary(row_of(regimes, share), "delta")
    assert found["layered_from"].values[0] == pytest.approx(place, nan_ok=True)
    assert found["layered_from_strays"].values[0] == strays


def test_the_error_of_a_boundary_is_half_of_the_gap_it_lies_in() -> None:
    found = boundary(row_of([S, "", L], [0, np.nan, 1]), "delta")
    assert found["layered_from_error"].values[0] == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("regime", "zone", "pattern"),
    [
        ("stratified", (10, 90), "stratified"),
        ("layered-and-segregated", (0, 60), "layers above, segregated below"),
        ("layered-and-segregated", (30, 100), "segregated above, layers below"),
        ("layered-and-segregated", (0, 120), "segregated above, layers below"),
        ("segregated", (0, 10), "segregated"),
        ("", (np.nan, np.nan), "failed"),
    ],
)
def test_where_layers_lie_is_told_of_what_is_layered_and_segregated(regime, zone, pattern) -> None:
    begin, end = zone
    told = {"zone_layered_begin": begin, "zone_layered_end": end, "slope_length": 100.0}
    point = xr.Dataset({name: ("model", [value]) for name, value in told.items()})
    assert patterns(point.assign(regime=("model", [regime]))).values.tolist() == [pattern]


# its picture


def test_a_map_shows_each_regime_at_its_point_and_both_boundaries(diagram) -> None:
    figure = draw_phase(diagram)
    lattice, continuum = (column.subfigs[0].axes[0] for column in figure.subfigs)
    assert continuum.get_xlabel() == "mixture.delta"
    for axes, model in ((lattice, "ca_model"), (continuum, "continuum")):
        drawn = axes.collections[0].get_array()
        expected = patterns(diagram.sel(model_name=model)).T
        told = {word: set(drawn[(expected == word).values]) for word in np.unique(expected)}
        assert all(len(colours) == 1 for colours in told.values())
        assert len(set.union(*told.values())) == len(told)
        contour = axes.collections[1].get_paths()[0].vertices
        np.testing.assert_allclose(contour[:, 0], 0.0, atol=1e-9)
        (onset,) = axes.get_lines()
        np.testing.assert_array_equal(onset.get_xdata(), diagram["spectrum_onset"].dropna("psi"))
        assert onset.get_ydata().tolist() == [0.1]
        assert axes.texts[0].xy != axes.texts[1].xy
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    there = {*patterns(diagram).values.flat}
    assert {label for label in labels if label in COLOURS} == there
    assert "equal repose slopes (delta = 0)" in labels
    assert "onset of growth in the spectrum (continuum)" in labels
    letters = [text.get_text() for text in continuum.texts]
    assert letters == ["a", "b"]


def test_one_field_is_drawn_as_curves_and_draws_as_points(setup, diagram) -> None:
    curves = draw_phase(diagram.isel(psi=0).drop_dims("picture"))
    assert len(curves.subfigs[0].subfigs[0].axes) == 3
    drawn = phase(
        setup,
        {},
        ["ca_model"],
        draw={"mixture.psi": (0.1, 0.3), "mixture.delta": (0.1, 0.2)},
        draws=3,
        workers=1,
    )
    (axes,) = draw_phase(drawn).subfigs[0].subfigs[0].axes
    np.testing.assert_allclose(
        axes.collections[0].get_offsets(), np.c_[drawn["psi"], drawn["delta"]]
    )


def test_values_of_one_ratio_have_a_logarithmic_axis(diagram) -> None:
    field = {"field": "mixture.cross_rate", "units": "s-1"}
    rates = xr.DataArray([0.01, 0.1, 1.0], dims="psi", attrs=field)
    (lattice, _) = draw_phase(diagram.assign_coords(psi=rates).drop_dims("picture")).subfigs
    (axes,) = lattice.subfigs[0].axes
    assert (axes.get_xscale(), axes.get_yscale()) == ("linear", "log")
    assert axes.get_ylabel() == "mixture.cross_rate (s-1)"
    edges = axes.collections[0].get_coordinates()[:, 0, 1]
    np.testing.assert_allclose(np.log10(edges), [-2.5, -1.5, -0.5, 0.5])


def test_letters_and_cells_are_in_place_whatever_the_order_of_the_values(setup) -> None:
    vary = {"mixture.delta": [0.3, -0.2, 0.1], "ca_model.contacts": [2, "all", 1]}
    found = phase(setup, vary, ["ca_model"], deposits=9, workers=1)
    (axes,) = draw_phase(found).subfigs[0].subfigs[0].axes
    ticks = [tick.get_text() for tick in axes.get_yticklabels()]
    assert ticks == ["2", '"all"', "1"]
    drawn = axes.collections[0].get_array()
    assert drawn.shape == (3, 3)
    told = patterns(found).values[..., 0]
    for letter, (x, y) in ((text.get_text(), text.xy) for text in axes.texts):
        delta, contacts = divmod(ord(letter) - ord("a"), 3)
        assert (x, y) == (vary["mixture.delta"][delta], contacts)
        column = sorted(vary["mixture.delta"]).index(x)
        assert COLOURS_IN_ORDER[int(drawn[contacts, column])] == told[delta, contacts]


def test_draws_at_each_of_a_field_are_all_drawn(setup) -> None:
    drawn = {"mixture.delta": (0.1, 0.2)}
    vary = {"mixture.psi": [0.1, 0.3]}
    found = phase(setup, vary, ["ca_model"], draw=drawn, draws=3, workers=1)
    (axes,) = draw_phase(found).subfigs[0].subfigs[0].axes
    offsets = axes.collections[0].get_offsets()
    expected = [
        (psi, delta) for psi in vary["mixture.psi"] for delta in sorted(found["delta"].values)
    ]
    np.testing.assert_allclose(offsets, expected)


def test_of_three_fields_the_middle_of_the_third_is_drawn(setup) -> None:
    vary = {"mixture.delta": [0.1, 0.2], "mixture.psi": [0.2, 0.3], "pour.pile": [0, 1, 2]}
    found = phase(setup, vary, ["ca_model"], deposits=2, workers=1)
    figure = draw_phase(found)
    assert "pour.pile = 1" in figure.get_suptitle()
    assert [text.get_text() for text in figure.subfigs[0].subfigs[0].axes[0].texts] == ["a", "b"]
