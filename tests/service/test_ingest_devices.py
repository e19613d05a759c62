"""A device whose stream fails does not affect the other devices of its broker."""

from collections.abc import Iterator

import pytest
from fltea.records.clock import host_ns
from fltea.records.errors import FlteaError
from fltea.records.events import Chunk, Event, Opened, Reads
from fltea.service.hub import Hub
from fltea.service.ingest import devices
from fltea.service.ingest.inbox import Inbox
from fltea.settings.config import Config
from fltea.sources.frames import FramesSource
from fltea.stream.fit_worker import FitWorker

from tests.rig.host_support import closed


class _Failing(FramesSource):
    def take(self, item: Opened | Chunk | Reads | None) -> Iterator[Event]:
        if self.url.endswith("/bad") and isinstance(item, Chunk):
            raise FlteaError("no room")
        return super().take(item)


def test_one_device_that_fails_is_reported_once_and_tried_again_after_a_minute(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(devices, "FramesSource", _Failing)
    reported: list[tuple[str, str]] = []
    hub, url = Hub(lambda error: None), "mqtt://broker.example"
    inbox, worker = Inbox(10, 1 << 20), FitWorker()
    walked = devices.Devices(
        Config(source=url), hub, inbox, url, lambda *told: reported.append(told), None, worker, lambda: None
    )
    for _ in range(2):
        for name in ("bad", "good"):
            if name not in walked.opened:
                walked.open(name, host_ns())
            walked.feed(name, Chunk(b"\0", host_ns()))
    now_ns = host_ns()
    assert [kind for kind, _ in reported] == ["line_broken"]
    assert reported[0][1].startswith("bad: ")
    assert "no room" in reported[0][1]
    assert [*walked.opened] == ["good"], "a stream that failed is ended"
    assert [walked.is_broken(name, now_ns) for name in ("bad", "good")] == [True, False]
    assert not walked.is_broken("bad", now_ns + devices.FAULT_NS)
    walked.finish("good", moved=False)
    assert closed(hub)
