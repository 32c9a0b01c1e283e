"""Fronts and kinks in kymographs whose lines are known."""

import itertools

import numpy as np
import pytest
import xarray as xr

from compare import cycle_period, fronts, kinks
from compare.kymograph import kinks_and_fronts, mean_velocity, median_and_error
from compare.kymograph.fit import fit
from compare.kymograph.flow import Crossings, alarms, crossings, quieten
from compare.kymograph.link import link
from compare.validation.drawn import COLUMNS, DRIFT, LENGTH, PERIOD, archive_of, calm, wedges

SEEDS = range(4)
WHOLE_CYCLES = (6, 7)  # that begin after the transient, of ten


def records_of(interval: float, shift: float = 0.0) -> np.ndarray:
    return np.arange(0.0, 10.0 * PERIOD, interval) + shift * interval


def feed_noise(size: float, seed: int, time: np.ndarray, blocks: float = 1.0) -> np.ndarray:
    """Noise (time, x) that is fed and rolls down: it depends on t - x / v alone."""
    x = np.arange(COLUMNS) + 0.5
    fed = np.random.default_rng(seed).standard_normal(20000)
    when = np.floor((time[:, None] - x / DRIFT + 50.0) * DRIFT / blocks).astype(int)
    return size * fed[when]


def check(archive: xr.Dataset, front: float, kink: float, count: tuple[int, ...]) -> None:
    up, down = kinks_and_fronts(archive)
    assert up.sizes["event"] in count
    assert down.sizes["event"] in count
    assert mean_velocity(up)[0] == pytest.approx(-kink, rel=0.02)
    assert mean_velocity(down)[0] == pytest.approx(front, rel=0.02)


@pytest.mark.parametrize(("front", "kink"), [(4.0, 2.0), (2.5, 4.0), (3.0, 3.0)])
@pytest.mark.parametrize("noise", [0.0, 0.1, 0.2])
def test_lines_of_known_velocity_are_found_none_missed_and_none_invented(
    front: float, kink: float, noise: float
) -> None:
    for seed in SEEDS:
        time = records_of(2.0, 0.17 * seed)
        archive = archive_of(wedges(front, kink), noise=noise, seed=seed, times=time)
        check(archive, front, kink, WHOLE_CYCLES)
        assert cycle_period(kinks(archive))[0] == pytest.approx(PERIOD, rel=0.01)


@pytest.mark.parametrize("blocks", [1.0, 5.0])
def test_noise_that_rolls_down_with_the_grains_is_not_taken_for_fronts(blocks: float) -> None:
    time = records_of(2.0)
    for seed in SEEDS:
        clean = wedges(3.0, 2.5)(time[:, None], np.arange(COLUMNS) + 0.5)
        noise = feed_noise(0.2, seed, time, blocks) * clean
        check(archive_of(wedges(3.0, 2.5), noise=noise, times=time), 3.0, 2.5, WHOLE_CYCLES)


def test_few_grains_make_no_difference() -> None:
    """Shot noise: three grains a column in the mean."""
    time = records_of(1.0)
    for seed in SEEDS:
        clean = wedges(3.0, 2.0)(time[:, None], np.arange(COLUMNS) + 0.5)
        grains = np.random.default_rng(seed).poisson(3.0 * clean) / 3.0
        check(archive_of(wedges(3.0, 2.0), noise=grains - clean, times=time), 3.0, 2.0, (6, 7))


@pytest.mark.parametrize("missing", [0.01, 0.05, 0.1])
def test_a_grain_missing_here_and_there_is_no_rest_however_dense_the_records(
    missing: float,
) -> None:
    """Records as dense as steps of the grains from column to column, and single empty columns."""
    time = records_of(1.0 / DRIFT)
    clean = wedges(3.0, 2.5)(time[:, None], np.arange(COLUMNS) + 0.5)
    empty = np.random.default_rng(7).random(clean.shape) < missing
    check(archive_of(wedges(3.0, 2.5), noise=-clean * empty, times=time), 3.0, 2.5, WHOLE_CYCLES)


