"""Tests of the order in which outputs are opened.

The output of records comes first, so that it includes what other outputs report while they are opened.
"""

import pytest
from fltea.records.ports import Report
from fltea.service.hub import Hub
from fltea.service.open_outputs import open_outputs
from fltea.settings.config import load_config
from fltea.sinks.page import sink as page

from tests.rig.host_support import closed
from tests.rig.memory_sink import Memory


def test_what_an_output_reports_while_it_is_opened_is_in_the_lines(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    class Page(Memory):
        url = "http://127.0.0.1:8/"

        def __init__(self, settings: object, devices: object, report: Report, recorder: object) -> None:
            super().__init__("dashboard")
            report("too_many_connections", "somebody was quick.")

    monkeypatch.setattr(page, "DashboardSink", Page)
    hub = Hub(lambda error: None)
    settings = {"source": "synthetic:", "name": "one", "format": "ndjson", "dashboard.address": "0"}
    open_outputs([load_config(None, settings)], hub)
    assert closed(hub)
    said = capfd.readouterr()
    assert '"too_many_connections"' in said.out
    assert "live page at http://127.0.0.1:8/" in said.err
