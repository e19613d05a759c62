"""Tests of many devices behind one broker.

The tests show which devices are accepted, and which limits hold. Some devices send all that they kept during
an outage, and some send too much.
"""

from typing import Any

import pytest
from fltea.records.clock import host_ns
from fltea.service.ingest.admission import CANDIDATES, Admission
from fltea.service.ingest.floods import BURST_BYTES, MESSAGE_BYTES, SECOND_BYTES, Allowance
from fltea.service.ingest.inbox import Inbox
from fltea.service.ingest.losses import Losses
from fltea.service.pressure import CHECKS, LATE_NS, QUIET_NS, STEP_NS, Pressure
from fltea.stream.fit_times import RefitTimes
from fltea.stream.fit_worker import FitWorker
from hypothesis import given
from hypothesis import strategies as st

S = 10**9
NAMES = st.sampled_from(["a", "b", "c", "d", "ä", "a/b", "", "x" * 65, "program"])


@given(st.lists(st.tuples(NAMES, st.booleans())), st.integers(1, 3))
def test_only_so_many_devices_each_with_its_second_message(said: list[tuple[str, bool]], limit: int) -> None:
    admission, heard, inside = Admission[int](limit, "program"), dict.fromkeys("abcd", 0), set[str]()
    taken = 0
    for number, (name, leaves) in enumerate(said):
        verdict, first, missed_bytes = admission.judge(name, 0, number, 1)
        assert (first is not None, missed_bytes) == (verdict == "new", 0)
        assert first is None or said[first][0] == name
        if name not in heard:
            assert verdict == "bad_name"
            continue
        heard[name] += 1
        if name in inside:
            assert verdict == "in"
        elif heard[name] == 1:
            assert verdict == "candidate"
        else:
            assert verdict == ("full" if len(inside) == limit else "new")
            inside |= {name} if verdict == "new" else set()
        if leaves and name in inside:
            admission.forget(name)
            inside.remove(name)
            heard[name] = 0
        assert len(admission) == len(inside) <= limit
        taken += (verdict in ("in", "new")) + (first is not None)
    assert sum(admission.turned_away.values()) == len(said) - taken


def test_names_that_are_made_up_take_nobodys_place_and_are_told() -> None:
    inbox = Inbox(2, 1 << 24)
    losses = Losses(inbox, "mqtt://broker")
    for k in range(CANDIDATES + 300):
        inbox.put(f"u{k}", b"x")
    while inbox.has_messages:
        assert not inbox.take(0)[0]
    assert len(inbox.admission) == 0
    assert len(inbox.admission._candidates) == CANDIDATES
    for part in (b"first", b"second"):
        inbox.put("real", part)
    assert [m[:2] for m in inbox.take(0)[0]] == [("real", b"first"), ("real", b"second")]
    ((kind, text, *_),) = losses.check(0)
    assert kind == "devices_refused"
    assert "301 names sent one message" in text
    assert not list(losses.check(1)), "once a minute"


def test_names_are_told_so_that_no_terminal_obeys_them() -> None:
    inbox = Inbox(2, 1 << 24)
    inbox.put("\x1b[2J" + "x" * 500, b"")
    inbox.take(0)
    ((_, text, *_),) = Losses(inbox, "mqtt://broker").check(0)
    assert text.isprintable()
    assert len(text) < 400


def test_a_first_message_for_which_there_was_no_room_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fltea.service.ingest.admission.FIRST_BYTES", 1000)
    inbox = Inbox(2, 1 << 24)
    for name, size in (("a", 700), ("b", 500), ("b", 10), ("a", 20)):
        inbox.put(name, bytes(size))
    assert [(m.device, len(m.data)) for m in inbox.take(0)[0]] == [("b", 10), ("a", 700), ("a", 20)]
    assert inbox.overflow_bytes == {"b": 500}
    inbox.forget("b")
    inbox.put("b", bytes(500))
    inbox.put("b", b"")
    assert [len(m.data) for m in inbox.take(0)[0]] == [500, 0], "the first one's room is free again"


@pytest.mark.parametrize("size", [0, 1000])
def test_all_together_are_bounded_and_who_receives_waits(size: int) -> None:
    inbox = Inbox(100, 10 * (size + MESSAGE_BYTES))
    for k in range(10):
        assert inbox.wait_for_room(0)
        inbox.put(f"d{k % 2}", bytes(size))
    assert not inbox.wait_for_room(0)
    assert len(inbox.take(0)[0]) == 10
    assert inbox.wait_for_room(0)
    assert not inbox.overflow_bytes


def test_what_is_left_at_the_end_is_counted_by_device() -> None:
    inbox = Inbox(10, 1 << 20)
    for k in range(10):
        inbox.put(f"d{k % 2}", b"frames")
    assert inbox.end() == 10 * len(b"frames")
    inbox.put("d0", b"late")
    assert inbox.overflow_bytes == {"d0": 34, "d1": 30}
    assert not inbox.take(0)[0]


