"""The whole pipeline on made-up events: which records come out, in which order, and what is counted."""

import random
from pathlib import Path

import msgspec
import numpy as np
import pytest
from fltea.estimator.lane_settings import LaneSettings
from fltea.records.errors import UsageError
from fltea.records.events import Event, LinkDown, RawSample, Tick, Trouble
from fltea.records.records import AnyRecord, Epoch, Error, Estimate, Gap, Hello, Sample, Stats
from fltea.records.stats import DeviceStatus
from fltea.sources.replay import ReplaySource
from fltea.stream.pipeline import Pipeline

from tests.rig.blocks import as_block, of, records_of
from tests.rig.device_stream_support import Source, small_config
from tests.rig.engine_cases import ESTIMATES, reference_run

PERIOD_NS = 10**7
PRINTED = {"estimator__guard": "off", "estimator__variant": "triple"}


UNIX_OFFSET_NS = 1_000_000_000_000


def pipeline_of(**changes: object) -> Pipeline:
    return Pipeline(Source(unix_offset_ns=UNIX_OFFSET_NS), small_config(**{"link__max_gap": 100} | changes))


def hello(boot_id: int = 1, lsb: float | None = 16.4, sensor_starts: int = 1) -> Hello:
    return Hello(
        "test", 0, 100.0, "timer", boot_id=boot_id, gyro_lsb_per_dps=lsb, sensor_starts=sensor_starts
    )


def raw(k: int, gyro: tuple[float, ...] | None = None) -> RawSample:
    noise = random.Random(k)
    gyro = gyro or tuple(round(noise.gauss(0, 2)) for _ in range(3))
    return RawSample(k % 65536, k * 10_000 % 2**32, k * PERIOD_NS, gyro)


def feed(pipeline: Pipeline, *events: Event | RawSample) -> list[AnyRecord]:
    """Return the records for these events; each sample is in a block by itself."""
    blocks = [as_block(event) if isinstance(event, RawSample) else event for event in events]
    return records_of(item for event in blocks for item in pipeline.feed(event))


def test_order_of_records_and_first_estimate_after_the_startup_window() -> None:
    pipeline = pipeline_of()
    records = feed(pipeline, hello(), *(raw(k) for k in range(20)))
    assert [type(r).__name__ for r in records] == ["Hello", "Epoch"] + ["Sample"] * 20
    assert [(r.seq, r.gyro_dps) for r in of(Sample, records)] == [
        (k, tuple(g / 16.4 for g in raw(k).gyro)) for k in range(20)
    ]
    epoch, stats = records[1], pipeline.stats()
    records = feed(pipeline, *(raw(k) for k in range(20, 25)))
    assert [type(r).__name__ for r in records] == ["Sample", "Estimate"] * 5
    first = records[1]
    assert isinstance(epoch, Epoch)
    assert isinstance(first, Estimate)
    assert (epoch.epoch, epoch.reason, epoch.seq) == (1, "start", 0)
    assert first.seq == 20
    assert stats.startup_remaining == 0
    assert stats.link.frames == 7
    assert stats.axes["gyro_x"].R_in_use is not None
    assert first.host_ns == UNIX_OFFSET_NS + 20 * PERIOD_NS


@pytest.mark.parametrize(("n", "said"), [(0, []), (12, ["needs 8 more samples"]), (20, [])])
def test_an_end_within_the_startup_window_is_told(n: int, said: list[str]) -> None:
    pipeline = pipeline_of()
    feed(pipeline, hello(), *(raw(k) for k in range(n)))
    errors = of(Error, records_of(pipeline.finish(whole=True)))
    assert [error.kind for error in errors] == ["too_short"] * len(said)
    assert all(text in error.message for text, error in zip(said, errors, strict=True))
    assert of(Error, records_of(pipeline.finish())) == []


def test_a_short_gap_is_bridged_in_the_same_epoch() -> None:
    events = [raw(k) for k in range(60) if not 30 <= k < 35]
    pipeline = pipeline_of()
    records = feed(pipeline, hello(), *events)
    assert of(Gap, records) == [Gap(30, 5, 1, UNIX_OFFSET_NS + 35 * PERIOD_NS, device="due")]
    assert len(of(Epoch, records)) == 1
    assert [e.seq for e in of(Estimate, records)] == [*range(20, 30), *range(35, 60)]
    samples = pipeline.stats().sample_counts
    assert (samples.delivered, samples.lost, samples.gaps) == (55, 5, 1)


def test_a_long_gap_begins_a_new_epoch_with_a_new_startup_window() -> None:
    events = [raw(k) for k in range(100) if not 30 <= k < 50]
    records = feed(pipeline_of(link__max_gap=19), hello(), *events)
    assert [(g.seq, g.missing, g.epoch) for g in of(Gap, records)] == [(30, 20, 1)]
    assert [(e.epoch, e.reason, e.seq) for e in of(Epoch, records)] == [(1, "start", 0), (2, "gap", 50)]
    assert [e.seq for e in of(Estimate, records) if e.epoch == 2] == list(range(70, 100))
    kinds = [type(r) for r in records]
    assert kinds.index(Gap) < len(kinds) - 1 - kinds[::-1].index(Epoch)


