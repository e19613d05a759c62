"""Tests of the emulated Due that computes estimates and noise fits at the same time as the host.

The board's results are equal to those of its code on a PC in every bit, and computing them takes no more time
than allowed.
"""

from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from fltea.records.records import AXES, DeviceEstimates, DeviceFits, Estimate
from fltea.wire import layout as wire

from tests.rig.device_probe import FIELDS, STARTUP, Device
from tests.rig.due_support import NOISE, DueRun, build, image
from tests.rig.spectrum_probe import BoardSpectrum
from tools.due_emulator.noise import recorded_world
from tools.due_run import Arrival

BOTH = {"estimator.estimate_on": "both"}
EVERY = 10
RECORDINGS = ("mpu6050_sunsided_10min.npz", "mpu6050_tomisuarez_100s.npz")
CLOSE = 1e-4
"""Largest permitted difference between the order α that the board computes and the order α that the host
computes in double precision.

Within 3,000 samples, the largest difference that was seen is 4e-6.
"""

UNPLUGGED_S, PORT_OPENED_S, HELD_S, END_S = 7.0, 18.7, 25.3, 27.0
FAULTS = (
    f"unplug at={UNPLUGGED_S} for=5",
    f"port_reopen at={PORT_OPENED_S}",
    f"sda_stuck at={HELD_S} clocks=5",
)


@cache
def with_faults() -> DueRun:
    """Return a run with three faults while the board estimates.

    The three faults are: the sensor is unplugged for 5 s, the board is reset, and SDA is stuck.
    """
    return DueRun(image(), noise=NOISE, faults=FAULTS, settings=BOTH).run_until(END_S)


def estimates(run: DueRun) -> list[DeviceEstimates]:
    return [record for record in run.records if isinstance(record, DeviceEstimates)]


@pytest.mark.slow
@pytest.mark.parametrize("name", RECORDINGS)
def test_on_a_real_sensors_noise_it_agrees_with_the_host(recordings: Path, name: str) -> None:
    run = DueRun(image(), world=recorded_world(recordings / name), settings=BOTH).run_until(11.0)
    assert run.check() is None
    assert (run.stats.sample_counts.lost, run.gaps, run.troubles) == (0, [], [])
    samples = [arrival.frame for arrival in run.of(wire.Sample)]
    steps = {b.device_us - a.device_us for a, b in pairwise(samples)}
    assert steps == {10_000}, "a sample has waited for an estimate"

    found = estimates(run)
    ages = [next(iter(estimate.axes.values())).age for estimate in found]
    assert len(found) > 50
    assert [estimate.seq for estimate in found] == [age + STARTUP - 1 for age in ages]
    assert {b.seq - a.seq for a, b in pairwise(found)} == {EVERY}
    for estimate in found:
        assert estimate.comparable
        assert tuple(estimate.axes) == AXES
        for axis in estimate.axes.values():
            assert axis.fltea.valid
            assert abs(axis.alpha_difference) < CLOSE
            assert abs(axis.f_difference) < 10 * CLOSE

    # The board's estimates are equal in every bit to those of its code on the machine that runs this test.
    counts = np.array([[f.message.gyro_x, f.message.gyro_y, f.message.gyro_z] for f in samples])
    rows = [Device("joint").run(counts[:, i]) for i in range(3)]
    messages = [arrival.frame.message for arrival in run.of(wire.Estimate)]
    assert len(messages) >= 3 * len(found)
    for message in messages:
        at = message.sample - STARTUP
        for field in FIELDS[4:]:
            assert getattr(message, field) == np.float32(rows[message.axis][field][at]), (message, field)


@pytest.mark.long
def test_status_says_what_it_costs() -> None:
    run = with_faults()
    shares = [arrival.frame.message.cpu_share for arrival in run.of(wire.Status) if 14 < arrival.at_s < 17]
    # While the start-up window fills, 6 % of the processor's time is spent on the sensor. In the emulator,
    # each instruction takes one cycle.
    assert len(shares) == 3
    assert all(500 < share < 800 for share in shares)
    estimating = [arrival.frame.message for arrival in run.of(wire.Status) if 6.1 < arrival.at_s < 7]
    assert len(estimating) == 1
    assert all(1200 < status.cpu_share < 1600 for status in estimating)
    assert all(500 < status.longest_step < 2_000 for status in estimating)
    estimator = run.of(wire.Estimator)[-1].frame.message
    assert estimator.skipped == 0
    # The first sample of an axis's running spectrum takes the longest to process.
    assert 150 < estimator.longest_axis < 1000