def test_fits_come_more_rarely_while_messages_wait_and_oftener_when_it_is_calm() -> None:
    fit_worker = FitWorker(100)
    kinds: list[str] = []
    pressure, now_ns = Pressure(fit_worker, lambda kind, message: kinds.append(kind)), 1000 * S
    for k in range(60):
        now_ns += S
        pressure.waited(2 * LATE_NS)
        pressure.check(now_ns)
        assert kinds or k < CHECKS - 1, "devices that begin together are no reason"
    assert fit_worker.slower == 2 ** len(kinds) == 64
    assert set(kinds) == {"fits_slowed"}
    while fit_worker.slower > 1:
        before, since_ns = fit_worker.slower, now_ns
        while fit_worker.slower == before:
            now_ns += S
            pressure.waited(LATE_NS // 10)
            pressure.check(now_ns)
        assert now_ns - since_ns >= min(QUIET_NS, STEP_NS)
    assert fit_worker.slower == 1
    assert len(kinds) == 6


def test_another_pace_counts_from_the_next_look_on() -> None:
    times, found = RefitTimes(100.0, grows=False, every=True), []
    times.begin(100)
    for number in range(1, 5001):
        if number >= times.check:
            found.append(times.at(number, number, 1000 if 200 <= number < 3000 else 100, noticed=False))
    assert [check.counts for check in found if check][:6] == [150, 700, 1500, 2500, 3050, 3150]


def test_a_shared_load_slows_every_device_alike() -> None:
    from fltea.settings.config import load_config
    from fltea.stream.fit_times import period_s

    config: Any = load_config(None, {})
    given = load_config(None, {"live.period_s": 5})
    assert [period_s(config, FitWorker(n)) for n in (1, 12, 120)] == [1, 1, 10]
    assert period_s(config, FitWorker(120, slower=4)) == 40
    assert [period_s(given, FitWorker(1200, slower)) for slower in (1, 2)] == [5, 10]


@given(st.lists(st.tuples(st.integers(0, BURST_BYTES), st.integers(-2 * S, 20 * S)), max_size=30))
def test_no_more_is_taken_than_the_time_allows(said: list[tuple[int, int]]) -> None:
    allowance, now_ns, time_s, taken = Allowance(), 1000 * S, 0.0, 0
    for size, step_ns in said:
        now_ns += step_ns
        time_s += max(0, step_ns) * 1e-9
        left = BURST_BYTES + SECOND_BYTES * time_s - taken
        fits = allowance.takes("a", size, now_ns)
        taken += size if fits else 0
        assert not fits or size <= left + 1
    assert taken <= BURST_BYTES + SECOND_BYTES * time_s + 1


@pytest.mark.parametrize(("rate_hz", "outage_s"), [(100, 0), (100, 3600), (1000, 500), (8000, 0), (4000, 60)])
def test_whoever_catches_up_loses_nothing(rate_hz: int, outage_s: int) -> None:
    """After an outage, a device sends all messages that it has kept at one time, and then continues as usual.

    The ingest reads these messages an hour later, all at one time.
    """
    inbox, message = Inbox(10, 1 << 20), bytes(28 * rate_hz + 121)
    inbox.admission.admit("a")
    begin_ns = host_ns() - 3600 * S
    for k in range(outage_s + 600):
        inbox.put("a", message, 0, k + 1, begin_ns + max(0, k - outage_s) * S)
        assert inbox.take(0)[0]
    assert not inbox.overflow_bytes


@pytest.mark.parametrize("is_stream", [True, False])
def test_whoever_floods_loses_its_own_and_is_named(is_stream: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    inbox, message = Inbox(10, 1 << 20), bytes(100_000)
    for name in ("flood", "quiet"):
        inbox.admission.admit(name)
    losses, begin_ns, taken = Losses(inbox, "nats://server"), host_ns() - 3600 * S, 0
    for k in range(6000):  # the device "flood" sends 10 MB a second
        now_ns = begin_ns + k * S // 100
        if is_stream:
            more: Any = (0, 2 * k + 1, now_ns)
        else:
            more = ()
            monkeypatch.setattr("fltea.service.ingest.inbox.host_ns", lambda now_ns=now_ns: now_ns)
        inbox.put("flood", message, *more)
        inbox.put("quiet", b"frames", *more)
        items, _ = inbox.take(0)
        assert items[-1].device == "quiet"
        taken += len(items) - 1
    size = len(message) + MESSAGE_BYTES
    assert taken == pytest.approx((BURST_BYTES + 60 * SECOND_BYTES) / size, rel=0.01)
    assert inbox.overflow_bytes == {"flood": (6000 - taken) * len(message)}
    ((kind, text, *_),) = losses.check(0)
    assert kind == "frames_overflow"
    assert f"flood ({(6000 - taken) * len(message)} bytes)" in text
    assert "which publishes too much" in text


def test_a_message_from_the_future_waits_for_nothing() -> None:
    inbox = Inbox(10, 1 << 20)
    inbox.admission.admit("a")
    inbox.put("a", b"frames", 0, 1, host_ns() + 3600 * S)
    ((_, _, arrived_ns, *_),), _ = inbox.take(0)
    assert arrived_ns <= host_ns()
