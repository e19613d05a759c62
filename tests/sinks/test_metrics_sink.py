"""Tests of the metrics that are served over HTTP. The tests read them with Prometheus's own parser."""

import socket
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import msgspec
import pytest
from fltea.records.errors import FlteaError
from fltea.records.estimate import AxisEstimate
from fltea.records.identities import MOST
from fltea.records.ports import LATENCY_BOUNDS_MS
from fltea.records.records import ACCEL_UNIT, Epoch, Error, Estimate, EstimatorInfo, Fit, Sample, Stats
from fltea.records.stats import AxisStats, DeviceStatus, LinkStats, SampleStats
from fltea.service.sink_queue import SinkQueue
from fltea.settings.outputs import MetricsConfig
from fltea.sinks.figures.table import FIGURES
from fltea.sinks.metrics.families import Families
from fltea.sinks.metrics.sink import MetricsSink
from hypothesis import given
from hypothesis import strategies as st
from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.parser import text_string_to_metric_families

from tests.rig.blocks import as_items
from tests.rig.example_records import GOOD, INVALID, MOVES, RESTS, STATS, STEP, axis_estimate
from tests.rig.fit_support import FRACTIONAL, UNDECIDED, WHITE
from tests.rig.host_support import PATIENCE_S, ask, each_ended, fltea_here, hello, port_of
from tests.rig.memory_sink import Memory

AXES = {
    "gyro_x": GOOD,
    "gyro_y": INVALID,
    "accel_z": axis_estimate(
        0.5, 0.1, -1.0, 0.2, 9.8, 0.0, True, null_p=1e-9, whiteness="rejected", unit=ACCEL_UNIT
    ),
}
ESTIMATE = Estimate(7, 3, 70_000, 7, "joint", AXES, device="due")
INFO = EstimatorInfo("joint", "host", "compressed", "consistent", 9, 9, (0.0,), ())
EPOCH = Epoch(4, "gap", 8, 8, 8, 7, INFO, device="due")
SAMPLE = Sample(7, 3, 70_000, 7_250_000_000, (0.5,), temperature_c=21.5, device="due")

Serve = Callable[..., MetricsSink]
Labels = frozenset[tuple[str, str]]


def scrape(url: str) -> dict[tuple[str, Labels], float]:
    """Return the value of every time series by its name and labels."""
    with urllib.request.urlopen(url, timeout=PATIENCE_S) as answer:
        text = answer.read().decode()
    for family in text_string_to_metric_families(text):
        assert family.documentation or family.name.startswith("process_")
    return parse(text)


def parse(text: str) -> dict[tuple[str, Labels], float]:
    found: dict[tuple[str, Labels], float] = {}
    for family in text_string_to_metric_families(text):
        for one in family.samples:
            key = one.name, frozenset(one.labels.items())
            assert key not in found, "Prometheus refuses what comes twice"
            found[key] = one.value
    return found


def value(found: dict[tuple[str, Labels], float], name: str, **labels: str) -> float | None:
    return found.get((name, frozenset(labels.items())))


@pytest.fixture
def serve(monkeypatch: pytest.MonkeyPatch) -> Iterator[Serve]:
    # this period is so short that the output ends without a long wait
    monkeypatch.setattr("fltea.sinks.metrics.sink.POLL_S", 0.01)

    def start(
        *records: Any, sink_queues: Any = list, told: list[str] | None = None, **settings: Any
    ) -> MetricsSink:
        told = [] if told is None else told
        config = MetricsConfig(address="0", **settings)
        sink = MetricsSink(config, sink_queues, lambda kind, text: told.append(kind))
        for item in as_items(records):
            sink.write(item)
        return sink

    yield from each_ended(start, MetricsSink.close)


def test_nothing_is_said_of_devices_before_they_speak(serve: Serve) -> None:
    url = serve().url
    assert url.startswith("http://127.0.0.1:"), "the loopback unless told otherwise"
    found = scrape(url)
    names = {name for name, _ in found if not name.startswith("process_")}
    assert names == {"fltea_build_info"}
    assert value(found, "process_resident_memory_bytes")


EXPECTED = Path(__file__).with_name("metrics.txt").read_text(encoding="utf-8")
"""The expected text of all metrics of a device, in base units. An axis whose estimate is not valid has only
the metric that says so.
"""
OF_THESE = (Stats, LinkStats, DeviceStatus, AxisStats, Sample, AxisEstimate)
"""The records, and parts of records, with whose metrics the text is compared."""
ABSENT = {"stats.board.cpu_share_percent", "stats.board.longest_step_us", "stats.axes.<axis>.describes_noise"}
"""Figures that are unknown in the records of this test, as they are for most devices."""


def line(key: tuple[str, Labels], number: float) -> str:
    """Return one time series as metrics.txt has it."""
    name, labels = key
    inside = ",".join(
        f'{label}="{word}"' for label, word in sorted(labels, key=lambda one: one[0] != "device")
    )
    return f"{name}{{{inside}}} {number:.12g}"


