"""A replay turns a recording into the events that a device would have sent, the same in every run."""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from fltea.records.errors import UsageError
from fltea.records.events import Event, LinkDown, RawSample
from fltea.records.records import AnyRecord, Epoch, Estimate, Gap, Hello, Sample
from fltea.records.stats import SampleStats
from fltea.settings.config import load_config
from fltea.settings.how import How
from fltea.sinks.ndjson import NdjsonSink
from fltea.sources import pacing
from fltea.sources.as_wire import AsWire
from fltea.sources.open_source import open_source
from fltea.sources.replay import ReplaySource
from fltea.sources.synthetic import SyntheticSource
from fltea.stream.decode import Decoder
from fltea.stream.pipeline import Pipeline
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.rig.blocks import in_samples, of, of_samples, records_of, samples_of, track_all, track_events
from tests.rig.host_support import QUICK, fltea_here, hello, strict_records
from tests.rig.mcap_support import SMALL, record
from tools.fed_source import FedSource

NDJSON = b'{"class":"hello","source":"x","host_ns":0,"rate_hz":100,"sampling_mode":"timer"}\n' + b"".join(
    b'{"class":"sample","seq":%d,"device_us":%d,"host_ns":%d,"epoch":1,"gyro_dps":[0.5]}\n'
    % (k, k * 10_000, k * 10_000_000)
    for k in range(300)
)
COUNTS = np.random.default_rng(5).integers(-200, 200, (300, 3)).astype(np.int16)


def npz_file(tmp_path: Path, **changes: object) -> Path:
    path = tmp_path / "rest.npz"
    arrays = {"gyro_raw": COUNTS, "fs_hz": 100.0, "lsb_per_dps": 16.4, **changes}
    np.savez(path, **{name: value for name, value in arrays.items() if value is not None})
    return path


def samples(source: ReplaySource) -> list[RawSample]:
    return samples_of(source.events())


def test_hello_first_then_every_sample(tmp_path: Path) -> None:
    source = ReplaySource(npz_file(tmp_path, accel_raw=np.ones((300, 3)), accel_lsb_per_g=16384.0))
    first, *rest = in_samples(source.events())
    assert (first.rate_hz, first.sampling_mode, first.gyro_lsb_per_dps) == (100.0, "recording", 16.4)
    assert first.boot_id is None
    assert [event.gyro for event in rest] == [tuple(row) for row in COUNTS.tolist()]
    assert [event.sequence for event in rest] == list(range(300))
    assert [event.device_us for event in rest] == [10_000 * k for k in range(300)]
    assert [event.host_ns for event in rest] == [10_000_000 * k for k in range(300)]
    assert {event.accel for event in rest} == {(1.0, 1.0, 1.0)}


def test_host_times_are_those_of_the_recording(tmp_path: Path) -> None:
    arrivals_s = 1e6 + np.sort(np.random.default_rng(1).random(300)) * 2.99
    found = samples(ReplaySource(npz_file(tmp_path, t_host_s=arrivals_s)))
    assert found[0].host_ns == 0
    assert [raw.host_ns for raw in found] == pytest.approx((arrivals_s - arrivals_s[0]) * 1e9, abs=2)
    assert [raw.device_us for raw in found] == [10_000 * k for k in range(300)]


def test_sequence_and_time_wrap_as_a_devices_do(tmp_path: Path) -> None:
    n, rate_hz = 70_000, 10.0  # 7000 s: sequence number and device time each wrap once
    path = npz_file(tmp_path, gyro_raw=None, gyro_dps=np.zeros((n, 1)), fs_hz=rate_hz)
    found = samples(ReplaySource(path))
    assert max(raw.sequence for raw in found) == 65535
    assert (found[65536].sequence, found[-1].sequence) == (0, n - 1 - 65536)
    assert max(raw.device_us for raw in found) < 2**32
    assert found[-1].device_us == (n - 1) * 100_000 - 2**32
    place = Decoder(lambda: 0, 0)
    place.on_hello(Hello("", 0, rate_hz, ""))
    placed = track_all(place, found)
    assert [p.seq for p in placed if p] == list(range(n))
    assert place.counts.lost == 0


# --- times of a CSV file: gaps are counted as gaps, and no sample is rejected ---


