from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from host_support import Processes
from mosquitto_support import Stage

if TYPE_CHECKING:
    from playwright.sync_api import Browser


@pytest.fixture
def processes() -> Iterator[Processes]:
    started = Processes()
    yield started
    started.kill()


@pytest.fixture
def stage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Stage]:
    """Brokers and servers, and who listens to them."""
    for name in ("FLTEA_MQTT_USER", "FLTEA_MQTT_PASSWORD"):
        monkeypatch.delenv(name, raising=False)
    with Stage(tmp_path) as one:
        yield one


@pytest.fixture(scope="module")
def chromium() -> "Iterator[Browser]":
    from browser_support import browsers  # the library is an extra

    yield from browsers()
