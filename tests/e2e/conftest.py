from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from tests.rig.host_support import Processes, each_ended
from tests.rig.mosquitto_support import Stage
from tests.rig.nats_support import single
from tests.rig.nats_worker import Servers, Start, Worker
from tools.faults.server import Server

if TYPE_CHECKING:
    from playwright.sync_api import Browser


@pytest.fixture
def processes() -> Iterator[Processes]:
    started = Processes()
    yield started
    started.kill()


@pytest.fixture
def stage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Stage]:
    """Provide an object that starts MQTT brokers, servers and clients, and stops them after the test."""
    for name in ("FLTEA_MQTT_USER", "FLTEA_MQTT_PASSWORD"):
        monkeypatch.delenv(name, raising=False)
    with Stage(tmp_path) as one:
        yield one


@pytest.fixture(scope="module")
def chromium() -> "Iterator[Browser]":
    # The browser library is an optional dependency, so it is imported only here.
    from tests.rig.browser_support import browsers

    yield from browsers()


@pytest.fixture
def server(stage: Stage, tmp_path: Path) -> Servers:
    """Return a function that starts NATS servers."""

    def make(**options: Any) -> Server:
        one = single(tmp_path / "nats", **options)
        stage.callback(one.kill)
        return one

    return make


@pytest.fixture
def start() -> Iterator[Start]:
    """Return a function that starts workers of a NATS server."""

    def make(server: Server, **settings: Any) -> Worker:
        return Worker(f"nats://127.0.0.1:{server.port}", **settings)

    yield from each_ended(make, lambda one: one.frames.close())