def other_lines(found: dict[tuple[str, Labels], float], expected: dict[tuple[str, Labels], float]) -> str:
    """Say in which lines the shown metrics differ from metrics.txt; empty if they are the same."""
    lacks = [line(key, found[key]) for key in found.keys() - expected.keys()]
    gone = [line(key, expected[key]) for key in expected.keys() - found.keys()]
    other = [
        f"{line(key, expected[key])}, not {found[key]:.12g}"
        for key in found.keys() & expected.keys()
        if found[key] != pytest.approx(expected[key], rel=1e-12)
    ]
    return "\n".join(
        f"{words}\n  " + "\n  ".join(sorted(lines))
        for words, lines in (
            ("tests/sinks/metrics.txt lacks (compare the value with tests/rig/example_records.py):", lacks),
            ("not shown (has the field a value in tests/rig/example_records.py?), or of another name:", gone),
            ("tests/sinks/metrics.txt has:", other),
        )
        if lines
    )


def test_every_figure_under_its_name_and_in_base_units(serve: Serve) -> None:
    error = Error("silent", "nothing came", 1, device="due")
    moves = MOVES, RESTS, MOVES
    found = scrape(serve(hello(device="due"), STATS, SAMPLE, ESTIMATE, error, error, *moves, STEP).url)
    others = ("process_", "fltea_build_info")
    shown = {key: value for key, value in found.items() if not key[0].startswith(others)}
    differs = other_lines(shown, parse(EXPECTED))
    assert not differs, differs


def test_the_text_of_all_metrics_has_each_metric_that_is_declared() -> None:
    names = {name for name, _ in parse(EXPECTED)}
    declared = {one.path: one.metric_name for one in FIGURES if one.kind in OF_THESE and one.metric_name}
    absent = {path for path, name in declared.items() if name not in names}
    assert absent == ABSENT, (
        f"{sorted(absent ^ ABSENT)}: each has a value in tests/rig/example_records.py, and its metric a "
        "line in tests/sinks/metrics.txt, or it is in ABSENT"
    )


def test_a_metric_that_is_missing_or_other_is_named() -> None:
    expected = parse(EXPECTED)
    key = "fltea_axis_steps_total", frozenset({("axis", "gyro_x"), ("device", "due")})
    text = 'fltea_axis_steps_total{device="due",axis="gyro_x"} 3'
    assert text in EXPECTED
    without = {one: number for one, number in expected.items() if one != key}
    assert other_lines(expected, expected) == ""
    assert other_lines(expected, without).splitlines()[1:] == [f"  {text}"]
    assert other_lines(without, expected).splitlines()[1:] == [f"  {text}"]
    assert other_lines(expected | {key: 4.0}, expected).splitlines()[1:] == [f"  {text}, not 4"]


def test_the_newest_fit_of_every_axis(serve: Serve) -> None:
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


def test_what_is_not_known_is_left_out(serve: Serve) -> None:
    bare = msgspec.structs.replace(STATS, rate_hz=None, clock_ppm=None, board=None, axes={}, link=LinkStats())
    names = str({name for name, _ in scrape(serve(bare).url)})
    assert not [word for word in ("board", "hertz", "drift", "axis", "NaN") if word in names]


def test_fit_and_estimate_of_an_earlier_epoch_are_not_shown(serve: Serve) -> None:
    fit = Fit(999, 1, 1, 1, 1000, {"gyro_x": FRACTIONAL}, device="due")
    sink, x = serve(hello(device="due"), ESTIMATE, fit), {"device": "due", "axis": "gyro_x"}

    def shown() -> list[float | None]:
        found = scrape(sink.url)
        return [value(found, name, **x) for name in ("fltea_axis_fltea_alpha", "fltea_fit_alpha")]

    assert shown() == [0.412, FRACTIONAL.alpha.value]
    sink.write(EPOCH)
    assert shown() == [None, None]


def test_old_estimate_is_not_shown_as_if_it_were_live(serve: Serve, monkeypatch: pytest.MonkeyPatch) -> None:
    now_ns = 10**12
    monkeypatch.setattr("fltea.sinks.metrics.sink.host_ns", lambda: now_ns)
    monkeypatch.setattr("fltea.sinks.metrics.families.host_ns", lambda: now_ns)
    sink = serve(ESTIMATE)
    now_ns += 4 * 10**9
    assert any(name == "fltea_axis_fltea_alpha" for name, _ in scrape(sink.url))
    now_ns += 2 * 10**9
    assert not any(name.startswith("fltea_axis") for name, _ in scrape(sink.url))


@given(st.lists(st.tuples(st.floats(0, 5000), st.integers(1, 50)), max_size=20))
def test_latency_is_a_histogram_in_seconds(entries: list[tuple[float, int]]) -> None:
    sink_queue = SinkQueue(Memory("nowhere"), lambda sink_queue, error: None)
    for ms, weight in entries:
        sink_queue.latency.add(ms, weight)
    registry = CollectorRegistry()
    registry.register(Families({}, {}, lambda: [("due", sink_queue)]))
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


