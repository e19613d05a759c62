"""The bias tracker in the device stream: the models that it uses, motion, and its saved state."""

import math

import numpy as np
import pytest
from fltea.estimator.offset_walk import offset_walk
from fltea.estimator.tracker import Tracker
from fltea.noise.filters import Mean
from fltea.noise.parts import Alternating, Order, Part, Relaxation, White
from fltea.noise.system import system
from fltea.records.block import Block, TrackedColumns
from fltea.records.events import RawBlock
from fltea.records.fit import AxisFit, Interval, VerdictKind
from fltea.records.records import Corrected, CorrectedAxis, Estimate, Motion, Sample, Stats
from fltea.settings.estimator import EstimatorConfig
from fltea.settings.live import LiveConfig
from fltea.spectrum.live_axes import AxisRefit, Noise
from fltea.stream.live import NO_FIT, AcceptedFit
from fltea.stream.tracking import SensorTracks
from numpy.typing import NDArray

from tests.rig.blocks import of, records_of
from tests.rig.device_stream_support import raw, run_pipeline
from tests.rig.host_support import hello

H = 0.01
LSB_DPS = 1 / 16.4


def pushed(first: int, last: int, counts: int) -> RawBlock:
    """Return samples of a sensor that is turned from sample `first` to sample `last`."""
    still = raw(range(1300))
    gyro = still.gyro.copy()
    gyro[first:last, 0] += counts
    return still._replace(gyro=gyro)


def column(items: list[object], name: str) -> NDArray[np.float64]:
    tracked = [block.tracked[0] for block in of(Block, items)]
    return np.concatenate([getattr(one, name) for one in tracked])


def sensor(bias: float | str = "startup") -> SensorTracks:
    return SensorTracks({"gyro_x": 0}, EstimatorConfig(bias=bias), LiveConfig(), H, "deg/s")


def accepted(
    one: SensorTracks, verdict: VerdictKind, noise: Noise | None = None, before: AcceptedFit = NO_FIT
) -> AcceptedFit:
    refitted = AxisRefit(AxisFit(verdict, "", "deg/s", 1e-9), noise)
    return before.followed_by(refitted, one.maker("gyro_x"))


def test_each_sample_has_its_bias_from_the_sixteenth_on() -> None:
    items, _ = run_pipeline([hello(), raw(range(1300))], live__on=False)
    bias, std = column(items, "bias"), column(items, "bias_std")
    assert np.isnan(bias[:15]).all()
    assert np.isfinite(bias[16:]).all()
    truth = np.array([3, -40, 0]) * LSB_DPS
    assert (np.abs(bias[-1] - truth) < 3 * std[-1]).all()
    assert (std[-1] < 0.3 * 8 * LSB_DPS).all()


@pytest.mark.parametrize("part", [Mean(10), Order(0.0, -0.5, 0.01)], ids=str)
def test_whatever_a_fit_finds_is_tracked_or_leaves_what_was(part: Part) -> None:
    one, y = sensor(), np.random.default_rng(1).standard_normal((1000, 1))
    one.run(y)
    one.use_model("gyro_x", accepted(one, "white", Noise((White(1.0), part), drifts=False, samples=1000)))
    assert np.isfinite(one.run(y).bias).all()


def test_in_motion_it_predicts_and_at_rest_it_goes_on() -> None:
    items, pipeline = run_pipeline([hello(), pushed(700, 900, 4000)])
    moving, bias, std = (column(items, name)[:, 0] for name in ("moving", "bias", "bias_std"))
    assert moving[700:900].all()
    assert not moving[:700].any()
    assert not moving[1000:].any()
    assert abs(bias[899] - bias[699]) < 3 * std[699]
    assert std[899] >= std[640]
    assert abs(bias[-1] - 3 * LSB_DPS) < 3 * std[-1]
    stats = pipeline.stats().axes["gyro_x"].tracker
    assert stats is not None
    assert stats.moved == moving.sum()
    other = pipeline.stats().axes["gyro_y"].tracker
    assert other is not None
    assert other.moved == stats.moved  # all axes of a sensor move together
    begun, ended = of(Motion, items)
    assert (begun.begins, begun.by, begun.samples) == (True, "gyro_x", None)
    assert abs(begun.seq - 700) <= 64
    assert (ended.begins, ended.by) == (False, "gyro_x")
    assert ended.samples is not None
    assert ended.samples == ended.seq - begun.seq + 1


