"""The live fit tunes FLTEA's filters. Tests which values the filters get from a fit, and from which sample
on.
"""

from typing import Literal

import msgspec
import numpy as np
import pytest
from fltea.estimator.bank import Bank, Variances
from fltea.estimator.filter_model import FilterModel
from fltea.records.block import Block
from fltea.records.events import RawSample, block_of
from fltea.records.fit import AxisFit, FitHighPass, FitLowPass, Interval
from fltea.records.records import Estimate, Fit
from fltea.settings.estimator import EstimatorConfig
from fltea.settings.live import LiveConfig
from fltea.sources.synthetic import NoiseGenerator, parse_noise
from fltea.spectrum.evidence import ANYTIME_LEVEL
from fltea.spectrum.live_axes import LiveAxes
from fltea.stream import live
from fltea.stream.tuning import handed_over
from hypothesis import given
from hypothesis import strategies as st

from tests.rig.blocks import ndjson, of, records_of
from tests.rig.device_stream_support import raw, run_pipeline
from tests.rig.host_support import hello
from tools.validation.evaluate.cases import Case, H, samples

KNOWN = AxisFit(
    "fractional",
    "",
    "deg/s",
    1e-9,
    alpha=Interval(0.80041, 0.6, 0.9),
    f=Interval(-1.0, -2.0, 0.5),
    F=Interval(0.775, 0.7, 0.85),
    s2=Interval(0.010004, 0.008, 0.012),
    R=Interval(0.02, 0.018, 0.022),
)
TUNED = {"estimator__tuning": "live"}


def with_(**changes: Interval) -> AxisFit:
    return msgspec.structs.replace(KNOWN, **changes)


def test_s2_and_r_are_handed_over_to_three_digits() -> None:
    """A fit gives the filters the variances s2 (of what drives the state) and R (of the white noise), rounded
    to three digits, and its order.

    It also gives α, f and F with standard deviations, computed from the wider side of each 95 % interval.
    """
    filter_model = FilterModel(0.8, 0.102, 0.775, 0.0383, -1.0, 0.765)
    assert handed_over(KNOWN, None) == (Variances(0.01, 0.02), filter_model)
    # Wide intervals of s2 and R do no harm. They are usual, since a smaller state in more white noise has
    # nearly the same spectrum.
    open_ = with_(s2=Interval(0.01, 0.001, 0.1), R=Interval(0.02, 0.0, None))
    assert handed_over(open_, None) == (Variances(0.01, 0.02), filter_model)
    assert handed_over(with_(R=Interval(0.0, 0.0, 0.01)), None) == (Variances(0.01, 1e-5), filter_model)


@pytest.mark.parametrize(
    "unknown",
    [
        Interval(0.7),
        Interval(0.7, None, 0.8),
        Interval(0.7, 0.6),
        Interval(None, 0.6, 0.8),
        Interval(float("inf"), 0.6, float("inf")),
        Interval(float("nan"), float("nan"), float("nan")),
    ],
    ids=str,
)
def test_what_is_not_known_well_enough_is_not(unknown: Interval) -> None:
    for name in ("alpha", "f", "F"):
        assert handed_over(with_(**{name: unknown}), None) is None
    assert handed_over(with_(alpha=Interval(0.8, 0.49, 0.85)), None) is None, "known to ± 0.31"
    assert handed_over(with_(alpha=Interval(2.1, 2.0, 2.2)), None) is None, "no filter goes so far"
    for value in (None, float("inf"), float("nan")):
        assert handed_over(with_(s2=Interval(value)), None) is None
        assert handed_over(with_(R=Interval(value)), None) is None
    assert handed_over(msgspec.structs.replace(KNOWN, low_pass=FitLowPass(20.0, 2.0)), None) is None
    assert handed_over(msgspec.structs.replace(KNOWN, high_pass=FitHighPass(0.1, 1.0)), None) is None


@given(st.floats(0.8, 1.25), st.floats(0.8, 1.25))
def test_what_has_moved_by_less_than_a_tenth_of_its_interval_stays(s2: float, R: float) -> None:
    before = Variances(0.010004 * s2, 0.02 * R)
    moved = abs(0.010004 - before.Q) > 0.1 * 0.004 or abs(0.02 - before.R) > 0.1 * 0.004
    assert (handed_over(KNOWN, before) is not None) == moved


@pytest.mark.parametrize("variant", ["joint", "triple"])
def test_a_fit_tunes_from_the_sample_after_it_on(variant: str) -> None:
    """A fit changes the filters' settings from the sample after the fit on.

    The estimates equal those of filters whose settings the test itself changes at that sample.
    """
    items, pipeline = run_pipeline([hello(), raw(range(830))], estimator__variant=variant, **TUNED)
    found = {r.seq: r.axes for r in of(Estimate, records_of(items))}
    by_hand = run_pipeline([hello()], estimator__variant=variant)[1]._config.estimator
    bank = Bank(("gyro_x", "gyro_y", "gyro_z"), by_hand, 0.01, 1 / 16.4)
    y = raw(range(830)).gyro / 16.4
    bank.run(y[:20])
    at, details = 20, 0
    for place, fit in enumerate(items):
        if not isinstance(fit, Fit):
            continue
        sample = items[place - 1]
        assert isinstance(sample, Block)
        end = int(sample.seq[-1]) + 1
        columns = bank.run(y[at:end])
        for row, seq in enumerate(range(at, end)):
            published = [(axis.fltea.alpha, axis.fltea.state) for axis in found[seq].values()]
            expected = np.column_stack([columns.alpha[row], columns.x[row]])
            np.testing.assert_array_equal(np.array(published, dtype=np.float64), expected)
        at = end
        for axis, one in fit.axes.items():
            before = bank.variances[axis] if axis in bank.tuned else None
            handed = handed_over(one, before)
            assert one.null_p is not None
            if one.null_p < ANYTIME_LEVEL and handed is not None:
                bank.retune({axis: handed.variances}, {axis: handed.filter_model})
                details += 1
    assert details > 3
    for axis, stats in pipeline.stats().axes.items():
        assert bank.variances[axis] == (stats.Q_in_use, stats.R_in_use)
        assert stats.tuned == (axis in bank.tuned)


