"""Metrics as Prometheus reads them: over HTTP, with its own parser."""

import http.client
import socket
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator
from typing import Any

import msgspec
import pytest
from blocks import as_items
from fit_support import FRACTIONAL, UNDECIDED, WHITE
from fltea.records.errors import FlteaError, UsageError
from fltea.records.identities import MOST
from fltea.records.ports import LATENCY_BOUNDS_MS, Item, Sink
from fltea.records.records import (
    ACCEL_UNIT,
    AxisEstimate,
    AxisStats,
    DeviceStatus,
    Epoch,
    Error,
    Estimate,
    EstimatorInfo,
    Fit,
    LinkStats,
    Sample,
    SampleStats,
    Stats,
)
from fltea.service.outlet import Outlet
from fltea.settings.config import load_config
from fltea.settings.outputs import MetricsConfig, listen_address
from fltea.sinks.metrics import families as metrics_families
from fltea.sinks.metrics import sink as metrics
from fltea.sinks.metrics.families import Families
from fltea.sinks.metrics.sink import MetricsSink
from host_support import PATIENCE_S, fltea, hello
from hypothesis import given
from hypothesis import strategies as st
from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.parser import text_string_to_metric_families

STATS = Stats(
    epoch=3,
    host_ns=9_500_000_000,
    rate_hz=99.5,
    clock_ppm=-62.5,
    startup_remaining=123,
    link=LinkStats(
        bytes=51,
        frames=41,
        bad_frames={"crc": 2, "cobs": 3},
        unknown_type=4,
        refused=6,
        overflow_bytes=7,
        reconnects=1,
    ),
    samples=SampleStats(delivered=1234, lost=56, gaps=70, duplicates=8, before_hello=9),
    axes={
        "gyro_x": AxisStats(0.1, 0.02, 5, {"order_box": 13, "held": 1}, 0.25, 1.5),
        "accel_z": AxisStats(0.1, 0.02, 2, {}, unit=ACCEL_UNIT),
    },
    board=DeviceStatus(11, 12, 14, 15, 16, "user"),
    device="due",
)
GOOD = AxisEstimate(0.412, 0.031, -2.125, 0.25, 0.1234, -0.0567, True, 0.31, "not rejected")
INVALID = AxisEstimate(None, None, None, None, None, None, False)
ESTIMATE = Estimate(
    7,
    3,
    70_000,
    7,
    "joint",
    {
        "gyro_x": GOOD,
        "gyro_y": INVALID,
        "accel_z": AxisEstimate(0.5, 0.1, -1.0, 0.2, 9.8, 0.0, True, 1e-9, "rejected", ACCEL_UNIT),
    },
    device="due",
)
EPOCH = Epoch(
    4,
    "gap",
    8,
    8,
    8,
    7,
    EstimatorInfo("joint", "host", "compressed", "consistent", 9, 9, "none", "auto"),
    device="due",
)
SAMPLE = Sample(7, 3, 70_000, 7_250_000_000, (0.5,), temperature_c=21.5, device="due")

Labels = frozenset[tuple[str, str]]


def scrape(url: str) -> dict[tuple[str, Labels], float]:
    """Every sample by name and labels."""
    with urllib.request.urlopen(url, timeout=PATIENCE_S) as answer:
        return parse(answer.read().decode())


def parse(text: str) -> dict[tuple[str, Labels], float]:
    found: dict[tuple[str, Labels], float] = {}
    for family in text_string_to_metric_families(text):
        assert family.documentation or family.name.startswith("process_")
        for one in family.samples:
            key = one.name, frozenset(one.labels.items())
            assert key not in found, "Prometheus refuses what comes twice"
            found[key] = one.value
    return found


def value(found: dict[tuple[str, Labels], float], name: str, **labels: str) -> float | None:
    return found.get((name, frozenset(labels.items())))


class Nowhere(Sink):
    name = "nowhere"

    def write(self, item: Item) -> None:
        pass


@pytest.fixture
def serve() -> Iterator[Callable[..., MetricsSink]]:
    started: list[MetricsSink] = []

    def start(
        *records: Any, outlets: Any = list, told: list[str] | None = None, **settings: Any
    ) -> MetricsSink:
        told = [] if told is None else told
        config = MetricsConfig(address="0", **settings)
        sink = MetricsSink(config, outlets, lambda kind, text: told.append(kind))
        started.append(sink)
        for item in as_items(records):
            sink.write(item)
        return sink

    yield start
    for sink in started:
        sink.close()


