"""Who floods a stream loses its own; who catches up, after an outage or in another's place, loses nothing."""

import pytest
from fltea.records.clock import host_ns
from fltea.service.ingest.floods import BURST_BYTES, MESSAGE_BYTES, SECOND_BYTES, Allowance
from fltea.service.ingest.inbox import Inbox
from fltea.service.ingest.losses import Losses
from hypothesis import given
from hypothesis import strategies as st

S = 10**9


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
    """A device that its server did not have for some time sends all of it at once, then goes on; all is read
    in a moment, an hour later."""
    inbox, message = Inbox(10, 1 << 20), bytes(28 * rate_hz + 121)
    inbox.admission.admit("a")
    begin_ns = host_ns() - 3600 * S
    for k in range(outage_s + 600):
        inbox.put("a", message, 0, k + 1, begin_ns + max(0, k - outage_s) * S)
        assert inbox.take(0)
    assert not inbox.overflow()


def test_whoever_floods_loses_its_own_and_is_named() -> None:
    inbox, message = Inbox(10, 1 << 20), bytes(100_000)
    for name in ("flood", "quiet"):
        inbox.admission.admit(name)
    losses, begin_ns, taken = Losses(inbox, "nats://server"), host_ns() - 3600 * S, 0
    for k in range(6000):  # 10 MB a second
        inbox.put("flood", message, 0, 2 * k + 1, begin_ns + k * S // 100)
        inbox.put("quiet", b"frames", 0, 2 * k + 2, begin_ns + k * S // 100)
        items = inbox.take(0)
        assert items[-1].device == "quiet"  # type: ignore[union-attr]
        taken += len(items) - 1
    size = len(message) + MESSAGE_BYTES
    assert taken == pytest.approx((BURST_BYTES + 60 * SECOND_BYTES) / size, rel=0.01)
    assert inbox.overflow() == {"flood": (6000 - taken) * len(message)}
    ((kind, text, *_),) = losses.look(0)
    assert kind == "frames_overflow"
    assert f"flood ({(6000 - taken) * len(message)} bytes)" in text
    assert "which floods" in text


def test_a_message_from_the_future_waits_for_nothing() -> None:
    inbox = Inbox(10, 1 << 20)
    inbox.admission.admit("a")
    inbox.put("a", b"frames", 0, 1, host_ns() + 3600 * S)
    ((_, _, arrived_ns, *_),) = inbox.take(0)
    assert arrived_ns <= host_ns()  # type: ignore[operator]