@pytest.mark.long
def test_after_each_fault_it_begins_anew_or_goes_on_as_the_host_does() -> None:
    run = with_faults()
    assert run.error is None
    assert run.epochs == ["start", "sensor_restart", "restart"]
    by_epoch = {epoch: [e for e in estimates(run) if e.epoch == epoch] for epoch in (1, 2, 3)}
    assert all(len(found) > 5 for found in by_epoch.values())
    for epoch, found in by_epoch.items():
        assert found[0].axes["gyro_x"].age <= EVERY, f"epoch {epoch} begins with a window of its own"
        assert all(estimate.comparable for estimate in found)
        differences = [abs(axis.alpha_difference) for e in found for axis in e.axes.values()]
        assert max(differences) < CLOSE
    # Freeing the stuck bus takes five clocks and costs no sample, so the last epoch (stretch with one
    # numbering of samples) continues.
    assert run.stats.sample_counts.lost > 500
    assert by_epoch[3][-1].axes["gyro_z"].age == by_epoch[3][-1].seq - STARTUP + 1
    begun = [arrival.frame.message.begun for arrival in run.of(wire.Estimator)]
    assert begun[0] == 0
    assert max(begun) == 2, "twice in the first boot: at its start, and when the sensor was back"
    assert begun[-1] == 1


@pytest.mark.slow
def test_alone_its_estimates_are_what_is_published() -> None:
    run = DueRun(image(), noise=NOISE, settings={"estimator.estimate_on": "device"}).run_until(6.0)
    found = [record for record in run.records if isinstance(record, Estimate)]
    assert len(found) > 5
    sent = {(m.sample, m.axis): m for m in (a.frame.message for a in run.of(wire.Estimate))}
    for record in found:
        for i, axis in enumerate(AXES):
            assert record.axes[axis].fltea.alpha == sent[record.seq, i].alpha
            assert record.axes[axis].fltea.f == sent[record.seq, i].f
            assert record.axes[axis].null_p is None or 0 <= record.axes[axis].null_p <= 1


FIRST_FIT_S = 31.0
AHEAD = 100
"""Number of future samples over which the tracker averages the bias that it predicts: those of one second."""


def steps(run: DueRun, but_at_s: float = -1.0) -> set[int]:
    """Return the differences of time between consecutive samples [us], except for samples within 0.05 s of
    the time `but_at_s`.
    """
    frames = [arrival.frame for arrival in run.of(wire.Sample)]
    samples = [frame for frame in frames if abs(frame.device_us * 1e-6 - but_at_s) > 0.05]
    assert not any(frame.message.flags & wire.SampleFlags.LATE for frame in samples)
    return {b.device_us - a.device_us for a, b in pairwise(samples) if b.sequence == a.sequence + 1}


def track_as_a_pc_does(run: DueRun, fit_at: Arrival) -> list[wire.Estimate]:
    """Check that the board tracks an axis between two fits exactly as a PC does. Return the estimates of that
    time.
    """
    fit = fit_at.frame.message
    axis = wire.Axis(fit.axis).name.lower()
    samples = run.of(wire.Sample)
    counts = np.array([getattr(one.frame.message, axis) for one in samples], dtype=np.int16)[STARTUP:]
    first = samples[STARTUP].frame.sequence
    fits = [one for one in run.of(wire.Fit) if one.frame.message.axis == fit.axis]
    ends = [one.at_s for one in fits if one.at_s > fit_at.at_s]
    until_s = min([*ends, run.arrivals[-1].at_s]) - 0.2
    sent = [
        message
        for one in run.of(wire.Estimate)
        if isinstance(message := one.frame.message, wire.Estimate)
        and message.axis == fit.axis
        and one.at_s < until_s
    ]
    tracked = [one for one in sent if one.flags & wire.EstimateFlags.TRACKED]
    untracked = [one for one in sent if not one.flags & wire.EstimateFlags.TRACKED]
    assert {one[-4:] for one in untracked} == {(0.0,) * 4}
    assert tracked[0].sample - untracked[-1].sample == 10
    # The tracker began at some sample between the last ESTIMATE without bias and the first ESTIMATE with one.
    # The messages do not say at which sample, so the loop tries each.
    wanted = [one[-4:] for one in tracked]
    found = []
    for begin in range(untracked[-1].sample - first + 1, tracked[0].sample - first + 1):
        pc = BoardSpectrum(AHEAD)
        pc.add(counts[: fit.age])
        pc.fit()
        pc.track(counts[:begin])
        pc.retrack()
        after = (pc.track(counts[begin:]).astype(np.float32) / np.float32(16.4)).astype(float)
        found.append([tuple(after[one.sample - first - begin]) for one in tracked] == wanted)
    assert found.count(True) == 1
    return tracked


