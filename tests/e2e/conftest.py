import sys
from collections.abc import Iterator

import pytest
from support import ROOT, Processes

sys.path.insert(0, str(ROOT / "tests/estimator"))  # for its device_probe


@pytest.fixture
def processes() -> Iterator[Processes]:
    started = Processes()
    yield started
    started.kill()