def csv_file(tmp_path: Path, times_s: list[float]) -> Path:
    path = tmp_path / "rest.csv"
    rows = [f"{t!r},{k % 7}\n" for k, t in enumerate(times_s)]
    path.write_text("time_s,gyro_x_dps\n" + "".join(rows))
    return path


def walked(source: ReplaySource) -> tuple[SampleStats, list[str]]:
    place, found = track_events(source.events())
    return place, [piece.new_epoch for piece in found if piece.new_epoch]


def test_time_that_a_recording_skips_is_a_gap(tmp_path: Path) -> None:
    times_s = [k * 0.01 for k in range(400) if k not in (50, 51, 52) and not 200 <= k < 350]
    place, reasons = walked(ReplaySource(csv_file(tmp_path, times_s)))
    assert (place.delivered, place.lost, place.gaps) == (247, 153, 2)
    assert reasons == ["start", "gap"]


@pytest.mark.parametrize(
    ("rate_hz", "times_s"),
    [
        # the times are in whole tenths of a ms, so the steps are 0.1 and 0.2 ms
        (8000.0, np.round(np.arange(8000) / 8000, 4)),
        (100.0, np.delete(np.arange(400) / 100, [50, 51, 52])),
        # a pause of 100 s whose cause is unknown
        (100.0, np.arange(400) / 100 + 100 * (np.arange(400) >= 300)),
    ],
    ids=["rounded times", "a gap", "a pause"],
)
def test_times_number_the_samples_of_an_npz_file_as_those_of_a_csv_file(
    rate_hz: float, times_s: np.ndarray, tmp_path: Path
) -> None:
    values = np.arange(len(times_s)) % 7
    npz = npz_file(tmp_path, gyro_raw=None, gyro_dps=values[:, np.newaxis], fs_hz=rate_hz, time_s=times_s)
    csv = csv_file(tmp_path, times_s.tolist())
    (first, *one), (_, *other) = (in_samples(ReplaySource(path).events()) for path in (npz, csv))
    assert first.rate_hz == pytest.approx(rate_hz)
    assert [event[:2] if isinstance(event, RawSample) else event for event in one] == [
        event[:2] if isinstance(event, RawSample) else event for event in other
    ]


def test_an_empty_field_is_a_gap_that_is_told(tmp_path: Path) -> None:
    path = tmp_path / "rest.csv"
    path.write_text("gyro_x_dps\n" + "".join("NaN\n" if k in (7, 8) else f"{k}\n" for k in range(20)))
    _, told, *_ = ReplaySource(path, how=How(rate_hz=100.0)).events()
    assert (told.kind, told.fatal) == ("missing_numbers", False)
    place, reasons = walked(ReplaySource(path, how=How(rate_hz=100.0)))
    assert (place.delivered, place.lost, place.gaps, reasons) == (18, 2, 1, ["start"])


def test_half_an_hour_of_nothing_begins_an_epoch(tmp_path: Path) -> None:
    times_s = [k * 0.01 + (10_000 if k >= 20 else 0) for k in range(40)]
    place, reasons = walked(ReplaySource(csv_file(tmp_path, times_s)))
    assert (place.delivered, place.lost, reasons) == (40, 0, ["start", "restart"])


@given(st.lists(st.floats(2e-6, 5.0), min_size=1, max_size=50), st.sampled_from([1.0, 100.0, 1000.0]))
@settings(max_examples=100)
def test_every_row_is_used_whatever_the_times(
    tmp_path_factory: pytest.TempPathFactory, steps_s: list[float], rate_hz: float | None
) -> None:
    times_s = np.cumsum([0, *steps_s]).tolist()
    place, _ = walked(
        ReplaySource(
            csv_file(tmp_path_factory.getbasetemp(), times_s), how=How(rate_hz=rate_hz, overrule=True)
        )
    )
    assert (place.delivered, place.before_hello) == (len(times_s), 0)


# --- shuffle ---


@given(st.integers(0, 2**32))
@settings(max_examples=20)
def test_shuffle_is_a_permutation_and_times_stay(tmp_path_factory: pytest.TempPathFactory, seed: int) -> None:
    base = tmp_path_factory.getbasetemp()
    path = npz_file(base, accel_raw=COUNTS + 1000, accel_lsb_per_g=16384.0)
    plain, shuffled = samples(ReplaySource(path)), samples(ReplaySource(path, shuffle=seed))
    assert [raw[:3] for raw in shuffled] == [raw[:3] for raw in plain]
    assert [raw.gyro for raw in shuffled] != [raw.gyro for raw in plain]
    assert sorted(raw.gyro for raw in shuffled) == sorted(raw.gyro for raw in plain)
    # shuffling keeps the gyroscope's and accelerometer's values of a sample together
    assert all(raw.accel == tuple(g + 1000 for g in raw.gyro) for raw in shuffled)


