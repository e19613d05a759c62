"""What the page remembers of a device is what its records say, neither more nor less."""

import msgspec
import numpy as np
import pytest
from dashboard_support import QUICK, records, told, with_breaks
from fltea.estimator.white_band import WhiteBand
from fltea.records.records import AnyRecord, AxisEstimate, Error, Estimate, Gap, Sample, Stats
from fltea.settings.config import EstimatorConfig
from fltea.sinks.page.history import DeviceHistory, Table
from fltea.sinks.page.tiers import Cursor
from fltea.stream.white import STEP

NOISE = "alpha=0.5&f=-1&n=600&offset_dps=1.5&seed=3"


def columns(history: DeviceHistory, table: Table, axis: str, window: int = 0) -> dict[str, np.ndarray]:
    values = history.read(table, window, Cursor()).values
    return {name: values[:, place] for name, place in history.columns(table, axis).items()}


def of(kind: type, group: list[AnyRecord]) -> list[AnyRecord]:
    return [record for record in group if isinstance(record, kind)]


def test_rows_are_the_estimates_to_the_bit() -> None:
    found = records(NOISE)
    history = told(found)
    for axis in ("gyro_x", "gyro_y", "gyro_z"):
        shown = columns(history, "rows", axis)
        by_seq = {int(seq): i for i, seq in enumerate(shown["seq"]) if np.isfinite(seq)}
        for estimate in of(Estimate, found)[50:]:  # the axes are known from the first second on
            i, e = by_seq[estimate.seq], estimate.axes[axis]
            assert shown["time"][i] == estimate.host_ns * 1e-6
            got = tuple(shown[name][i] for name in ("alpha", "alpha_std", "f", "f_std", "state"))
            assert got == (e.alpha, e.alpha_std, e.f, e.f_std, e.state)


def test_samples_are_shown_without_the_offset_that_the_estimator_removes() -> None:
    found = records(NOISE)
    history = told(found)
    bias = of(Stats, found)[-1].axes["gyro_y"].bias
    assert bias == pytest.approx(1.5, abs=0.1)
    shown = columns(history, "rows", "gyro_y")
    samples = {s.seq: s.gyro_dps[1] for s in of(Sample, found)}
    after = shown["seq"] > 60
    assert after.sum() == 500
    for seq, y in zip(shown["seq"][after], shown["y"][after], strict=True):
        assert y == pytest.approx(samples[int(seq)] - bias, abs=1e-12)
    assert shown["y_low"].tolist() == shown["y_high"].tolist() == shown["y"].tolist()


def test_start_up_shows_samples_and_no_estimate() -> None:
    history = told(records("n=300&offset_dps=5", EstimatorConfig(startup=200, window=200)))
    shown = columns(history, "rows", "gyro_x")
    early = shown["seq"] < 200
    assert early.sum() >= 90  # the axes are known from the first second on
    assert np.isnan(shown["alpha"][early]).all()
    assert np.isfinite(shown["y"][early]).all()
    assert np.abs(shown["y"][early]).max() < 1.5, "the mean so far is taken off"