def port_of(sink: MetricsSink) -> int:
    return int(sink.url.split(":")[2].split("/")[0])


def test_nothing_is_said_of_devices_before_they_speak(serve: Callable[..., MetricsSink]) -> None:
    found = scrape(serve().url)
    names = {name for name, _ in found if not name.startswith("process_")}
    assert names == {"fltea_build_info"}
    assert value(found, "process_resident_memory_bytes")


EXPECTED = {
    "fltea_link_received_bytes_total": 51,
    "fltea_link_frames_total": 41,
    "fltea_link_unknown_frames_total": 4,
    "fltea_link_refused_frames_total": 6,
    "fltea_link_overflow_bytes_total": 7,
    "fltea_link_reconnects_total": 1,
    "fltea_samples_delivered_total": 1234,
    "fltea_samples_lost_total": 56,
    "fltea_gaps_total": 70,
    "fltea_samples_duplicate_total": 8,
    "fltea_samples_before_hello_total": 9,
    "fltea_epochs_total": 3,
    "fltea_sample_rate_hertz": 99.5,
    "fltea_clock_drift_ratio": -62.5e-6,
    "fltea_startup_remaining_samples": 123,
    "fltea_stats_timestamp_seconds": 9.5,
    "fltea_sample_timestamp_seconds": 7.25,
    "fltea_temperature_celsius": 21.5,
    "fltea_board_i2c_errors_total": 11,
    "fltea_board_bus_recoveries_total": 12,
    "fltea_board_sensor_reinits_total": 14,
    "fltea_board_overruns_total": 15,
    "fltea_board_dropped_frames_total": 16,
}


def test_every_figure_under_its_name_and_in_base_units(serve: Callable[..., MetricsSink]) -> None:
    error = Error("silent", "nothing came", 1, device="due")
    found = scrape(serve(hello(device="due"), STATS, SAMPLE, ESTIMATE, error, error).url)
    for name, expected in EXPECTED.items():
        assert value(found, name, device="due") == pytest.approx(expected, rel=1e-12), name
    bad = "fltea_link_bad_frames_total"
    assert value(found, bad, device="due", reason="crc") == 2
    assert value(found, bad, device="due", reason="cobs") == 3
    assert value(found, "fltea_errors_total", device="due", kind="silent") == 2
    x = {"device": "due", "axis": "gyro_x"}
    z = {"device": "due", "axis": "accel_z"}
    assert value(found, "fltea_axis_restarts_total", **x) == 5
    assert value(found, "fltea_axis_restarts_total", **z) == 2
    assert value(found, "fltea_axis_interventions_total", **x, reason="order_box") == 13
    assert value(found, "fltea_axis_innovation_lag1", **x) == 0.25
    assert value(found, "fltea_axis_innovation_nis", **x) == 1.5
    assert value(found, "fltea_axis_innovation_nis", **z) is None
    for name, expected in (
        ("valid", 1),
        ("alpha", 0.412),
        ("alpha_std", 0.031),
        ("f", -2.125),
        ("f_std", 0.25),
        ("null_p", 0.31),
        ("not_white", 0),
    ):
        assert value(found, f"fltea_axis_{name}", **x) == expected
    assert value(found, "fltea_axis_alpha", **z) == 0.5
    assert value(found, "fltea_axis_null_p", **z) == 1e-9
    assert value(found, "fltea_axis_not_white", **z) == 1
    y = {"device": "due", "axis": "gyro_y"}
    assert value(found, "fltea_axis_valid", **y) == 0
    for name in ("alpha", "null_p", "not_white"):
        assert value(found, f"fltea_axis_{name}", **y) is None
    ((_, facts),) = [key for key in found if key[0] == "fltea_device_info"]
    assert dict(facts) == {"device": "due", "source": "test:", "device_id": "a0", "sampling_mode": "timer"}


