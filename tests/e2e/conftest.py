from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest
from support import Processes

if TYPE_CHECKING:
    from playwright.sync_api import Browser


@pytest.fixture
def processes() -> Iterator[Processes]:
    started = Processes()
    yield started
    started.kill()


@pytest.fixture(scope="module")
def chromium() -> "Iterator[Browser]":
    from browser_support import browsers  # the library is an extra

    yield from browsers()