def test_a_given_bias_is_the_offset() -> None:
    items, _ = run_pipeline([hello(), raw(range(1300))], estimator__bias=[3 * LSB_DPS, -40 * LSB_DPS, 0.0])
    state, bias = column(items, "state"), column(items, "bias")
    assert np.allclose(bias[20:] - state[20:], np.array([3, -40, 0]) * LSB_DPS)


def test_a_saved_tracker_goes_on_to_the_bit() -> None:
    y = raw(range(1300)).gyro / 16.4
    whole, first, second = (Tracker([None] * 3) for _ in range(3))
    expected = whole.run(y)
    first.run(y[:700])
    second.load(first.save())
    for found, known in zip(second.run(y[700:]), expected, strict=True):
        np.testing.assert_array_equal(found, known[700:])


def test_a_walk_goes_on_from_what_the_pipeline_saved() -> None:
    whole, _ = run_pipeline([hello(), raw(range(1300))], prompt=False, live__on=False)
    _, pipeline = run_pipeline([hello(), raw(range(700))], prompt=False, live__on=False)
    rest, _ = run_pipeline([hello(), raw(range(700, 1300))], pipeline.save(), prompt=False, live__on=False)
    expected, found = column(whole, "bias")[700:], column(rest, "bias")
    # The biases of the later run may differ a little. The pipeline computes from the times how many samples
    # are missing since the snapshot. It may find one, and then the tracker predicts over this sample.
    assert np.allclose(found, expected, atol=0.05 * column(whole, "bias_std")[700:].max())


@pytest.mark.parametrize(
    ("kinds", "stands"),
    [
        (["white"], None),
        (["white", "white"], "white"),
        (["drift", "fractional", "drift", "fractional"], None),
        (["white", "white", "drift"], "white"),
        (["white", "white", "drift", "drift"], "drift"),
        (["too few samples", "too few samples"], None),
    ],
)
def test_a_verdict_stands_once_two_fits_agree(kinds: list[VerdictKind], stands: str | None) -> None:
    one, found = sensor(), NO_FIT
    for kind in kinds:
        found = accepted(one, kind, before=found)
    assert (found.stands.verdict if found.stands else None) == stands


def test_what_stands_is_what_the_columns_say() -> None:
    one = sensor()
    one.use_model(
        "gyro_x",
        accepted(one, "fractional")._replace(stands=AxisFit("fractional", "", "deg/s", alpha=Interval(0.5))),
    )
    found = one.run(np.zeros((3, 1)) + np.arange(3)[:, None])
    assert isinstance(found, TrackedColumns)
    assert (found.verdict, found.alpha) == (("fractional",), (Interval(0.5),))


def drifting(n: int, step: float) -> NDArray[np.float64]:
    rng = np.random.default_rng(4)
    return np.asarray(np.cumsum(rng.normal(0, step, n)) + rng.normal(0, 0.14, n))[:, None]


def test_a_short_fit_counts_only_if_it_makes_the_samples_much_likelier_than_the_walks_do() -> None:
    one, a, y = sensor(), math.exp(-H / 0.03), drifting(1000, 0.0)
    for k in range(1, len(y)):
        y[k] -= a * y[k - 1]
    one.run(y)
    one.use_model("gyro_x", accepted(one, "white", Noise((White(float(y.var())),), False, 1000)))
    assert dict(one.stats())["gyro_x"].model == "walks"
    alternating = Noise((White(1e-4), Alternating(float(y.std()), 0.03)), False, 1000)
    one.use_model("gyro_x", accepted(one, "undecided", alternating))
    assert dict(one.stats())["gyro_x"].model != "walks"


