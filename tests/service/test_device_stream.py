"""Tests of the stream of one device.

Outputs that take single records receive the same values as outputs that take blocks.
"""

import io

import pytest
from fltea.records.records import Fit
from fltea.service.device_stream import DeviceStream
from fltea.service.hub import Hub
from fltea.settings.config import load_config
from fltea.sinks.ndjson import NdjsonSink
from fltea.sinks.record_json import record_json

from tests.rig.blocks import of, records_of
from tests.rig.device_stream_support import SMALL, Source, raw
from tests.rig.host_support import closed, hello
from tests.rig.memory_sink import Memory


@pytest.mark.parametrize("size", [7, 300])
def test_what_is_printed_states_each_fit_as_soon_as_it_counts(size: int) -> None:
    hub, output, blocks = Hub(lambda error: None), io.BytesIO(), Memory(capacity=100_000)
    hub.add(NdjsonSink(output, samples=True))
    hub.add(blocks)
    stream = DeviceStream(Source(), load_config(None, SMALL | {"live.period_s": 0.5}), hub, None)
    for boot in range(2):
        stream.take(hello(boot_id=boot))
        for begin in range(0, 600, size):
            stream.take(raw(range(600 * boot + begin, 600 * boot + min(begin + size, 600))))
    assert closed(hub)
    assert len(of(Fit, blocks.items)) > 4
    assert output.getvalue().splitlines() == [record_json(one) for one in records_of(blocks.items)]