def test_the_newest_fit_of_every_axis(serve: Callable[..., MetricsSink]) -> None:
    axes = {"gyro_x": FRACTIONAL, "gyro_y": UNDECIDED, "gyro_z": WHITE}
    fit = Fit(999, 1, 1, 8_500_000_000, 1000, axes, device="due")
    found = scrape(serve(hello(device="due"), msgspec.structs.replace(fit, samples=7), fit).url)
    x, y, z = ({"device": "due", "axis": f"gyro_{axis}"} for axis in "xyz")
    for field in ("alpha", "f", "F", "s2", "R"):
        p = getattr(FRACTIONAL, field)
        three = [value(found, f"fltea_fit_{field}{end}", **x) for end in ("", "_low", "_high")]
        assert three == [p.value, p.low, p.high]
    assert value(found, "fltea_fit_alpha", **z) == WHITE.alpha.value
    assert value(found, "fltea_fit_alpha_low", **z) is None
    assert [value(found, "fltea_fit_null_p", **axis) for axis in (x, y, z)] == [1e-40, 1e-9, 0.4]
    assert [value(found, "fltea_fit_until_seconds", **axis) for axis in (x, y, z)] == [0, 440, None]
    assert value(found, "fltea_fit_verdict", **x, verdict="fractional") == 1
    assert value(found, "fltea_fit_verdict", **x, verdict="white") is None
    assert value(found, "fltea_fit_verdict", **z, verdict="white") == 1
    assert value(found, "fltea_fit_left_out_samples", **y, reason="bridged") == 7
    assert value(found, "fltea_fit_samples", device="due") == 1000
    assert value(found, "fltea_fit_timestamp_seconds", device="due") == 8.5


def test_every_field_of_the_statistics_becomes_a_metric(serve: Callable[..., MetricsSink]) -> None:
    """A field that is added to the record is not forgotten here."""
    sink = serve(STATS)
    before = scrape(sink.url)
    for part in ("link", "samples", "board"):
        struct = getattr(STATS, part)
        for name in struct.__struct_fields__:
            old = getattr(struct, name)
            if not isinstance(old, int):
                continue
            changed = msgspec.structs.replace(struct, **{name: old + 1000})
            sink.write(msgspec.structs.replace(STATS, **{part: changed}))
            after = scrape(sink.url)
            assert [key[0] for key in after if after[key] == before.get(key, 0) + 1000], name


def test_devices_do_not_mix(serve: Callable[..., MetricsSink]) -> None:
    other = msgspec.structs.replace(STATS, device="pi", samples=SampleStats(1, 2, 3, 4, 5))
    found = scrape(serve(STATS, other).url)
    assert value(found, "fltea_samples_delivered_total", device="due") == 1234
    assert value(found, "fltea_samples_delivered_total", device="pi") == 1


def test_what_is_not_known_is_left_out(serve: Callable[..., MetricsSink]) -> None:
    bare = msgspec.structs.replace(STATS, rate_hz=None, clock_ppm=None, board=None, axes={}, link=LinkStats())
    names = {name for name, _ in scrape(serve(bare).url)}
    assert not [
        name for name in names if "board" in name or "hertz" in name or "drift" in name or "axis" in name
    ]
    assert "NaN" not in str(names)


def test_fit_and_estimate_of_an_earlier_epoch_are_not_shown(serve: Callable[..., MetricsSink]) -> None:
    fit = Fit(999, 1, 1, 1, 1000, {"gyro_x": FRACTIONAL}, device="due")
    sink, x = serve(hello(device="due"), ESTIMATE, fit), {"device": "due", "axis": "gyro_x"}

    def shown() -> list[float | None]:
        found = scrape(sink.url)
        return [value(found, name, **x) for name in ("fltea_axis_alpha", "fltea_fit_alpha")]

    assert shown() == [0.412, FRACTIONAL.alpha.value]
    sink.write(EPOCH)
    assert shown() == [None, None]


def test_old_estimate_is_not_shown_as_if_it_were_live(
    serve: Callable[..., MetricsSink], monkeypatch: pytest.MonkeyPatch
) -> None:
    now_ns = 10**12
    monkeypatch.setattr(metrics, "host_ns", lambda: now_ns)
    monkeypatch.setattr(metrics_families, "host_ns", lambda: now_ns)
    sink = serve(ESTIMATE)
    now_ns += 4 * 10**9
    assert any(name == "fltea_axis_alpha" for name, _ in scrape(sink.url))
    now_ns += 2 * 10**9
    assert not any(name.startswith("fltea_axis") for name, _ in scrape(sink.url))