def test_a_restart_begins_anew_and_says_hello_once_a_boot() -> None:
    first = [hello(1), raw(0), hello(1), raw(1)]
    second = [hello(2), *(raw(k) for k in range(25))]
    records = feed(pipeline_of(), *first, *second)
    assert [h.boot_id for h in of(Hello, records)] == [1, 2]
    assert [(e.reason, e.boot_id) for e in of(Epoch, records)] == [("start", 1), ("restart", 2)]
    assert all(e.epoch == 2 for e in of(Estimate, records))


@pytest.mark.parametrize("sensor_starts", [1, 2])
def test_a_recorded_discontinuity_replays_with_nothing_lost(tmp_path: Path, sensor_starts: int) -> None:
    """In the live run, the sample that shows a discontinuity of time is dropped, and a HELLO follows.

    The recording (NDJSON) has neither this sample nor this HELLO.
    """
    late = [raw(k)._replace(device_us=(k * 10_000 + 7_000_000) % 2**32) for k in range(60, 100)]
    after = hello(sensor_starts=sensor_starts)
    events = [hello(), *(raw(k) for k in range(60)), after, late[0], after, *late[1:]]
    live = feed(pipeline_of(), *events)
    assert [(e.reason, e.seq) for e in of(Epoch, live)] == [("start", 0), ("discontinuity", 61)]
    path = tmp_path / "live.ndjson"
    path.write_bytes(b"".join(msgspec.json.encode(r) + b"\n" for r in live))
    source = ReplaySource(path)
    again = feed(Pipeline(source, small_config()), *source.events())
    assert [(e.reason, e.seq) for e in of(Epoch, again)] == [("start", 0), ("discontinuity", 61)]
    assert [(e.seq, e.axes) for e in of(Estimate, again)] == [(e.seq, e.axes) for e in of(Estimate, live)]


def test_after_link_down_nothing_is_believed_before_hello() -> None:
    pipeline = pipeline_of()
    feed(pipeline, hello(), raw(0), raw(1), LinkDown(2 * PERIOD_NS))
    assert feed(pipeline, raw(2), raw(3)) == []
    records = feed(pipeline, hello(), raw(4))
    assert [type(r).__name__ for r in records] == ["Hello", "Gap", "Sample"]
    assert pipeline.stats().sample_counts.before_hello == 2


def test_a_constant_axis_is_invalid_and_the_others_go_on() -> None:
    events = [
        raw(k, (random.Random(k).gauss(0, 0.1), 0.25, random.Random(k).gauss(0, 0.2))) for k in range(30)
    ]
    pipeline = pipeline_of()
    records = feed(pipeline, hello(lsb=None), *events)
    assert [e.kind for e in of(Error, records)] == ["constant_axis"]
    assert "gyro_y" in of(Error, records)[0].message
    for estimate in of(Estimate, records):
        assert [estimate.axes[a].fltea.valid for a in ("gyro_x", "gyro_y", "gyro_z")] == [True, False, True]
        assert estimate.axes["gyro_y"].fltea.alpha is None
    last = pipeline.stats().axes
    assert last["gyro_y"].R_in_use is None
    assert last["gyro_x"].R_in_use is not None


def test_divergence_is_published_as_null_and_counted_never_as_nan() -> None:
    """An offset of a few deg/s that is not removed makes the algorithm of the paper diverge."""
    pipeline = pipeline_of(estimator__bias="none", estimator__R=1e-4, **PRINTED)
    events = [raw(k, tuple(g + 500 for g in raw(k).gyro)) for k in range(400)]
    records = feed(pipeline, hello(), *events)
    lines = msgspec.json.encode(records)
    assert b"NaN" not in lines
    assert b"Infinity" not in lines
    invalid = [e for e in of(Estimate, records) if not e.axes["gyro_x"].fltea.valid]
    assert invalid, "this case is there to diverge"
    assert all(v is None for e in invalid for v in msgspec.structs.astuple(e.axes["gyro_x"].fltea)[:6])
    assert pipeline.stats().axes["gyro_x"].restarts == len(invalid)
    details = [e for e in of(Error, records) if e.kind == "axis_runaway"]
    assert len(details) == 3, "each axis once a minute"
    for error in details:
        sample, estimate = [r for r in records[: records.index(error)] if not isinstance(r, Error)][-2:]
        assert isinstance(sample, Sample)
        assert isinstance(estimate, Estimate)
        assert not estimate.axes[error.message.split()[0]].fltea.valid
        assert error.host_ns == estimate.host_ns == sample.host_ns