@pytest.mark.parametrize("interval", [0.2, 0.5, 2.0])
def test_a_kink_that_halts_is_one_kink_however_dense_the_records(interval: float) -> None:
    """It stays for 6 s at the middle of the slope."""

    def rolling(time: np.ndarray, x: np.ndarray) -> np.ndarray:
        phase = time % PERIOD
        stops = LENGTH / 4.0 + (LENGTH - x) / 3.0 + 6.0 * (x < LENGTH / 2)
        return 1.0 * ((phase > x / 4.0) & (phase < stops))

    up, down = kinks_and_fronts(archive_of(rolling, times=records_of(interval)))
    assert up.sizes["event"] in WHOLE_CYCLES
    assert down.sizes["event"] in WHOLE_CYCLES
    assert (up["end_x"] < 0.1 * LENGTH).all()


@pytest.mark.parametrize("noise", [0.0, 0.1, 0.2])
def test_errors_are_honest(noise: float) -> None:
    """Deviations over their errors have an rms near 1; more sparing is only where nothing errs."""
    pulls: dict[str, list[float]] = {"velocity": [], "acceleration": []}
    for seed in range(8):
        archive = archive_of(
            wedges(3.0, 3.0), noise=noise, seed=seed, times=records_of(1.87, 0.1 * seed)
        )
        for lines, v in zip(kinks_and_fronts(archive), (-3.0, 3.0), strict=True):
            for name, truth in (("velocity", v), ("acceleration", 0.0)):
                pulls[name] += list(((lines[name] - truth) / lines[f"{name}_error"]).values)
    for values in pulls.values():
        rms = np.sqrt(np.mean(np.square(values)))
        assert rms < 1.5
        assert rms > 0.5 or noise == 0.0
        assert np.abs(values).max() < 5.0


@pytest.mark.parametrize("slows", [0.0, 0.4, -0.4])
def test_a_kink_that_slows_down_is_told_from_one_that_does_not(slows: float) -> None:
    """Of passage t = t0 + y / v + slows y^2 / (2 v L), y = L - x: dv/dt at the middle is known."""
    v = 2.0

    def rolling(time: np.ndarray, x: np.ndarray) -> np.ndarray:
        y = LENGTH - x
        phase = time % PERIOD
        stops = LENGTH / 4.0 + y / v + slows * y**2 / (2 * v * LENGTH)
        return 1.0 * ((phase > x / 4.0) & (phase < stops))

    for noise in (0.0, 0.2):
        lines = kinks(archive_of(rolling, noise=noise, times=records_of(1.0)))
        speed = v / (1.0 + slows / 2)
        slowing = slows / (v * LENGTH) * speed**3
        assert mean_velocity(lines)[0] == pytest.approx(-speed, rel=0.02)
        found = lines["acceleration"]
        assert float(found.median()) == pytest.approx(slowing, abs=2e-3, rel=0.15)
        assert (np.abs(found - slowing) < 5 * lines["acceleration_error"]).all()
        if slows:
            assert (np.abs(found) > 3 * lines["acceleration_error"]).all()


@pytest.mark.parametrize("noise", [0.0, 0.2])
def test_several_kinks_climb_at_once(noise: float) -> None:
    """A cycle of a fifth of the time that a kink needs to climb."""
    period, kink = 40.0, 0.5

    def rolling(time: np.ndarray, x: np.ndarray) -> np.ndarray:
        phase = (time + x / kink) % period  # stripes that climb at the speed of the kink
        return 1.0 * (phase < period / 2)

    for seed in SEEDS:
        archive = archive_of(rolling, noise=noise, seed=seed, times=records_of(2.0))
        lines = kinks(archive)
        assert mean_velocity(lines)[0] == pytest.approx(-kink, rel=0.02)
        assert cycle_period(lines)[0] == pytest.approx(period, rel=0.01)
        early, late = lines["passage"].min("x"), lines["passage"].max("x")
        alive = [int(((early < t) & (late > t)).sum()) for t in (500.0, 600.0, 700.0)]
        assert set(alive) <= {4, 5}
        whole = (late - early) > 0.9 * LENGTH / kink
        assert 12 <= int(whole.sum()) <= 20


