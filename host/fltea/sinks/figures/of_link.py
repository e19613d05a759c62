"""Declare the figures of the connection to the device, the samples, the board and the outputs."""

from collections.abc import Iterator
from functools import partial

from fltea.records.records import Sample, Stats
from fltea.records.stats import DeviceStatus, LinkStats, OutputStats
from fltea.sinks.figures.figure import (
    Cells,
    Entity,
    Figure,
    Hidden,
    Row,
    Rows,
    Seen,
    Shown,
    counter,
    gauge,
    loss,
    thousands,
)
from fltea.sinks.figures.hidden import NARROW, NO_ENTITY, NO_METRIC, NO_PANEL, ONLY_METRIC
from fltea.sinks.words import counted, quantity

HEALTH = Shown("the last lines of a device")
PANEL = Shown("a panel")

_stats, _sample = partial(Figure, Stats), partial(Figure, Sample)
_link, _board = partial(Figure, LinkStats), partial(Figure, DeviceStatus)
_output = partial(Figure, OutputStats)


def _bad_frames(seen: Seen) -> Iterator[Cells]:
    link: LinkStats | None = seen.record(LinkStats)
    if link is not None:
        found = link.damaged
        yield counted("CRC errors", found.pop("crc", 0))
        yield counted(
            "other bad frames", sum(found.values()), ", ".join(f"{r} {n}" for r, n in found.items())
        )


def _other_version(seen: Seen) -> Iterator[Cells]:
    if found := seen.record(LinkStats):
        yield counted("frames of another version", found.unknown_type + found.refused)


def _dropped(seen: Seen) -> Iterator[Cells]:
    for name, output in (seen.record(OutputStats) or {}).items():
        waiting = f"{output.queued:,} waiting" if output.queued > 100 else ""
        yield counted(f"dropped by output {name}", output.dropped, waiting)