def test_shuffle_is_the_seeds_and_says_so(tmp_path: Path) -> None:
    path = npz_file(tmp_path)
    first, again, other = (in_samples(ReplaySource(path, shuffle=seed).events()) for seed in (1, 1, 2))
    assert first == again
    assert first[1:] != other[1:]
    assert "shuffled, seed 1" in first[0].source


# --- what is refused ---

OF_TEXT = r"--(columns|units|rate|topic) is not for .*, which names its columns, its unit and its times"


@pytest.mark.parametrize("kind", ["npz", "ndjson", "mcap"])
@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"how": How(columns=["a"])}, OF_TEXT),
        ({"how": How(units="dps")}, OF_TEXT),
        ({"how": How(rate_hz=1.0)}, OF_TEXT),
        ({"how": How(topic="/imu")}, OF_TEXT),
        ({"shuffle": 1}, r"--shuffle works on \.npz and CSV"),
        ({"startup": 300}, r"300 rows, but the start-up window .* 300 "),
        ({"startup": 301}, r"300 rows, but the start-up window .* 301 "),
    ],
    ids=str,
)
def test_what_does_not_fit_a_kind_is_refused(
    kind: str, options: dict[str, Any], text: str, tmp_path: Path
) -> None:
    path = tmp_path / f"rest.{kind}"
    if kind == "npz":
        npz_file(tmp_path)
    elif kind == "ndjson":
        path.write_bytes(NDJSON)
    else:
        source, encoder = SyntheticSource("?n=300", realtime=False), AsWire(lambda: 0)
        record(path := tmp_path, [item for event in source.events() for item in encoder.encode(event)])
    ReplaySource(path, startup=299)
    if kind == "npz" and "shuffle" in options:
        ReplaySource(path, **options)
        return
    with pytest.raises(UsageError, match=text):
        ReplaySource(path, **options)


def test_missing_file_folder_and_unknown_ending(tmp_path: Path) -> None:
    for name in ("none.npz", "none.mcap"):
        with pytest.raises(UsageError, match="there is no such file"):
            ReplaySource(tmp_path / name)
    with pytest.raises(UsageError, match=r"no \.mcap file in this folder"):
        ReplaySource(tmp_path)
    (tmp_path / "rest.wav").write_bytes(b"RIFF" + bytes(40))
    with pytest.raises(UsageError, match=r"rest\.wav: is a sound or a film, which holds no samples"):
        ReplaySource(tmp_path / "rest.wav")


def test_name_that_is_no_text_is_written_as_far_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "r\udcffst.npz"  # \udcff is Python's form of the byte 0xFF in a file name
    npz_file(tmp_path).rename(path)
    first = next(ReplaySource(path).events())
    assert first.source == f"replay:{tmp_path}/r?st.npz"


