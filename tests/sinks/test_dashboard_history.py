"""What the page remembers of a device is what its records say, neither more nor less."""

import msgspec
import numpy as np
import pytest
from dashboard_support import columns, records, told, with_breaks
from fit_support import FRACTIONAL, UNDECIDED, WHITE, fit_after, with_curves, with_fits
from fltea.records.records import AnyRecord, Epoch, Error, Estimate, Fit, Gap, Sample, Stats
from fltea.settings.estimator import EstimatorConfig

NOISE = "alpha=0.5&f=-1&n=600&offset_dps=1.5&seed=3"


def of(kind: type, group: list[AnyRecord]) -> list[AnyRecord]:
    return [record for record in group if isinstance(record, kind)]


def test_rows_are_the_estimates_to_the_bit() -> None:
    found = records(NOISE)
    history = told(found)
    for axis in ("gyro_x", "gyro_y", "gyro_z"):
        shown = columns(history, "rows", axis)
        by_seq = {int(seq): i for i, seq in enumerate(shown["seq"]) if np.isfinite(seq)}
        estimates = [e for e in of(Estimate, found) if e.seq >= 101]  # the first statistics name the axes
        assert len(estimates) == 499
        for estimate in estimates:
            i, e = by_seq[estimate.seq], estimate.axes[axis]
            assert shown["time"][i] == estimate.host_ns * 1e-6
            got = tuple(shown[name][i] for name in ("alpha", "alpha_std", "f", "f_std", "state"))
            own, state = e.fltea, None if e.bias is None else e.bias - history.offset(axis)
            assert got == (own.alpha, own.alpha_std, own.f, own.f_std, state)


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


def test_fits_are_rows_with_their_intervals_where_there_is_an_order() -> None:
    axes = {"gyro_x": FRACTIONAL, "gyro_y": WHITE, "gyro_z": UNDECIDED}
    found = with_fits(records(NOISE), axes)
    history = told(found)
    fits = of(Fit, found)
    assert history.fits.newest == fits[-1]
    assert history.fits.axes == axes
    x, y, z = (columns(history, "fits", axis) for axis in axes)
    assert x["time"].tolist() == [f.host_ns * 1e-6 for f in fits][-len(x["time"]) :]
    assert len(x["time"]) >= 4
    names = ("alpha_low", "alpha_mid", "alpha_high", "f_low", "f_mid", "f_high")
    assert tuple(x[name][-1] for name in names) == (0.762, 0.803, 0.847, -1.31, -1.02, -0.77)
    assert tuple(z[name][-1] for name in names) == (0.41, 0.66, 0.97, -6.0, -2.1, 0.4)
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
    epoch = next(r for r in found if isinstance(r, Epoch))
    history.write(msgspec.structs.replace(epoch, epoch=2, seq=600, host_ns=samples[-1].host_ns + 1))
    assert history.fits.curves["gyro_x"] is newer, "the fit goes on through epochs"
    mid = columns(history, "fits", "gyro_x")["alpha_mid"]
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
    seq = columns(history, "rows", "gyro_x")["seq"]
    assert np.isnan(seq).any()


def test_whiteness_is_as_stats_say() -> None:
    found = records("n=1500")
    history = told(found)
    shown = columns(history, "checks", "gyro_z")
    last = of(Stats, found)[-1].axes["gyro_z"]
    assert last.innovation_lag1 is not None
    assert (shown["lag1"][-1], shown["nis"][-1]) == (last.innovation_lag1, last.innovation_nis)
    assert len(shown["lag1"]) == 12, "of ten seconds"


def test_axes_that_are_not_estimated_are_not_shown() -> None:
    history = told(with_breaks([700], accel=True))
    assert history.axes == ("gyro_x", "accel_x", "accel_y")
    shown = columns(history, "rows", "accel_y")
    assert np.isfinite(shown["alpha"][-2])


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
