"""The samples of a device are rejected if its HELLO states another rate than its clock and sequence numbers
show.
"""

import re
from collections.abc import Iterator

import numpy as np
import pytest
from fltea.records.block import Block
from fltea.records.events import Event, LinkDown, RawSample
from fltea.records.records import AnyRecord, Epoch, Error, Stats
from fltea.records.stats import SampleStats
from fltea.settings.config import load_config
from fltea.stream.pipeline import Pipeline

from tests.rig.blocks import as_block, ndjson, of, records_of
from tests.rig.device_stream_support import NO_FILTERS, Source
from tests.rig.host_support import hello
from tests.rig.plain_device_stream import PlainDeviceStream
from tests.rig.same_records import assert_same

N = 1000
FIRST_SECOND = 105
"""Largest number of samples before the program detects that the rate in HELLO contradicts the device's clock.
Until then it uses samples, or holds them back until the next HELLO.
"""


def samples(
    true_hz: float, n: int = N, *, begin: int = 0, jitter_us: int = 0, keep: float = 1.0
) -> list[RawSample]:
    """Return n samples of a device whose true sampling rate is `rate_hz`, whatever its HELLO states.

    `keep`: fraction of the samples that arrive.
    """
    rng = np.random.default_rng(7)
    found = []
    for k in range(begin, begin + n):
        at_us = round(k * 1e6 / true_hz) + int(rng.integers(-jitter_us, jitter_us + 1)) + 1000
        if rng.random() < keep:
            found.append(RawSample(k % 65536, at_us, at_us * 1000, (k % 7, 1, 2)))
    return found


def with_hellos(said_hz: float, some: list[RawSample], boot_id: int = 7) -> Iterator[Event]:
    """Add a HELLO every second of the device's time."""
    due_us = 0
    for raw in some:
        if raw.device_us >= due_us:
            due_us = raw.device_us + 1_000_000
            yield hello(boot_id=boot_id, rate_hz=said_hz, host_ns=raw.host_ns)
        yield as_block(raw)


def walked(events: list[Event]) -> list[AnyRecord]:
    source, chosen = Source(), load_config(None, NO_FILTERS)
    pipeline, plain = Pipeline(source, chosen), PlainDeviceStream(source, chosen)
    found: list[AnyRecord | Block] = []
    expected: list[AnyRecord] = []
    for event in events:
        found += pipeline.feed(event)
        expected += plain.feed(event)
    records = records_of([*found, *pipeline.finish()])
    assert_same(records, [*expected, plain.finish()])
    return records


def counts_of(records: list[AnyRecord]) -> SampleStats:
    return of(Stats, records)[-1].sample_counts


def errors_of(records: list[AnyRecord]) -> list[str]:
    return [error.kind for error in of(Error, records)]


@pytest.mark.parametrize("said_hz", [200.0, 150.0, 50.0, 10.0])
@pytest.mark.parametrize("how", [{}, {"jitter_us": 500}, {"keep": 0.8}], ids=["even", "jitter", "losses"])
def test_samples_of_a_device_that_contradicts_itself_are_counted_as_such(
    said_hz: float, how: dict[str, float]
) -> None:
    some = samples(100.0, **how)  # type: ignore[arg-type]
    records = walked(list(with_hellos(said_hz, some)))
    counts = counts_of(records)
    assert errors_of(records) == ["rate_differs"]
    text = of(Error, records)[0].message
    assert f"HELLO states {said_hz:g} Hz" in text
    assert float(re.findall(r"come at (\S+) Hz", text)[0]) == pytest.approx(100, rel=0.02)
    assert counts.delivered + counts.before_hello + counts.rate_differs == len(some)
    assert counts.rate_differs >= len(some) - FIRST_SECOND