@pytest.mark.parametrize("name", ["rest.CSV", "rest.txt", "rest.log", "rest.tsv"])
def test_endings_of_csv(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text("gx\n1\n2\n")
    found = samples(ReplaySource(tmp_path / name, how=How(columns=["gx"], rate_hz=1.0, units="dps")))
    assert [sample.gyro[0] for sample in found] == [1, 2]


# --- our own output ---


@pytest.mark.parametrize("lsb", ["16.4", "0", "131"])
def test_own_output_replays_to_the_same_bits(lsb: str, tmp_path: Path) -> None:
    path = tmp_path / "first.ndjson"
    url = f"synthetic:?n=400&lsb_per_dps={lsb}&offset_dps=-3.3"
    first = fltea_here("run", "-s", url, "--pace", "fast", "--once", "--samples", *QUICK)
    path.write_text(first.stdout)
    second = fltea_here("run", "-s", f"replay:{path}", "--once", "--samples", *QUICK)
    assert (first.returncode, second.returncode) == (0, 0)
    for kind in (Sample, Estimate):
        before, after = (
            [msgspec.structs.replace(r, device="") for r in of(kind, strict_records(run.stdout))]
            for run in (first, second)
        )
        assert len(before) == (400 if kind is Sample else 350)
        assert before == after


# --- pace ---


def test_real_pace_waits_for_each_sample(tmp_path: Path, now_ns: list[int]) -> None:
    for event in ReplaySource(npz_file(tmp_path), realtime=True).events():
        assert now_ns[0] == event.host_ns
    assert now_ns[0] == 299 * 10_000_000


def test_close_ends_a_long_wait(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """`close` ends a long wait of the replay. A signal does not end a call of Python's `sleep`. So
    the replay sleeps for a short time again and again.
    """
    source = ReplaySource(csv_file(tmp_path, [0.0, 600.0, 1200.0]), how=How(overrule=True), realtime=True)
    slept_s: list[float] = []

    def sleep(seconds: float) -> None:
        slept_s.append(seconds)
        source.close()

    monkeypatch.setattr(time, "sleep", sleep)
    assert len(samples(source)) == 1
    assert slept_s == [pacing.SLICE_S]


def test_pace_comes_from_the_configuration(tmp_path: Path) -> None:
    path = npz_file(tmp_path)
    for pace, realtime in (("auto", False), ("fast", False), ("real", True)):
        config = load_config(None, {"source": f"replay:{path}", "pace": pace, "estimator.startup": 9})
        source = open_source(config)
        assert isinstance(source, ReplaySource)
        assert source._realtime is realtime
        assert (source.live, source.unix_offset_ns) == (False, 0)


def live_events() -> Iterator[Event]:
    """Yield live events with lost samples, a lost port or sensor, an overlong gap, a restart, and late
    arrivals.
    """
    rng = np.random.default_rng(3)
    now_ns = 5_000_000_000
    for boot_id, away in (
        (1, {*range(90, 95), *range(140, 180), *range(260, 500)}),
        (2, {33, *range(290, 300)}),
    ):
        yield hello(boot_id=boot_id, host_ns=now_ns)
        for k in (k for k in range(600) if k not in away):
            if k == 180:
                yield LinkDown(now_ns)
                yield hello(boot_id=boot_id, host_ns=now_ns)
            if k == 300 and boot_id == 2:
                yield hello(boot_id=boot_id, sensor_starts=2, host_ns=now_ns)
            arrival_ns = now_ns + k * 10_000_000 + int(rng.exponential(3e6))
            counts = tuple(rng.integers(-9, 9, 3).tolist())
            yield RawSample(k % 65536, k * 10_000, arrival_ns, counts, (0, 0, 16384), -1042, flags=k % 4)
        now_ns += 9_000_000_000


def test_recorded_live_run_replays_to_the_same_bits(tmp_path: Path) -> None:
    path = tmp_path / "live.ndjson"
    port, small = FedSource("/dev/due"), {**SMALL, "samples": True}
    port.wire.unix_offset_ns = 1_700_000_000_123_456_789
    pipeline = Pipeline(port, load_config(None, small))
    live = records_of(item for event in of_samples(live_events()) for item in pipeline.feed(event))
    with path.open("wb") as stream:
        sink = NdjsonSink(stream, samples=True)
        for one in live:
            sink.write(one)
        sink.close()
    config = load_config(None, {**small, "source": str(path)})
    source = open_source(config)
    pipeline = Pipeline(source, config)
    again = records_of(item for event in source.events() for item in pipeline.feed(event))

    def estimates(records: list[AnyRecord]) -> list[tuple[object, ...]]:
        return [(r.epoch, r.seq, r.device_us, r.axes) for r in of(Estimate, records)]

    def breaks(records: list[AnyRecord]) -> list[tuple[object, ...]]:
        return [
            (r.epoch, r.seq, r.reason if isinstance(r, Epoch) else r.missing)
            for r in of(Epoch | Gap, records)
        ]

    assert breaks(live) == [
        (1, 0, "start"),
        (1, 90, 5),
        (1, 140, 40),
        (1, 260, 240),
        (2, 500, "gap"),
        (3, 0, "restart"),
        (3, 33, 1),
        (3, 290, 10),
        (4, 300, "sensor_restart"),
    ]
    assert breaks(again) == breaks(live)
    assert len(estimates(live)) == 195 + 80 + 269 + 280
    assert estimates(again) == estimates(live)