def test_a_mean_of_samples_is_a_noise_that_it_can_go_by() -> None:
    """A mean of samples is a model that the tracker can use. The number of averaged samples is an integer and
    must not be rounded like a measured figure.
    """
    one = sensor()
    one.run(drifting(4000, 0.0))
    one.use_model("gyro_x", accepted(one, "low-pass", Noise((White(0.02), Mean(4)), False, 4000)))
    assert dict(one.stats())["gyro_x"].model != "walks"


def test_an_offset_walks_where_the_fit_has_no_part_for_it() -> None:
    one = sensor()
    y = drifting(6000, 0.001)
    found = one.run(y)
    one.use_model("gyro_x", accepted(one, "white", Noise((White(0.02),), False, 6000)))
    stats = dict(one.stats())["gyro_x"]
    K = stats.K
    # The heading's error has two parts. White noise makes the angle walk by 0.14 deg/s √(0.01 s · 60 s) =
    # 0.11 deg, and the drift of the bias adds more.
    assert 0.11 < stats.heading_std[60] < 5
    assert sorted(stats.heading_std.values()) == [*stats.heading_std.values()], "it grows"
    assert (stats.bias, stats.bias_std) == (found.bias[-1, 0], found.bias_std[-1, 0])
    assert K.low is not None
    assert K.high is not None
    assert K.low < 0.001 / math.sqrt(H) < K.high
    assert K.high < 30 * K.low


def test_a_constant_offset_does_not_walk() -> None:
    tracker = Tracker([None])
    tracker.run(drifting(6000, 0.0))
    found = offset_walk(system((White(0.0196),), H, 6000), 6000, tracker.remembered(0))
    assert not found.is_certain
    assert found.K(H) == Interval()


def test_a_model_that_is_the_same_is_not_made_again(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[int] = []
    use_model = Tracker.use_model
    monkeypatch.setattr(
        Tracker, "use_model", lambda self, lane, model: (made.append(lane), use_model(self, lane, model))
    )
    one = sensor()
    one.run(drifting(4000, 0.0))
    known = NO_FIT
    for samples, sigma in ((4000, 0.1), (4400, 0.101), (4400, 0.12), (9000, 0.12)):
        noise = Noise((White(0.02), Relaxation(sigma, 0.5)), False, samples)
        known = accepted(one, "relaxations", noise, known)
        one.use_model("gyro_x", known)
    assert len(made) == 3


def test_without_a_live_fit_the_walks_go_on() -> None:
    items, pipeline = run_pipeline([hello(), raw(range(1300))], live__on=False)
    stats = pipeline.stats()
    assert isinstance(stats, Stats)
    tracker = stats.axes["gyro_x"].tracker
    assert tracker is not None
    assert tracker.model == "walks"
    assert np.isfinite(column(items, "bias")[-1]).all()


def test_corrected_rates_are_samples_less_their_biases() -> None:
    items, _ = run_pipeline([hello(), pushed(700, 900, 4000)], output__corrected=True, output__every=3)
    records = records_of(items)
    found = of(Corrected, records)
    samples = {one.seq: one for one in of(Sample, records)}
    assert [one.seq for one in found] == list(range(0, 1300, 3))
    assert found[0].axes["gyro_x"] == CorrectedAxis(None, None, False)
    for one in found:
        assert list(one.axes) == ["gyro_x", "gyro_y", "gyro_z"]
    estimates = {one.seq: one for one in of(Estimate, records)}
    for seq, estimate in estimates.items():
        x, axis = next(one for one in found if one.seq == seq).axes["gyro_x"], estimate.axes["gyro_x"]
        assert axis.bias is not None
        assert (x.rate, x.rate_std) == (samples[seq].gyro_dps[0] - axis.bias, axis.bias_std)
    turned = next(one for one in found if one.seq == 801).axes["gyro_x"]
    assert turned.moving
    assert turned.rate == pytest.approx(4000 * LSB_DPS, abs=10 * LSB_DPS)


def test_without_being_asked_for_there_are_no_corrected_rates() -> None:
    items, _ = run_pipeline([hello(), raw(range(300))])
    assert not of(Corrected, records_of(items))
