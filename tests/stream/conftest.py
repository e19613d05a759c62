"""Replace the live fit by a quick one in these tests. True fits are tested in tests/spectrum, and once in
test_live_fits.py.
"""

from collections.abc import Iterator

import pytest
from fltea.stream import live

from tests.rig.quick_fit import QuickAxes


@pytest.fixture(scope="module", autouse=True)
def quick_fits() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(live, "LiveAxes", QuickAxes)
        yield