@given(st.lists(st.tuples(st.floats(0, 5000), st.integers(1, 50)), max_size=20))
def test_latency_is_a_histogram_in_seconds(entries: list[tuple[float, int]]) -> None:
    outlet = Outlet(Nowhere(), lambda outlet, error: None)
    for ms, weight in entries:
        outlet.latency.add(ms, weight)
    registry = CollectorRegistry()
    registry.register(Families({}, {}, lambda: [("due", outlet)]))
    found = parse(generate_latest(registry).decode())
    name = "fltea_output_latency_seconds"
    labels = {"output": "nowhere", "device": "due"}
    buckets = {float(dict(key[1])["le"]): count for key, count in found.items() if key[0] == f"{name}_bucket"}
    assert sorted(buckets) == pytest.approx([bound / 1000 for bound in LATENCY_BOUNDS_MS] + [float("inf")])
    for bound, count in buckets.items():
        assert count == sum(weight for ms, weight in entries if ms <= bound * 1000 * (1 + 1e-12))
    assert value(found, f"{name}_count", **labels) == sum(weight for _, weight in entries)
    total_s = value(found, f"{name}_sum", **labels)
    assert total_s == pytest.approx(sum(ms * weight for ms, weight in entries) / 1000)


def test_outputs_of_several_devices_have_one_name_and_are_kept_apart(
    serve: Callable[..., MetricsSink],
) -> None:
    outlets = [Outlet(Nowhere(), lambda outlet, error: None) for _ in range(3)]
    outlets[1].put([STATS, STATS])
    found = scrape(serve(outlets=lambda: list(zip((None, "due", "pi"), outlets, strict=True))).url)
    queued = "fltea_output_queue_records"
    assert value(found, queued, output="nowhere", device="due") == 2
    assert value(found, queued, output="nowhere", device="pi") == 0
    assert value(found, queued, output="nowhere", device="") == 0
    assert value(found, "fltea_output_dropped_total", output="nowhere", device="") == 0


def test_source_with_any_character_is_quoted(serve: Callable[..., MetricsSink]) -> None:
    found = scrape(serve(hello(device="due", source='a"b\\c\nd{e="f"}')).url)
    ((_, facts),) = [key for key in found if key[0] == "fltea_device_info"]
    assert dict(facts)["source"] == 'a"b\\c\nd{e="f"}'


# --- the server ---


def test_several_at_once_while_records_come(serve: Callable[..., MetricsSink]) -> None:
    sink = serve(STATS, ESTIMATE)
    failures: list[BaseException] = []

    def ask() -> None:
        try:
            for _ in range(4):
                scrape(sink.url)
        except BaseException as error:
            failures.append(error)

    askers = [threading.Thread(target=ask) for _ in range(4)]
    for asker in askers:
        asker.start()
    number = 0
    while any(asker.is_alive() for asker in askers):
        number += 1
        sink.write(msgspec.structs.replace(STATS, device=f"d{number % 40}"))
        sink.write(Error(f"k{number % 40}", "text", 1))
        time.sleep(0)  # or the askers would wait for the interpreter
    assert failures == []


def test_address_is_the_loopback_unless_said_otherwise(serve: Callable[..., MetricsSink]) -> None:
    assert serve().url.startswith("http://127.0.0.1:")


def test_address_may_be_of_version_6() -> None:
    try:
        socket.create_server(("::1", 0), family=socket.AF_INET6).close()
    except OSError:
        pytest.skip("this machine has no IPv6")
    sink = MetricsSink(MetricsConfig(address="[::1]:0"), list, lambda kind, text: None)
    assert sink.url.startswith("http://[::1]:")
    assert value(scrape(sink.url), "process_open_fds")
    sink.close()


def get(sink: MetricsSink, host: str | None) -> tuple[int, str]:
    """Status and body for a request with this `Host`."""
    connection = http.client.HTTPConnection("127.0.0.1", port_of(sink), timeout=30)
    try:
        connection.putrequest("GET", "/metrics", skip_host=True)
        if host is not None:
            connection.putheader("Host", host)
        connection.endheaders()
        answer = connection.getresponse()
        return answer.status, answer.read().decode()
    finally:
        connection.close()