def test_several_devices_and_their_outputs_of_one_name_are_kept_apart(serve: Serve) -> None:
    sink_queues = [SinkQueue(Memory("nowhere"), lambda sink_queue, error: None) for _ in range(3)]
    sink_queues[1].put([STATS, STATS])
    other = msgspec.structs.replace(STATS, device="pi", sample_counts=SampleStats(1, 2, 3, 4, 5))
    sink = serve(STATS, other, sink_queues=lambda: list(zip((None, "due", "pi"), sink_queues, strict=True)))
    found = scrape(sink.url)
    assert value(found, "fltea_samples_delivered_total", device="due") == 1234
    assert value(found, "fltea_samples_delivered_total", device="pi") == 1
    queued = "fltea_output_queue_records"
    assert value(found, queued, output="nowhere", device="due") == 2
    assert value(found, queued, output="nowhere", device="pi") == 0
    assert value(found, queued, output="nowhere", device="") == 0
    assert value(found, "fltea_output_dropped_total", output="nowhere", device="") == 0


def test_source_with_any_character_is_quoted(serve: Serve) -> None:
    found = scrape(serve(hello(device="due", source='a"b\\c\nd{e="f"}')).url)
    ((_, facts),) = [key for key in found if key[0] == "fltea_device_info"]
    assert dict(facts)["source"] == 'a"b\\c\nd{e="f"}'


# --- the server ---


def test_several_at_once_while_records_come(serve: Serve) -> None:
    sink = serve(STATS, ESTIMATE)
    number = 0
    with ThreadPoolExecutor(4) as pool:
        asked = [pool.submit(scrape, sink.url) for _ in range(16)]
        while not all(one.done() for one in asked):
            number += 1
            sink.write(msgspec.structs.replace(STATS, device=f"d{number % 40}"))
            sink.write(Error(f"k{number % 40}", "text", 1))
            # this lets the threads that ask for metrics run; otherwise they would wait long for the
            # interpreter
            time.sleep(0)
    assert [one.exception() for one in asked] == [None] * 16


def test_address_may_be_of_version_6() -> None:
    try:
        socket.create_server(("::1", 0), family=socket.AF_INET6).close()
    except OSError:
        pytest.skip("this machine has no IPv6")
    sink = MetricsSink(MetricsConfig(address="[::1]:0"), list, lambda kind, text: None)
    assert sink.url.startswith("http://[::1]:")
    assert value(scrape(sink.url), "process_open_fds")
    sink.close()


def test_only_who_asks_by_a_name_of_this_machine_is_answered(serve: Serve) -> None:
    """A request without a host name is answered, since it does not come from a browser.

    test_listening tests which names are accepted.
    """
    sink = serve(STATS, names=("Lab.example",))
    named = [{"Host": host} for host in ("127.0.0.1", "LOCALHOST:9100", "lab.example")]
    for how in ({"skip_host": True}, *named):
        status, body, _ = ask(port_of(sink.url), "/metrics", **how)
        assert (status, "fltea_gaps_total" in body) == (200, True)
    for host in ("evil.example", "labs.example:9100", ""):
        status, body, _ = ask(port_of(sink.url), "/metrics", Host=host)
        assert (status, "fltea_" in body, "metrics.names" in body) == (421, False, True)


def test_board_that_is_ever_another_makes_few_series(serve: Serve) -> None:
    """A board whose identity changes again and again makes only few time series. Each new value of a label
    begins a time series, which Prometheus keeps for weeks.
    """
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
    serve: Serve, capfd: pytest.CaptureFixture[str]
) -> None:
    sink = serve(STATS)
    port = port_of(sink.url)
    with socket.create_connection(("127.0.0.1", port)):
        with socket.create_connection(("127.0.0.1", port)) as rude:
            rude.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
            rude.sendall(b"GET /metrics HTTP/1.0\r\n\r\n")
        assert value(scrape(sink.url), "fltea_gaps_total", device="due") == 70
    assert capfd.readouterr() == ("", "")


def test_after_close_nobody_answers_and_the_port_is_free() -> None:
    before = {*threading.enumerate()}
    sink = MetricsSink(MetricsConfig(address="0"), list, lambda kind, text: None)
    port = port_of(sink.url)
    (own,) = {*threading.enumerate()} - before
    sink.close()
    assert not own.is_alive()
    again = MetricsSink(MetricsConfig(address=port), list, lambda kind, text: None)
    again.close()
    with pytest.raises(OSError, match="refused"):
        urllib.request.urlopen(sink.url, timeout=PATIENCE_S)


def test_taken_port_ends_the_command_with_a_hint() -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        result = fltea_here("run", "-s", "synthetic:?alpha=0.3&f=-1", "--metrics", str(port))
    assert result.returncode == FlteaError.exit_code
    assert f"port {port} of 127.0.0.1 is taken by another program" in result.stderr
    assert result.stderr.count("\n") == 1