@pytest.mark.parametrize("noise", [0.0, 0.2])
def test_a_kink_born_on_the_slope_is_trapped_and_counts(noise: float) -> None:
    """Every other avalanche stops half-way down, where its kink is born."""
    for seed in SEEDS:
        archive = archive_of(
            wedges(4.0, 2.0, reach=(1.0, 0.5)), noise=noise, seed=seed, times=records_of(1.0)
        )
        up, down = kinks_and_fronts(archive)
        assert up.sizes["event"] in WHOLE_CYCLES
        assert down.sizes["event"] in WHOLE_CYCLES
        born = up["born"].values
        assert set(born) == {"wall", "slope"}
        assert all(a != b for a, b in itertools.pairwise(born))
        trapped = up.isel(event=born == "slope")
        np.testing.assert_allclose(trapped["birth_x"], 0.5 * LENGTH, atol=4.0)
        np.testing.assert_allclose(trapped["birth_time"] % PERIOD, 12.5, atol=2.5)
        np.testing.assert_allclose(up["velocity"], -2.0, rtol=0.1)
        assert set(down["born"].values) == {"source"}
        np.testing.assert_allclose(down["end_x"].values[1:-1], up["birth_x"].values[1:-1], atol=6.0)
        upper = up["passage"].sel(x=slice(20, 40)).diff("event").mean("x")
        assert float(upper.mean()) == pytest.approx(PERIOD, rel=0.15)
        assert (down["velocity"] > 0).all()


@pytest.mark.parametrize("per_cycle", [200, 50, 25, 16, 12, 8])
def test_coarse_records_lose_no_kink_and_no_velocity_is_told_that_they_do_not_tell(
    per_cycle: int,
) -> None:
    """Every cycle is seen down to eight records; a velocity that is told is within its error."""
    for shift in (0.0, 0.3, 0.6):
        archive = archive_of(wedges(4.0, 3.0), times=records_of(100.3 / per_cycle, shift))
        lines = kinks_and_fronts(archive)
        for found, v in zip(lines, (-3.0, 4.0), strict=True):
            assert found.sizes["event"] in WHOLE_CYCLES
            assert found.attrs["records_per_cycle"] == pytest.approx(per_cycle, rel=0.02)
            told = found.isel(event=np.isfinite(found["velocity"].values))
            assert (np.abs(told["velocity"] - v) < 5 * told["velocity_error"]).all()
            if per_cycle >= 25:
                assert mean_velocity(found)[0] == pytest.approx(v, rel=0.02)
            else:
                assert "velocit" in found.attrs["comment"]
            if per_cycle <= 8 and v > 0:
                assert not told.sizes["event"]
        assert cycle_period(lines[0])[0] == pytest.approx(PERIOD, rel=0.01)


@pytest.mark.parametrize("interval", [105.0, 52.0, 97.0])
def test_cycles_between_records_are_not_taken_for_slow_ones(interval: float) -> None:
    """The pile grows where no record shows a flow: then neither velocity nor period is told."""
    time = np.arange(0.0, 400 * interval, interval)
    for lines in kinks_and_fronts(archive_of(wedges(4.0, 3.0), times=time)):
        assert np.isnan(mean_velocity(lines)[0])
        assert np.isnan(cycle_period(lines)).all()
        assert "seem slower" in lines.attrs["comment"]


@pytest.mark.parametrize(("interval", "few"), [(8.0, False), (11.0, True), (18.0, True)])
def test_lines_may_be_missed_where_the_shortest_cycle_has_few_records(
    interval: float, few: bool
) -> None:
    """Grains roll down in 20 s; 11 s are nine records in the cycle that is found, yet too few."""
    for lines in kinks_and_fronts(archive_of(wedges(4.0, 3.0), times=records_of(interval))):
        assert ("may be missed" in lines.attrs["comment"]) == few


@pytest.mark.parametrize("noise", [0.02, 0.05, 0.1, 0.2])
def test_noise_invents_no_line_in_a_calm_flow(noise: float) -> None:
    """Neither in one that thins out towards the wall, nor in one as thin as the levels."""
    time = records_of(2.0)
    for seed in SEEDS:
        for flow in (calm, lambda t, x: 0.3 + 0.0 * (t + x), lambda t, x: 0.2 + 0.0 * (t + x)):
            archive = archive_of(flow, noise=noise, seed=seed, times=time)
            for lines in kinks_and_fronts(archive):
                assert lines.sizes["event"] == 0
                assert np.isnan(cycle_period(lines)).all()
                assert np.isnan(mean_velocity(lines)).all()


def test_of_a_heap_the_slope_on_the_right_is_measured() -> None:
    heap = archive_of(wedges(4.0, 2.0), shape="heap")
    silo = archive_of(wedges(4.0, 2.0))
    for of_heap, of_silo in zip(kinks_and_fronts(heap), kinks_and_fronts(silo), strict=True):
        assert (of_heap["x"] > 0).all()
        np.testing.assert_allclose(of_heap["velocity"], of_silo["velocity"])