FIGURES = (
    _stats(
        "rate_hz",
        gauge("sample_rate_hertz", "Sampling rate by the host's clock."),
        page=Row("link", "rate", lambda hz: quantity(hz, "Hz", 3), absent="–"),
        terminal=HEALTH,
        home_assistant=NO_ENTITY,
        grafana=PANEL,
    ),
    _stats(
        "clock_ppm",
        gauge(
            "clock_drift_ratio",
            "Relative amount by which the device's clock runs faster than the host's.",
            factor=1e-6,
        ),
        page=Row("link", "device clock", lambda ppm: f"{ppm:+.1f} ppm", absent="–"),
        terminal=HEALTH,
        home_assistant=NO_ENTITY,
        grafana=PANEL,
    ),
    _stats(
        "sample_counts.delivered",
        counter("samples_delivered", "Number of samples that were passed to the estimator."),
        page=Row("link", "samples", thousands),
        terminal=HEALTH,
        home_assistant=NO_ENTITY,
        grafana=PANEL,
    ),
    _stats(
        "sample_counts.lost",
        counter("samples_lost", "Number of samples that are missing in gaps."),
        page=loss("link", "lost samples"),
        terminal=HEALTH,
        home_assistant=Entity("lost", "samples lost", state_class="total_increasing", category="diagnostic"),
        grafana=PANEL,
    ),
    _stats(
        "sample_counts.gaps",
        counter("gaps", "Gaps."),
        page=loss("link", "gaps"),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=PANEL,
    ),
    _stats(
        "sample_counts.duplicates",
        counter("samples_duplicate", "Number of samples that arrived a second time and were dropped."),
        page=loss("link", "duplicates"),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=PANEL,
    ),
    _stats(
        "sample_counts.before_hello",
        counter(
            "samples_before_hello",
            "Number of samples that arrived before the first HELLO and cannot be used.",
        ),
        **ONLY_METRIC,
    ),
    _stats(
        "sample_counts.rate_differs",
        counter(
            "samples_rate_differs",
            "Number of samples that were not used, since the device's clock contradicts its HELLO.",
        ),
        **ONLY_METRIC,
    ),
    _stats(
        "epoch",
        counter("epochs", "Epochs begun."),
        page=Hidden("the page takes it from the record `epoch`"),
        terminal=HEALTH,
        home_assistant=NO_ENTITY,
        grafana=PANEL,
    ),
    _stats(
        "startup_remaining",
        gauge("startup_remaining_samples", "Number of samples until the start-up window is full."),
        page=Hidden("the page counts the samples of the epoch itself"),
        terminal=Shown("the place of the estimates, before the first estimate"),
        home_assistant=NO_ENTITY,
        grafana=PANEL,
    ),
    _stats(
        "host_ns",
        gauge("stats_timestamp_seconds", "Unix time of the newest statistics.", factor=1e-9),
        **ONLY_METRIC,
    ),
    _link(
        "bytes",
        counter("received_bytes", "Bytes received."),
        **ONLY_METRIC,
    ),
    _link(
        "frames",
        counter("frames", "Good frames."),
        **ONLY_METRIC,
    ),
    _link(
        "reconnects",
        counter("reconnects", "Number of times that the port was opened again."),
        page=loss("link", "reconnects"),
        terminal=HEALTH,
        home_assistant=NO_ENTITY,
        grafana=PANEL,
    ),
    _link(
        "bad_frames",
        counter("bad_frames", "Number of damaged frames, by reason.", key="reason"),
        page=Rows("link", _bad_frames),
        terminal=HEALTH,
        home_assistant=NO_ENTITY,
        grafana=PANEL,
    ),
    _link(
        "unknown_type",
        counter("unknown_frames", "Number of intact frames of an unknown type."),
        page=Rows("link", _other_version),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _link(
        "refused",
        counter("refused_frames", "Number of frames from a device with another version of the protocol."),
        page=Shown("the row of `unknown_type`"),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _link(
        "overflow_bytes",
        counter("overflow_bytes", "Number of bytes that were thrown away, since the program was too slow."),
        page=loss("link", "bytes thrown away"),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _board(
        "i2c_errors",
        counter("i2c_errors", "Number of I2C transfers that failed, since the device's boot."),
        page=loss("link", "I²C errors"),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=PANEL,
    ),
    _board(
        "bus_recoveries",
        counter("bus_recoveries", "Number of times that a blocked bus was freed, since the device's boot."),
        page=loss("link", "I²C bus freed"),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=PANEL,
    ),
    _board(
        "sensor_reinits",
        counter(
            "sensor_reinits", "Number of times that the sensor was set up again, since the device's boot."
        ),
        page=loss("link", "sensor set up again"),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=PANEL,
    ),
    _board(
        "overruns",
        counter("overruns", "Number of sampling instants without a sample, since the device's boot."),
        page=loss("link", "overruns"),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=PANEL,
    ),
    _board(
        "dropped_frames",
        counter("dropped_frames", "Number of frames that the device could not send, since its boot."),
        page=loss("link", "frames dropped by the device"),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=PANEL,
    ),
    _board(
        "reset_cause",
        NO_METRIC,
        page=Row("link", "last reset by", lambda cause: cause.replace("_", " ")),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=NO_METRIC,
    ),
    _output(
        "written",
        counter("written", "Number of records that an output has processed; it may write fewer of them."),
        **ONLY_METRIC,
    ),
    _output(
        "dropped",
        counter("dropped", "Number of records that an output lost, since it was too slow or broken."),
        page=Rows("link", _dropped),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=PANEL,
    ),
    _output(
        "queued",
        gauge("queue_records", "Number of records that wait for an output."),
        page=Shown("the row of `dropped`"),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=NO_PANEL,
    ),
    _sample(
        "temperature_c",
        gauge("temperature_celsius", "Die temperature of the sensor."),
        page=Shown("the list of what the device states"),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=PANEL,
    ),
    _sample(
        "host_ns",
        gauge("sample_timestamp_seconds", "Unix time of the newest sample.", factor=1e-9),
        page=Shown("the time of the newest sample"),
        terminal=NARROW,
        home_assistant=NO_ENTITY,
        grafana=PANEL,
    ),
)
