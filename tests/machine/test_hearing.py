"""Tests of listening to a device (a pseudo-terminal that sends), and of comparing the device's clock with the
host's.
"""

from collections.abc import Iterator

import numpy as np
import pytest
from fltea.machine.doctor import hearing
from fltea.machine.doctor.hearing import drift, hear
from fltea.records.errors import UsageError
from fltea.sources import wire_events
from fltea.wire import layout as wire
from fltea.wire.messages import encode

from tests.rig.host_support import WIRE_HELLO
from tests.rig.terminal import SpeakingPort, speaking


@pytest.fixture
def speaker() -> Iterator[SpeakingPort]:
    with speaking(lambda turn: b"", 0.01) as port:
        yield port


def frames(turn: int, hello: wire.Hello = WIRE_HELLO) -> bytes:
    """Return the frames that the device sends in one turn: a sample, but none in every tenth turn.

    In every fifth turn, HELLO and STATUS come before the sample.
    """
    said = b"\0"
    if turn % 5 == 0:
        said += encode(hello, turn, turn * 10_000)
        said += encode(wire.Status(0, 3, 0, 0, 0, wire.ResetCause.USER, 0, 0), turn, turn * 10_000)
    if turn % 10:
        said += encode(wire.Sample(turn, 0, 0, 0, 0, 16384, 0, 0), turn, turn * 10_000)
    return said


def test_a_device_is_summed_up(speaker: SpeakingPort) -> None:
    speaker.speech = frames
    heard = hear(speaker.port, hear_s=0.5)
    assert heard.opened
    assert heard.failure is None
    assert heard.hello.firmware_version == "1.2.3"
    assert heard.status is not None
    assert heard.link.frames > heard.delivered > 5
    assert 0 < heard.lost < heard.delivered
    assert heard.rate_hz == pytest.approx(100.0)


def test_without_time_to_listen_it_ends_with_hello(speaker: SpeakingPort) -> None:
    speaker.speech = frames
    heard = hear(speaker.port, hear_s=0.0)
    assert heard.hello is not None
    assert heard.drift is None


@pytest.mark.timeout(20)
def test_another_protocol_ends_it_at_once(speaker: SpeakingPort, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hearing, "PATIENCE_S", 1000.0)
    speaker.speech = lambda turn: frames(turn, WIRE_HELLO._replace(protocol_major=9))
    heard = hear(speaker.port, hear_s=60.0)
    assert heard.failure.kind == "version"
    assert heard.hello is None


@pytest.mark.parametrize(
    ("speech", "kind"),
    [(b"", "silent"), (b"no frame of ours\0", "no_valid_frame"), (frames(1), "no_hello")],
)
def test_what_is_no_device_of_ours(
    speaker: SpeakingPort, monkeypatch: pytest.MonkeyPatch, speech: bytes, kind: str
) -> None:
    monkeypatch.setattr(wire_events, "LIMIT_NS", int(0.3e9))
    speaker.speech = lambda turn: speech
    heard = hear(speaker.port)
    assert heard.failure.kind == kind


def test_patience_ends(speaker: SpeakingPort, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hearing, "PATIENCE_S", 0.2)
    heard = hear(speaker.port)
    assert heard.opened
    assert (heard.failure, heard.hello) == (None, None)


def test_a_port_that_is_not_there_or_cannot_be() -> None:
    heard = hear("/dev/no-such-port")
    assert not heard.opened
    assert heard.failure.kind == "no_port"
    with pytest.raises(UsageError, match="1200 baud"):
        hear("/dev/no-such-port", baud=1200)


@pytest.mark.parametrize("ppm", [-80.0, 0.0, 5000.0])
def test_drift_is_found_within_its_error(ppm: float) -> None:
    """The delays of the samples are like those of a USB bridge: never negative, and sometimes long."""
    z_scores = []
    for seed in range(30):
        delay_s = np.random.default_rng(seed).exponential(1e-3, 400)
        device_us = np.arange(400) * 10_000
        host_ns = device_us * 1000 / (1 + ppm * 1e-6) + delay_s * 1e9
        found = drift(list(zip(device_us.tolist(), host_ns.astype(np.int64).tolist(), strict=True)))
        assert found.std_ppm < 60
        z_scores.append((found.ppm - ppm) / found.std_ppm)
    assert abs(np.mean(z_scores)) < 0.6
    assert np.std(z_scores) < 2.0


def test_drift_needs_some_time() -> None:
    assert drift([(0, 5), (10_000, 10_000_005)]) is None
    assert drift([(i * 10_000, i * 10_000_000) for i in range(120)]) is None
    assert drift([(i * 10_000, i * 10_000_000) for i in range(160)]) == (0.0, 0.0)
