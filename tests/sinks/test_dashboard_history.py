"""Tests that the history that the live page keeps of a device agrees exactly with the device's records."""

import msgspec
import numpy as np
import pytest
from fltea.records.records import Epoch, Error, Estimate, Fit, Gap, Sample, Stats
from fltea.settings.estimator import EstimatorConfig

from tests.rig.blocks import of
from tests.rig.dashboard_support import columns, records, told, with_breaks
from tests.rig.fit_support import FRACTIONAL, UNDECIDED, WHITE, fit_after, with_curves, with_fits

NOISE = "alpha=0.5&f=-1&n=600&offset_dps=1.5&seed=3"


def test_a_row_is_a_bucket_of_samples_with_what_is_estimated_then() -> None:
    found = records(NOISE)
    history = told(found)
    bias = history.offset("gyro_y")
    assert bias == pytest.approx(1.5, abs=0.1), "what the estimator removes"
    shown = columns(history, "gyro_y")
    samples = {s.seq: s for s in of(Sample, found)}
    estimates = {e.host_ns: e.axes["gyro_y"] for e in of(Estimate, found)}
    assert len(shown["time"]) == pytest.approx(50, abs=2)
    # the first row is skipped: at that time the page does not know the axes of the estimates yet
    for i, time_ms in [*enumerate(shown["time"])][1:]:
        inside = [s for s in samples.values() if s.host_ns * 1e-6 // 100 == time_ms // 100]
        y = np.array([s.gyro_dps[1] for s in inside]) - bias
        assert time_ms == pytest.approx(np.mean([s.host_ns for s in inside]) * 1e-6)
        assert (shown["y_low"][i], shown["y_high"][i]) == pytest.approx((y.min(), y.max()))
        assert shown["y"][i] == pytest.approx(y.mean())
        # an estimate comes after its sample, so a sample's row has the estimate of the sample before
        known = [estimates[s.host_ns - 10_000_000] for s in inside]
        assert shown["alpha"][i] == pytest.approx(np.mean([e.fltea.alpha for e in known]))
        assert shown["f_std"][i] == pytest.approx(np.mean([e.fltea.f_std for e in known]))
        assert shown["state"][i] == pytest.approx(np.mean([e.bias - bias for e in known]))


def test_start_up_shows_samples_and_no_estimate() -> None:
    history = told(records("n=300&offset_dps=5", EstimatorConfig(startup=200, window=200)))
    shown = columns(history, "gyro_x")
    early = shown["time"] < shown["time"][0] + 900
    assert early.sum() == 9  # earlier rows are missing: the page did not know the axes yet
    assert np.isnan(shown["alpha"][early]).all()
    assert np.isfinite(shown["y"][early]).all()
    assert np.abs(shown["y"][early]).max() < 1.5, "the mean so far is taken off"


def test_fits_are_rows_with_their_intervals_where_there_is_an_order() -> None:
    axes = {"gyro_x": FRACTIONAL, "gyro_y": WHITE, "gyro_z": UNDECIDED}
    found = with_fits(records(NOISE), axes)
    history = told(found)
    fits = of(Fit, found)
    assert history.fits.newest == fits[-1]
    assert history.fits.axes == axes
    x, y, z = (columns(history, axis) for axis in axes)
    names = ("alpha_low", "alpha_mid", "alpha_high", "f_low", "f_mid", "f_high")
    assert tuple(x[name][-1] for name in names) == pytest.approx((0.762, 0.803, 0.847, -1.31, -1.02, -0.77))
    assert tuple(z[name][-1] for name in names) == pytest.approx((0.41, 0.66, 0.97, -6.0, -2.1, 0.4))
    assert all(np.isnan(y[name]).all() for name in names), "of white noise there is no order to draw"


def test_curves_stay_until_there_are_newer_ones_or_another_sensor() -> None:
    found = records(NOISE)
    samples = of(Sample, found)
    history = told(found)
    history.write(fit_after(samples[-2], {"gyro_x": with_curves(FRACTIONAL)}))
    first = history.fits.curves["gyro_x"]
    history.write(fit_after(samples[-1], {"gyro_x": FRACTIONAL, "gyro_y": with_curves(WHITE)}))
    assert history.fits.curves["gyro_x"] is first
    spectrum = msgspec.structs.replace(with_curves(FRACTIONAL), allan=None)
    history.write(fit_after(samples[-1], {"gyro_x": spectrum}))
    newer = history.fits.curves["gyro_x"]
    assert (newer.spectrum, newer.allan) == (spectrum.spectrum, first.allan)
    last_ns = samples[-1].host_ns + 100_000_000
    history.write(msgspec.structs.replace(samples[-1], host_ns=last_ns))
    epoch = next(r for r in found if isinstance(r, Epoch))
    history.write(msgspec.structs.replace(epoch, epoch=2, seq=600, host_ns=last_ns + 1))
    assert history.fits.curves["gyro_x"] is newer, "the fit goes on through epochs"
    mid = columns(history, "gyro_x")["alpha_mid"]
    assert np.isnan(mid[-1]), "no line joins two epochs"
    assert mid[-2] == FRACTIONAL.alpha.value
    history.write(fit_after(samples[-1], {"gyro_x": WHITE}, samples=100))
    assert (history.fits.axes, history.fits.curves) == ({"gyro_x": WHITE}, {})


@pytest.mark.parametrize("every", [1, 4, 7])
def test_samples_of_an_epoch_are_counted_though_not_all_of_them_come(every: int) -> None:
    thinned = [
        r for r in with_breaks([400, 300]) if not isinstance(r, Sample | Estimate) or r.seq % every == 0
    ]
    history = told(thinned)
    assert history.sample is not None
    assert history.samples_of_epoch == history.sample.seq - 400 + 1
    history.write(Gap(700, 20, 2, 1))
    history.write(msgspec.structs.replace(history.sample, seq=728))
    assert history.samples_of_epoch == 309


def test_new_epoch_cuts_the_lines() -> None:
    found = with_breaks([400, 300])
    history = told(found)
    assert [h.kind for h in history.happenings] == ["epoch", "epoch"]
    assert "the device restarted" in history.happenings[-1].text
    assert history.samples_of_epoch == 300
    y = columns(history, "gyro_x")["y"]
    assert np.isnan(y).sum() == 1


def test_whiteness_is_as_stats_say() -> None:
    found = records("n=1500")
    history = told(found)
    shown = columns(history, "gyro_z")
    said = [
        (axis.innovation_lag1, axis.innovation_nis) for s in of(Stats, found) for axis in [s.axes["gyro_z"]]
    ]
    assert (shown["lag1"][-1], shown["nis"][-1]) == pytest.approx(said[-2])


def test_axes_that_are_not_estimated_are_not_shown() -> None:
    history = told(with_breaks([700], accel=True))
    assert history.axes == ("gyro_x", "accel_x", "accel_y")
    shown = columns(history, "accel_y")
    assert np.isfinite(shown["alpha"][-2])
    assert np.isfinite(shown["y"][-2])


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
    times = columns(history, "gyro_x")["time"]
    assert np.nanmax(times) < hour_ns * 1e-6
    assert (np.diff(times) >= 0).all()


def test_silence_cuts_the_line() -> None:
    found = records("n=200")
    late = [
        msgspec.structs.replace(r, host_ns=r.host_ns + 10**10) if getattr(r, "seq", 0) > 150 else r
        for r in found
    ]
    shown = columns(told(late), "gyro_x")
    (gap,) = np.flatnonzero(np.isnan(shown["y"]))
    assert shown["time"][gap + 1] - shown["time"][gap] > 9_000