def test_band_keeps_in_step_with_the_estimates() -> None:
    found = records(NOISE)
    history = told(found)
    shown = columns(history, "white", "gyro_x")
    estimates = len(of(Estimate, found))
    moments = shown["time"][np.isfinite(shown["alpha_mid"])]
    last = of(Estimate, found)[estimates // STEP * STEP - 1]
    assert moments[-1] == last.host_ns * 1e-6
    follower = history.followers["gyro_x"]
    assert follower is not None
    power = follower.power
    assert power is not None
    expected = WhiteBand(QUICK, 0.01, power, 1 / 16.4).advance(estimates // STEP * STEP)
    assert shown["alpha_mid"][-1] == expected.alpha[1]
    assert (shown["f_low"][-1], shown["f_high"][-1]) == (expected.f[0], expected.f[2])


def test_each_axis_has_runs_of_its_own() -> None:
    history = told(records(NOISE))
    x, y = (columns(history, "white", axis)["alpha_mid"][-1] for axis in ("gyro_x", "gyro_y"))
    assert x != y


def test_new_epoch_begins_a_new_band_and_cuts_the_lines() -> None:
    found = with_breaks([400, 300])
    history = told(found)
    assert [h.kind for h in history.happenings] == ["epoch", "epoch"]
    assert "the device restarted" in history.happenings[-1].text
    mid = columns(history, "white", "gyro_x")["alpha_mid"]
    cut = np.flatnonzero(np.isnan(mid))
    assert cut.size >= 1
    after = mid[cut[-1] + 1 :]
    assert len(after) == 250 // STEP
    assert after[0] > after[-1]  # wide open again, then narrowing down
    assert history.samples_of_epoch == 300
    seq = columns(history, "rows", "gyro_x")["seq"]
    assert np.isnan(seq).any()


def test_axis_that_begins_anew_has_its_band_begin_anew() -> None:
    found = records(NOISE)
    invalid = AxisEstimate(None, None, None, None, None, None, False)
    estimates = of(Estimate, found)
    changed = {e.seq: e for e in estimates}
    for e in estimates[300:320]:
        changed[e.seq] = msgspec.structs.replace(e, axes={**e.axes, "gyro_x": invalid})
    history = told([changed[r.seq] if isinstance(r, Estimate) else r for r in found])
    x, y = history.followers["gyro_x"], history.followers["gyro_y"]
    assert x is not None
    assert y is not None
    power = x.power
    assert power is not None
    whole = (len(estimates) - 320) // STEP * STEP
    assert x.quantiles.alpha.tolist() == WhiteBand(QUICK, 0.01, power, 1 / 16.4).advance(whole).alpha.tolist()
    shown = columns(history, "rows", "gyro_x")
    assert np.isnan(shown["alpha"][shown["seq"] == estimates[310].seq]).all()
    assert np.isfinite(y.quantiles.alpha).all()


def test_constant_axis_has_no_band() -> None:
    still = [
        msgspec.structs.replace(r, gyro_dps=(0.5, *r.gyro_dps[1:])) if isinstance(r, Sample) else r
        for r in records(NOISE)
    ]
    history = told(still)
    assert np.isnan(columns(history, "white", "gyro_x")["alpha_mid"]).all()
    assert np.isfinite(columns(history, "white", "gyro_y")["alpha_mid"][-1])


def test_given_R_is_that_of_the_axis() -> None:
    config = EstimatorConfig(startup=50, window=200, R=[0.02, 5.0, 0.02])
    history = told(records(NOISE, config), config=config)
    y = history.followers["gyro_y"]
    assert y is not None
    power = y.power
    assert power is not None
    band = WhiteBand(config, 0.01, power, 1 / 16.4, R=5.0, seed=1).advance(550)
    assert y.quantiles.f.tolist() == band.f.tolist()


def test_whiteness_is_as_stats_say() -> None:
    found = records("n=1500")
    history = told(found)
    shown = columns(history, "checks", "gyro_z")
    last = of(Stats, found)[-1].axes["gyro_z"]
    assert last.innovation_lag1 is not None
    assert (shown["lag1"][-1], shown["nis"][-1]) == (last.innovation_lag1, last.innovation_nis)
    assert len(shown["lag1"]) >= 14


def test_axes_that_are_not_estimated_are_not_shown() -> None:
    history = told(with_breaks([700], accel=True))
    assert history.axes == ("gyro_x", "accel_x", "accel_y")
    assert history.followers["accel_x"] is None  # no settings for the accelerometer were given
    shown = columns(history, "rows", "accel_y")
    assert np.isfinite(shown["alpha"][-2])
    assert np.isnan(columns(history, "white", "accel_y")["alpha_mid"]).all()


def test_accelerometer_has_a_band_once_its_settings_are_known() -> None:
    history = DeviceHistory("due", QUICK, EstimatorConfig(startup=500, window=200))
    for record in with_breaks([1200], accel=True):
        history.write(record)
    assert np.isfinite(columns(history, "white", "accel_x")["alpha_mid"][-1])


def test_gaps_in_a_row_are_one_line() -> None:
    history = told(records("n=60"), [Gap(7, 2, 1, 10), Gap(20, 3, 1, 20)])
    assert [h.text for h in history.happenings][-1] == "2 gaps: 5 samples lost"
    history.write(Error("silent", "nothing came", 30))
    history.write(Gap(40, 1, 1, 40))
    assert [h.text for h in history.happenings][-2:] == ["silent: nothing came", "a gap: 1 samples lost"]


def test_events_are_bounded_and_what_the_page_missed_is_among_them() -> None:
    history = told([Error("silent", str(k), k) for k in range(500)])
    assert len(history.happenings) == 60
    history.missed(17)
    assert "missed 17 records" in history.happenings[-1].text


def test_date_that_was_set_back_clears_the_past() -> None:
    late, early = records("n=200"), records("n=100")
    hour_ns = 3600 * 10**9
    shifted = [
        msgspec.structs.replace(r, host_ns=r.host_ns + hour_ns) if hasattr(r, "host_ns") else r for r in late
    ]
    history = told(shifted, early)
    times = columns(history, "rows", "gyro_x")["time"]
    assert np.nanmax(times) < hour_ns * 1e-6
    assert (np.diff(times) >= 0).all()


def test_silence_cuts_the_line() -> None:
    found = records("n=200")
    late = [
        msgspec.structs.replace(r, host_ns=r.host_ns + 10**10) if getattr(r, "seq", 0) > 150 else r
        for r in found
    ]
    shown = columns(told(late), "rows", "gyro_x")
    assert np.isnan(shown["alpha"][np.flatnonzero(shown["seq"] == 150) + 1]).all()
