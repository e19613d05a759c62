"""Tests of the output that serves the live page: how the output opens, serves and ends, and that it needs
nothing but records.
"""

import ast
import json
import threading
from pathlib import Path

import pytest
from fltea.records.errors import FlteaError
from fltea.settings.outputs import DashboardConfig
from fltea.sinks import page
from fltea.sinks.page.sink import DashboardSink
from msgspec.structs import replace

from tests.rig.dashboard_support import records
from tests.rig.host_support import ask, port_of, wait_until


def no_report(kind: str, message: str) -> None:
    raise AssertionError((kind, message))


def make(port: int = 0, visitors: int = 20) -> DashboardSink:
    return DashboardSink(DashboardConfig(address=port, visitors=visitors), {"due": "host"}, no_report)


def test_it_serves_what_it_is_given_and_its_end_leaves_no_thread_and_frees_the_port() -> None:
    before = set(threading.enumerate())
    sink = make()
    port = port_of(sink.url)
    with pytest.raises(FlteaError, match=f"port {port} of 127.0.0.1 is taken .* give another port"):
        make(port)
    for record in records("n=200"):
        sink.write(replace(record, device="due"))
    assert "fltea" in ask(port).text
    found = json.loads(ask(port, "/state?parts=now:,axes:").text)
    assert (found["device"], found["parts"]["now"][1]["seq"]) == ("due", 199)
    assert [axis["name"] for axis in found["parts"]["axes"][1]] == ["gyro_x", "gyro_y", "gyro_z"]
    sink.close()
    wait_until(lambda: before.issuperset(threading.enumerate()), "the end of its threads")
    make(port).close()


def test_a_visitor_too_many_is_told_how_to_be_let_in() -> None:
    """A visitor beyond the limit is told how to be let in. In an earlier version, 200 visitors who shared one
    session were let in although 20 were allowed, and took 260 MB.
    """
    reports: list[str] = []
    config = DashboardConfig(address=0, visitors=1)
    sink = DashboardSink(config, {"due": "host"}, lambda kind, text: reports.append(kind))
    port = port_of(sink.url)
    found = [ask(port, "/state?parts=now:") for _ in range(40)]
    assert [one.status for one in found[:15]] == [200] * 15
    refused = next(one for one in found if one.status != 200)
    assert refused.status == 503
    assert "1 visitors" in refused.text
    assert "--set dashboard.visitors=2" in refused.text
    assert reports == ["too_many_visitors"]
    sink.close()


def test_the_page_knows_only_what_records_say() -> None:
    """The code of the live page imports neither the estimator nor the pipeline, which use native objects.
    A thread of the page that still runs at the program's end must not hold any.

    The code that writes downloads does not import them either.
    """
    folder = Path(page.__file__).parent
    found = {module for file in folder.glob("*.py") for module in modules_of(file)}
    rooms = {"diagnostics", "documents", "records", "settings", "sinks"}
    assert {module.split(".")[1] for module in found} == rooms
    written = list((folder.parents[1] / "documents").glob("*.py"))
    assert len(written) > 2
    known = {module for file in written for module in modules_of(file)}
    assert {module for module in known if not module.startswith("fltea.documents.")} <= {
        "fltea.records.arrays",
        "fltea.records.fit",
        "fltea.records.units",
        "fltea.records.version",
        "fltea.records.visible",
    }


def modules_of(file: Path) -> set[str]:
    """Return the modules of fltea from which a file imports."""
    nodes = ast.walk(ast.parse(file.read_text()))
    names = {node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)}
    return {name for name in names if name.startswith("fltea.")}