@pytest.mark.parametrize("width", [6.0, 12.0])
@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_widths_are_those_of_the_ramps(width: float, noise: float) -> None:
    """R falls evenly over a `width`, so from 3/4 to 1/4 over half of it."""

    def rolling(time: np.ndarray, x: np.ndarray) -> np.ndarray:
        phase = (time - 10.0) % PERIOD
        stops = LENGTH / 4.0 + (LENGTH - x) / 2.0
        rise = (4.0 * phase - x) / width + 0.5
        fall = 2.0 * (stops - phase) / width + 0.5
        return np.clip(np.minimum(rise, fall), 0.0, 1.0)

    archive = archive_of(rolling, noise=noise, times=records_of(0.25))
    for lines in kinks_and_fronts(archive):
        assert float(lines["width"].median()) == pytest.approx(width / 2, rel=0.1)
        assert (lines["width_limit"] < 0.5 * lines["width"]).all()


def test_the_width_of_a_sharp_jump_is_within_its_limit() -> None:
    for noise in (0.0, 0.2):
        for lines in kinks_and_fronts(archive_of(wedges(3.0, 3.0), noise=noise)):
            assert (lines["width"] < 1.5 * lines["width_limit"]).all()


def test_what_passes_a_line_is_told_by_species() -> None:
    """Behind a kink 5 % of the small and 15 % of the large grains still roll."""
    small, large = 0.4, 0.6
    left = np.array([0.05, 0.15]) * (small, large)

    def rolling(time: np.ndarray, x: np.ndarray) -> np.ndarray:
        return left.sum() + (1.0 - left.sum()) * wedges(4.0, 2.0)(time, x)

    def share(time: np.ndarray, x: np.ndarray) -> np.ndarray:
        return np.where(wedges(4.0, 2.0)(time, x) > 0.5, large, left[1] / left.sum())

    up, down = kinks_and_fronts(archive_of(rolling, share=share, noise=0.0))
    for lines, v in ((up, -2.0), (down, 4.0)):
        for name, truth in (
            ("upstream", (small, large)),
            ("downstream", left),
            ("passed_fraction", (0.05, 0.15)),
        ):
            np.testing.assert_allclose(lines[name].median("event"), truth, rtol=0.03)
        life = lines["end_time"] - lines["birth_time"]
        expected = (DRIFT - v) * left * life.values[:, None]
        np.testing.assert_allclose(lines["passed_volume"], expected, rtol=0.05)


def test_every_variable_has_a_meaning_and_its_units() -> None:
    for lines in (kinks(archive_of(wedges(4.0, 2.0))), fronts(archive_of(wedges(4.0, 2.0)))):
        for name, variable in lines.variables.items():
            assert variable.attrs["long_name"]
            assert name in ("born", "measured") or variable.attrs["units"]


def test_crossings_lie_between_records() -> None:
    time = np.arange(0.0, 60.0)
    x = np.arange(4.0)
    flow = np.clip((time[:, None] - 20.3 - x) / 4.0, 0.0, 1.0)
    flow *= np.clip((45.6 - x - time[:, None]) / 2.0, 0.0, 1.0) ** 0.5
    stops, starts = crossings(time, flow, alarms(flow, 0.0))
    np.testing.assert_array_equal(stops.column, x)
    np.testing.assert_allclose(starts.time, 21.5 + x, atol=1e-9)
    np.testing.assert_allclose(stops.before, stops.time - starts.time)
    assert np.isinf(starts.before).all()


def test_noise_is_measured_in_the_flow_and_averaged_only_as_far_as_it_has_to_be() -> None:
    random = np.random.default_rng(1)
    flow = 1.0 + 0.4 * random.standard_normal((400, 200))
    _, columns, noise = quieten(flow, 1.0)
    assert 1 < columns <= 31
    assert noise == pytest.approx(0.4 / np.sqrt(columns), rel=0.05)
    assert quieten(flow, 9.0)[1] >= 9
    assert quieten(np.ones((50, 50)), 1.0)[1:] == (1, 0.0)


def test_kinks_without_fronts_are_remarked_and_sound_lines_are_not() -> None:
    """Flow that sets in everywhere at once has no front."""

    def at_once(time: np.ndarray, x: np.ndarray) -> np.ndarray:
        return 1.0 * (time % PERIOD < LENGTH / 4.0 + (LENGTH - x) / 3.0)

    for lines in kinks_and_fronts(archive_of(at_once)):
        assert "7 kinks and 0 fronts" in lines.attrs["comment"]
    for lines in kinks_and_fronts(archive_of(wedges(4.0, 3.0), times=records_of(0.5))):
        assert "comment" not in lines.attrs