@pytest.mark.slow
def test_its_fit_has_the_bits_of_a_pc_and_costs_no_sample() -> None:
    # Both faults happen while the board searches for a model, and no sample is lost.
    faults = ("nack_burst at=17.0 count=1", "sda_stuck at=19.3 clocks=5")
    settings = {"estimator.estimate_on": "both"}
    run = DueRun(image(), noise=NOISE, faults=faults, settings=settings).run_until(FIRST_FIT_S)
    assert run.check() is None
    assert (run.stats.sample_counts.lost, run.gaps, run.troubles) == (0, [], [])
    # Freeing the bus delays the sample at 19.3 s by some milliseconds, so it is left out. The refused
    # transfer at 17 s delays its sample by 30 us at most.
    waits = {abs(step - 10_000) for step in steps(run, but_at_s=19.3)}
    assert max(waits) <= 30, "a sample has waited for a fit"
    assert run.of(wire.Status)[-1].frame.message.dropped_frames == 0

    (fit,) = (arrival.frame.message for arrival in run.of(wire.Fit))
    counts = np.array([arrival.frame.message.gyro_x for arrival in run.of(wire.Sample)], dtype=np.int16)
    pc = BoardSpectrum()
    pc.add(counts[STARTUP : STARTUP + fit.age])
    found = pc.fit()
    assert fit.axis == wire.Axis.GYRO_X
    assert (fit.verdict, fit.alpha, fit.alpha_std) == (found.verdict, found.alpha, found.alpha_std)
    ratios = fit.ratio_white, fit.ratio_relaxation, fit.ordinates
    assert ratios == (found.ratio_white, found.ratio_ar1, found.ordinates)

    # The board sends the bins of the fitted spectrum after the FIT, and the host assembles them.
    once, again = (record for record in run.records if isinstance(record, DeviceFits))
    assert once.axes["gyro_x"].host_verdict is not None
    spectrum = again.axes["gyro_x"].spectrum
    assert sum(spectrum.ordinates) == pytest.approx(fit.ordinates, rel=1e-6)
    assert list(spectrum.hz) == sorted(spectrum.hz)
    power = float(np.dot(spectrum.ordinates, np.square(spectrum.density))) / fit.ordinates * 100 / 2
    variance = float(np.var(counts[STARTUP : STARTUP + fit.age] / 16.4))
    assert power == pytest.approx(variance, rel=0.2)

    told = run.of(wire.Fit)[0]
    assert {one.tracker_state for one in track_as_a_pc_does(run, told)} == {0.0}, "it is white"
    newest = [record for record in run.records if isinstance(record, DeviceEstimates)][-1].axes
    assert newest["gyro_y"].tracker_bias is None
    assert newest["gyro_x"].tracker_bias == run.of(wire.Estimate)[-3].frame.message.tracker_bias

    # 6 % of the processor's time is spent on fits. In the emulator, each instruction takes one cycle.
    while_searching = [a.frame.message.cpu_share for a in run.of(wire.Status) if 17 < a.at_s < 24]
    assert len(while_searching) == 7
    assert all(2000 < share < 2400 for share in while_searching)
    estimator = run.of(wire.Estimator)[-1].frame.message
    assert estimator.skipped == 0
    assert 300 < estimator.longest_slice < 1200


@pytest.mark.long
def test_at_200_hz_it_fits_too_and_no_sample_waits(tmp_path: Path) -> None:
    fast = build("timer", tmp_path, "FLTEA_RATE_HZ=200")
    run = DueRun(fast, noise="rate_hz=200&alpha=0.5&f=-1&seed=7").run_until(8.4)
    assert run.error is None
    assert steps(run) == {5_000}
    last = run.of(wire.Estimator)[-1].frame.message
    assert last.skipped == 0
    assert (last.fit_every, last.longest_slice > 300) == (600, True)


@pytest.mark.long
def test_a_build_that_tunes_hands_its_fit_to_its_filters(tmp_path: Path) -> None:
    tuned = build("timer", tmp_path, "FLTEA_TUNED=true")
    noise = "alpha=0.8&f=-1&R=0.0001&seed=7"
    run = DueRun(tuned, noise=noise, settings={"estimator.estimate_on": "both"}).run_until(25.5)
    assert run.error is None
    fits = run.of(wire.Fit)
    assert [arrival.frame.message.flags & wire.FitFlags.TUNED > 0 for arrival in fits] == [True]
    fit = fits[0].frame.message
    for arrival in run.of(wire.Estimate):
        message = arrival.frame.message
        is_tuned = message.axis == fit.axis and arrival.at_s > fits[0].at_s + 0.3
        if arrival.at_s < fits[0].at_s - 0.3 or message.axis != fit.axis or is_tuned:
            assert (message.flags & wire.EstimateFlags.TUNED > 0) == is_tuned
    assert run.of(wire.Estimator)[-1].frame.message.r_x == fit.r
    tracked = track_as_a_pc_does(run, fits[0])
    assert len(tracked) > 25
    assert len({one.tracker_state for one in tracked}) > 25
    # The host's fit to the same bins gives the same order as the board's.
    whole = [record for record in run.records if isinstance(record, DeviceFits)][-1].axes["gyro_x"]
    assert whole.spectrum is not None
    assert abs(whole.alpha_of_bins - fit.alpha) < 0.1 * 1.96 * fit.alpha_std
    newest = [record for record in run.records if isinstance(record, DeviceEstimates)][-1].axes
    assert (newest["gyro_x"].why_not, newest["gyro_y"].why_not) == ("other_settings", None)