@pytest.mark.parametrize("tuning", ["live", "startup"])
def test_an_axis_is_settled_once_it_is_tuned_if_it_is_to_be_and_its_innovations_are_white(
    tuning: str,
) -> None:
    items, pipeline = run_pipeline([hello(), raw(range(900))], estimator__tuning=tuning)
    columns = [one.estimates[0] for one in items if isinstance(one, Block) and one.estimates]
    accepted = np.concatenate([one.settled for one in columns])
    assert not accepted[:199].any()
    tuned = [one.tuned for one in pipeline.stats().axes.values()]
    bank = Bank(("gyro_x", "gyro_y", "gyro_z"), pipeline._config.estimator, 0.01, 1 / 16.4)
    if tuning == "startup":
        y = raw(range(900)).gyro / 16.4
        bank.run(y[:20])
        np.testing.assert_array_equal(accepted, bank.run(y[20:]).white)
        assert accepted.any()
    else:
        assert any(tuned)
        assert (accepted.any(axis=0) <= tuned).all()
        assert accepted[-1].any()


@pytest.mark.slow
@pytest.mark.parametrize("variant", ["joint", "triple"])
def test_tuned_filters_know_how_sure_they_are(variant: Literal["joint", "triple"]) -> None:
    """Twelve axes have a noise with α = 0.5 and f = -2, in white noise of the same power.

    The samples hardly tell how much of the power is white.
    """
    case, axes = Case(0.5, -2.0, 1.0), tuple(f"axis {i}" for i in range(12))
    y = samples(case, len(axes), 25_000)
    bank = Bank(axes, EstimatorConfig(variant=variant), H, None)
    fits = LiveAxes(axes, H, LiveConfig(), "deg/s")
    bank.run(y[:500])
    fits.add(y[:500])
    for begin in range(500, len(y), 1500):
        rows = y[begin : begin + 1500]
        found = bank.run(rows)
        fits.add(rows)
        for axis, refit in fits.refits(curves=False, fresh=True).items():
            handed = handed_over(refit().fit, bank.variances[axis] if axis in bank.tuned else None)
            if handed is not None:
                bank.retune({axis: handed.variances}, {axis: handed.filter_model})
    assert bank.tuned == set(axes)
    for value, std, truth in ((found.alpha, found.alpha_std, 0.5), (found.f, found.f_std, -2.0)):
        assert np.count_nonzero(np.abs(value[-1] - truth) <= 1.96 * std[-1]) >= 10


def test_by_default_the_filters_are_as_at_the_start() -> None:
    _, pipeline = run_pipeline([hello(), raw(range(800))], estimator__tuning="startup")
    for one in pipeline.stats().axes.values():
        assert (one.Q_in_use, one.tuned) == (0.15, False)


def test_without_a_fit_nothing_is_tuned() -> None:
    _, pipeline = run_pipeline([hello(), raw(range(400))], live__on=False, **TUNED)
    assert not any(one.tuned for one in pipeline.stats().axes.values())


def test_a_saved_walk_goes_on_tuned() -> None:
    _, pipeline = run_pipeline([hello(), raw(range(800))], **TUNED)
    before = pipeline.stats().axes
    assert any(one.tuned for one in before.values())
    _, after = run_pipeline([hello(), raw(range(820, 830))], pipeline.save(), **TUNED)
    for axis, one in after.stats().axes.items():
        then = before[axis]
        assert (one.Q_in_use, one.R_in_use, one.tuned) == (then.Q_in_use, then.R_in_use, then.tuned)


@pytest.mark.long
def test_a_replay_at_full_speed_tunes_and_estimates_as_the_run_did() -> None:
    """A replay at full speed gives the same fits and estimates as the run did. The test makes real fits:
    eighty that are published, and forty that tune the filters.
    """
    generator = NoiseGenerator(parse_noise("alpha=0.8&f=-1&Q=20&R=0.004&seed=7"))
    rows = [tuple(map(int, generator.step())) for _ in range(9020)]
    block = block_of([RawSample(k, k * 10_000, k * 10_000_000, row) for k, row in enumerate(rows)])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(live, "LiveAxes", LiveAxes)
        (run, a), (replay, _), (alone, b) = (
            run_pipeline([hello(), block], prompt=prompt, watched=watched, **TUNED)
            for prompt, watched in ((True, True), (False, True), (False, False))
        )
    assert len(of(Fit, run)) > 80
    assert ndjson(records_of(replay)) == ndjson(records_of(run))
    assert len(of(Fit, alone)) < 45
    assert of(Estimate, records_of(alone)) == of(Estimate, records_of(run))
    assert a.stats().axes == b.stats().axes
    assert any(one.tuned for one in a.stats().axes.values())