@pytest.mark.parametrize(("noise", "remarked"), [(0.2, False), (2.0, True)])
def test_noise_that_is_left_is_remarked(noise: float, remarked: bool) -> None:
    lines = kinks(archive_of(wedges(4.0, 3.0), noise=noise))
    assert (lines.attrs["noise"] > 0.25) == remarked
    assert ("still has a noise" in lines.attrs.get("comment", "")) == remarked


def test_lines_that_cross_a_gap_are_linked_and_crossing_lines_are_not_mixed() -> None:
    column = np.tile(np.arange(20), 2)
    time = np.concatenate([np.arange(20) * 1.0, 30.0 + np.arange(20) * 1.0])
    kept = ~((column == 7) | (column == 8))
    found = Crossings(column[kept], time[kept], time[kept], time[kept])
    lines = link(found, 0.5)
    assert len(set(lines)) == 2
    assert len(set(lines[: kept[:20].sum()])) == 1


def test_outliers_do_not_bend_a_curve() -> None:
    x = np.arange(100.0)
    passage = np.stack([3.0 + 0.5 * x, 100.0 - 0.2 * x + 0.01 * (x - 49.5) ** 2])
    passage[:, ::7] += 40.0
    curves = fit(x, passage, 2, 0.01)
    np.testing.assert_allclose(curves.coefficient[:, 1] / curves.half, [0.5, -0.2], atol=1e-6)
    np.testing.assert_allclose(curves.coefficient[:, 2] / curves.half**2, [0.0, 0.01], atol=1e-6)


@pytest.mark.parametrize("level", [0.0, 1.0])
def test_the_alarm_rises_with_the_noise(level: float) -> None:
    """Of 200 columns at rest, or in flow, noise sets off an alarm in hardly any."""
    flow = level + 0.35 * np.random.default_rng(5).standard_normal((600, 200))
    told = alarms(flow, 0.35)[20:]
    assert (told[1:] != told[:1]).any(axis=0).sum() <= 2
    deaf = alarms(flow, 0.0)[20:]
    assert (deaf[1:] != deaf[:1]).any(axis=0).sum() > 20


@pytest.mark.parametrize("degree", [1, 2])
def test_all_passages_of_an_exact_line_are_independent(degree: int) -> None:
    """What rounding leaves is alike in neighbouring columns, too, and says nothing of them."""
    x = np.arange(60) * 0.5 + 0.25
    curves = fit(x, np.array([288.4 - 0.3 * x, 7.0 + 0.7 * x]), degree, 0.1)
    assert curves.independent == pytest.approx(60.0)


@pytest.mark.parametrize("own", [1e-3, 1.0])
@pytest.mark.parametrize("n", [2, 3, 4, 6, 9, 10, 20])
def test_the_error_of_a_median_of_few_is_honest(n: int, own: float) -> None:
    """Of 4000 samples about two thirds lie within it, whether or not they know their own errors."""
    draw = np.random.default_rng(n).standard_normal
    told = [median_and_error(draw(n), np.full(n, own), np.ones(n)) for _ in range(4000)]
    within = np.mean([abs(middle) < error for middle, error in told])
    assert 0.6 < within < (0.77 if own < 1.0 else 0.9)


def test_one_value_has_its_own_error_and_none_has_none() -> None:
    assert median_and_error(np.array([2.0]), np.array([0.1]), np.ones(1)) == (2.0, 0.1)
    assert np.isnan(median_and_error(np.zeros(0), np.zeros(0), np.zeros(0))).all()


def test_short_lines_count_little_in_the_velocity() -> None:
    """Three kinks on the whole slope, and five on a tenth of it that are faster."""
    lines = kinks(archive_of(wedges(4.0, 2.0)))
    assert lines.sizes["event"] >= 6
    speed = np.full(lines.sizes["event"], -5.0)
    speed[:3] = -2.0
    seen = (speed == -2.0)[:, None] | (abs(lines["x"].values - 50.0) < 5.0)
    uneven = lines.assign(velocity=("event", speed))
    short = uneven.assign(passage=lines["passage"].where(xr.DataArray(seen, dims=("event", "x"))))
    assert mean_velocity(short)[0] == pytest.approx(-2.0)
    assert mean_velocity(uneven)[0] < -3.0