MACHINE = ["127.0.0.1", "LOCALHOST:9100", "[::1]:9100", "192.168.1.7:9100", socket.gethostname(), None]
OTHERS = ["evil.example", "evil.example:9100", "localhost.evil.example", "127.0.0.1.evil.example", "", "[::1"]


@pytest.mark.parametrize("host", MACHINE + OTHERS)
def test_only_who_asks_by_a_name_of_this_machine_is_answered(
    serve: Callable[..., MetricsSink], host: str | None
) -> None:
    """DNS rebinding: somebody else's name comes to point here, and his page reads what we serve."""
    status, body = get(serve(STATS), host)
    assert (status, "fltea_gaps_total" in body) == ((200, True) if host in MACHINE else (421, False))
    assert ("metrics.names" in body) == ("fltea_" not in body) == (host in OTHERS)


def test_further_names_can_be_given(serve: Callable[..., MetricsSink]) -> None:
    sink = serve(names=("Lab.example",))
    assert get(sink, "lab.example")[0] == 200
    assert get(sink, "labs.example")[0] == 421


def test_board_that_is_ever_another_makes_few_series(serve: Callable[..., MetricsSink]) -> None:
    """Each label is a time series that Prometheus keeps for weeks."""
    told: list[str] = []
    sink = serve(told=told)
    series = set()
    for k in range(50):
        sink.write(hello(device_id=f"n{k}", firmware_version=f"v{k}", device="due"))
        (info,) = [one for one in sink._families.collect() if one.name == "fltea_device"]
        series |= {frozenset(one.labels.items()) for one in info.samples}
    assert len(series) == MOST + 1
    assert told == ["too_many_devices"]


def test_client_that_says_nothing_or_leaves_disturbs_nobody(
    serve: Callable[..., MetricsSink], capfd: pytest.CaptureFixture[str]
) -> None:
    sink = serve(STATS)
    port = port_of(sink)
    with socket.create_connection(("127.0.0.1", port)):
        with socket.create_connection(("127.0.0.1", port)) as rude:
            rude.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
            rude.sendall(b"GET /metrics HTTP/1.0\r\n\r\n")
        assert value(scrape(sink.url), "fltea_gaps_total", device="due") == 70
    assert capfd.readouterr() == ("", "")


def test_after_close_nobody_answers_and_the_port_is_free() -> None:
    sink = MetricsSink(MetricsConfig(address="0"), list, lambda kind, text: None)
    port = port_of(sink)
    before = threading.active_count()
    sink.close()
    assert threading.active_count() == before - 1
    again = MetricsSink(MetricsConfig(address=port), list, lambda kind, text: None)
    again.close()
    with pytest.raises(OSError, match="refused"):
        urllib.request.urlopen(sink.url, timeout=PATIENCE_S)


def test_taken_port_ends_the_command_with_a_hint() -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        result = fltea("run", "-s", "synthetic:?alpha=0.3&f=-1", "--metrics", str(port))
    assert result.returncode == FlteaError.exit_code
    assert f"port {port} of 127.0.0.1 is taken by another program" in result.stderr
    assert result.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("address", "words"),
    [("203.0.113.7:0", "no address of this machine"), ("a.invalid:0", "no address of this machine")],
)
def test_address_that_is_not_here(address: str, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        MetricsSink(MetricsConfig(address=address), list, lambda kind, text: None)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("9100", ("127.0.0.1", 9100)),
        ("0.0.0.0:9100", ("0.0.0.0", 9100)),
        ("[::1]:9100", ("::1", 9100)),
        ("pi.local:0", ("pi.local", 0)),
    ],
)
def test_listen_address(text: str, expected: tuple[str, int]) -> None:
    assert listen_address(text) == expected


@pytest.mark.parametrize("address", ["", "x", ":9100", "pi:", "65536", "-1", "::1:9100", "²", 70000])
def test_no_listen_address(address: str | int) -> None:
    with pytest.raises(UsageError, match=r"metrics\.address"):
        load_config(None, {"metrics.address": address})