def test_a_rate_ten_times_too_high_is_no_restart() -> None:
    """By the stated rate, the time between two samples is ten times too long, as if the device had restarted.
    But this goes on for longer than the program waits for a HELLO, so it is not taken for a restart.
    """
    some = samples(100.0, 2000)
    records = walked(list(with_hellos(1000.0, some)))
    counts = counts_of(records)
    assert errors_of(records) == ["rate_differs"]
    assert counts.delivered + counts.before_hello + counts.rate_differs == len(some)
    assert counts.rate_differs >= len(some) - FIRST_SECOND


@pytest.mark.parametrize(
    ("true_hz", "how"),
    [(101.0, {}), (99.0, {}), (104.0, {}), (100.0, {"jitter_us": 4000}), (100.0, {"keep": 0.3})],
)
def test_a_device_whose_clock_is_a_little_off_is_believed(true_hz: float, how: dict[str, float]) -> None:
    some = samples(true_hz, **how)  # type: ignore[arg-type]
    records = walked(list(with_hellos(100.0, some)))
    assert errors_of(records) == []
    assert counts_of(records).delivered == len(some)


@pytest.mark.parametrize("boot_id", [7, 8], ids=["the same boot", "another boot"])
def test_it_is_believed_again_when_hello_states_the_true_rate(boot_id: int) -> None:
    some = samples(100.0, 3 * N)
    wrong, right = some[:N], some[N:]
    records = walked([*with_hellos(200.0, wrong), *with_hellos(100.0, right, boot_id)])
    counts = counts_of(records)
    assert counts.delivered + counts.rate_differs == len(some)
    assert counts.delivered >= len(right)
    assert counts.lost == 0
    reasons = [epoch.reason for epoch in of(Epoch, records)]
    assert reasons == ["start", "discontinuity" if boot_id == 7 else "restart"]


def test_it_is_believed_again_when_its_clock_agrees() -> None:
    wrong, right = samples(50.0, N), samples(100.0, N)
    later_us = wrong[-1].device_us + 10_000
    right = [
        raw._replace(
            sequence=(N + k) % 65536, device_us=later_us + 10_000 * k, host_ns=(later_us + 10_000 * k) * 1000
        )
        for k, raw in enumerate(right)
    ]
    records = walked(list(with_hellos(100.0, wrong + right)))
    counts = counts_of(records)
    assert [epoch.reason for epoch in of(Epoch, records)] == ["start", "discontinuity"]
    assert counts.lost == 0
    assert N - 500 <= counts.delivered <= N


def test_another_device_on_the_port_is_asked_for_its_hello_first() -> None:
    """A device with another rate follows on the same port. Samples that come before its HELLO contradict the
    rate of the earlier device. No error is reported for them.
    """
    first, second = samples(100.0, 300), samples(500.0, 400)
    moved = [raw._replace(host_ns=raw.host_ns + 10**10) for raw in second]
    events = [
        *with_hellos(100.0, first),
        *map(as_block, moved),
        *with_hellos(500.0, samples(500.0, 300, begin=400), 9),
    ]
    records = walked(events)
    assert errors_of(records) == []
    lost_link = walked([*with_hellos(100.0, first), LinkDown(first[-1].host_ns), *map(as_block, moved)])
    assert errors_of(lost_link) == []
    assert counts_of(lost_link).before_hello == len(moved)


@pytest.mark.parametrize("said_hz", [200.0, 1000.0])
def test_it_does_not_depend_on_how_samples_are_put_together(said_hz: float) -> None:
    some = list(with_hellos(said_hz, samples(100.0)))
    whole = ndjson(_walk(some))
    joined: list[Event] = []
    pending: list[RawSample] = []
    for event in some:
        if hasattr(event, "samples"):
            pending += event.samples()
            continue
        if pending:
            joined.append(as_block(*pending))
        pending = []
        joined.append(event)
    joined.append(as_block(*pending))
    assert ndjson(_walk(joined)) == whole


def _walk(events: list[Event]) -> list[AnyRecord]:
    pipeline = Pipeline(Source(), load_config(None, NO_FILTERS))
    found = [item for event in events for item in pipeline.feed(event)]
    return records_of([*found, *pipeline.finish()])