def test_every_estimate_names_its_variant_and_every_epoch_its_estimator() -> None:
    for settings in (
        {"memory": "direct", "variant": "triple", "guard": "off"},
        {"memory": "direct", "variant": "joint"},
        {},
    ):
        changes = {f"estimator__{key}": value for key, value in settings.items()}
        chosen = small_config(**changes).estimator
        records = feed(pipeline_of(**changes), hello(), *(raw(k) for k in range(30)))
        assert {e.variant for e in of(Estimate, records)} == {chosen.variant}
        info = of(Epoch, records)[0].estimator
        expected = ("host", chosen.memory, chosen.variant, chosen.guard)
        assert (info.estimate_on, info.memory, info.variant, info.guard) == expected


@pytest.mark.parametrize(("memory", "tolerance"), [("direct", 1e-10), ("compressed", 1e-5)])
def test_the_walk_gives_the_estimates_of_the_reference(memory: str, tolerance: float) -> None:
    lost = (100, 101, 200)
    changes = {"estimator__memory": memory, **PRINTED}
    pipeline, estimator = pipeline_of(**changes), small_config(**changes).estimator
    records = feed(pipeline, hello(), *(raw(k) for k in range(300) if k not in lost))
    found, first = of(Estimate, records), estimator.startup_needed
    assert [one.seq for one in found] == [k for k in range(first, 300) if k not in lost]
    samples = {sample.seq: sample.gyro_dps for sample in of(Sample, records)}
    y = np.array([samples.get(k, (np.nan,) * 3) for k in range(first, 300)])
    for i, (axis, stats) in enumerate(pipeline.stats().axes.items()):
        settings = LaneSettings(estimator, 0.01, stats.R_in_use)
        missing = np.isnan(y[:, i])
        expected = reference_run(settings, y[:, i] - stats.bias, np.zeros(len(y)), missing)
        ours = [(one.alpha, one.f, one.state) for one in (e.axes[axis].fltea for e in found)]
        theirs = expected[~missing][:, [ESTIMATES.index(name) for name in ("alpha", "f", "x")]]
        np.testing.assert_allclose(ours, theirs, rtol=tolerance, atol=tolerance)


def test_guard_interventions_are_published_by_cause() -> None:
    pipeline = pipeline_of(estimator__R=1e-4, estimator__guard="consistent")
    records = feed(pipeline, hello(), *(raw(k, tuple(50 * g for g in raw(k).gyro)) for k in range(400)))
    assert "axis_bound" in [e.kind for e in of(Error, records)]
    assert pipeline.stats().axes["gyro_x"].interventions["state_bound"] > 100


def test_stats_come_once_a_second_even_when_nothing_else_does() -> None:
    pipeline = pipeline_of()
    records = feed(pipeline, *(Tick(k * 250_000_000) for k in range(21)))
    assert len(of(Stats, records)) == len(records) == 5


def test_stats_go_out_before_the_first_event_of_a_new_second() -> None:
    records = feed(pipeline_of(), hello(), *(raw(k) for k in range(50, 350)))
    places = [k for k, record in enumerate(records) if isinstance(record, Stats)]
    after = [records[k + 1] for k in places]
    assert [s.seq for s in of(Sample, after)] == [100, 200, 300]
    assert [records[k].sample_counts.delivered for k in places] == [50, 150, 250]
    assert [records[k].host_ns for k in places] == [one.host_ns for one in after]


@pytest.mark.parametrize("every", [1, 7, 1000])
def test_thinned_are_samples_and_estimates_alike_and_nothing_else(every: int) -> None:
    """With `output.every`, only every n-th sample and estimate is published, also while the start-up window
    fills. The estimates themselves do not change.
    """
    events = [hello(), *(raw(k) for k in range(300) if k not in (100, 101))]
    thin = feed(pipeline_of(output__every=every), *events)
    assert thin == [
        r for r in feed(pipeline_of(), *events) if not isinstance(r, Sample | Estimate) or r.seq % every == 0
    ]


def test_trouble_and_device_counters_are_passed_on() -> None:
    pipeline = pipeline_of()
    status = DeviceStatus(1, 2, 3, 4, 5, "watchdog")
    records = feed(pipeline, Trouble("silent", "text", 5), status)
    assert records == [Error("silent", "text", 5 + UNIX_OFFSET_NS, device="due")]
    assert pipeline.stats().board == status


def test_fixed_bias_and_r_need_no_startup_window() -> None:
    pipeline = pipeline_of(estimator__bias=0.5, estimator__R=[0.1, 0.2, 0.3])
    records = feed(pipeline, hello(), raw(0))
    assert [type(r).__name__ for r in records] == ["Hello", "Epoch", "Sample", "Estimate"]
    axes = pipeline.stats().axes
    assert [a.R_in_use for a in axes.values()] == [0.1, 0.2, 0.3]
    assert [a.bias for a in axes.values()] == [0.5] * 3


def test_settings_that_do_not_fit_the_axes_are_the_users_mistake() -> None:
    pipeline = pipeline_of(estimator__R=[0.1, 0.2])
    with pytest.raises(UsageError, match="R needs one value, or 3"):
        feed(pipeline, hello(), raw(0))
