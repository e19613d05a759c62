"""Tests of which requests our web servers accept. This depends on the host name in a request and on the page
from which the request comes.

Further tests are about addresses at which a server cannot listen.
"""

import errno
import socket

import pytest
from fltea.records.errors import FlteaError, UsageError
from fltea.settings.config import load_config
from fltea.settings.outputs import DashboardConfig, MetricsConfig, listen_address
from fltea.sinks.listening import cannot_listen, is_from_here, is_own, own_names, url_of
from fltea.sinks.metrics.sink import MetricsSink
from fltea.sinks.page.sink import DashboardSink

from tests.rig.host_support import fltea_here

MACHINE = ["127.0.0.1", "localhost", "LOCALHOST:9100", "[::1]:9100", "192.168.1.7:9100", socket.gethostname()]
OTHERS = ["evil.example", "evil.example:9100", "localhost.evil.example", "127.0.0.1.evil.example", "1.2.3"]


@pytest.mark.parametrize("host", [*MACHINE, *OTHERS, "", "[::1"])
def test_only_names_of_this_machine_and_bare_addresses_are_own(host: str) -> None:
    """Requests are answered only under names of this machine, which prevents DNS rebinding.

    In DNS rebinding, the name of another site is made to lead to this machine, so that a page of that site
    could read our answers.
    """
    assert is_own(host, own_names("127.0.0.1", ())) == (host in MACHINE)


def test_further_names_can_be_given() -> None:
    names = own_names("10.0.0.5", ["Page.example"])
    assert {"localhost", "10.0.0.5", "page.example"} <= names
    assert [is_own(host, names) for host in ("page.example", "pages.example")] == [True, False]


@pytest.mark.parametrize(
    ("origin", "is_ours"),
    [
        (None, True),
        ("http://PI:5006", True),
        ("http://evil.example", False),
        ("http://pi:1", False),
        ("null", False),
        ("http://[::1", False),
    ],
)
def test_a_page_of_elsewhere_is_not_from_here(origin: str | None, is_ours: bool) -> None:
    assert is_from_here("pi:5006", origin) is is_ours


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("9100", ("127.0.0.1", 9100)),
        ("0.0.0.0:9100", ("0.0.0.0", 9100)),
        ("[::1]:9100", ("::1", 9100)),
        ("pi.local:0", ("pi.local", 0)),
    ],
)
def test_listen_address(text: str, expected: tuple[str, int]) -> None:
    assert listen_address(text) == DashboardConfig(address=text).listen() == expected
    assert DashboardConfig(address=5006).listen() == ("127.0.0.1", 5006)
    assert url_of(*expected) == f"http://{text if ':' in text else f'127.0.0.1:{text}'}/"


@pytest.mark.parametrize(
    "address", ["", "x", ":9100", "pi:", "127.0.0.1:", "65536", "-1", "::1", "::1:9100", "²", 70000]
)
@pytest.mark.parametrize("table", ["metrics", "dashboard"])
def test_no_listen_address(table: str, address: str | int) -> None:
    with pytest.raises(UsageError, match=rf"{table}\.address"):
        load_config(None, {f"{table}.address": address})


@pytest.mark.parametrize("host", ["203.0.113.7", "no-such-name.invalid"])
def test_address_of_elsewhere_is_told_with_what_to_do(host: str) -> None:
    words = f"{host} is not an address of this machine: leave"
    with pytest.raises(UsageError, match=f"--metrics: {words}"):
        MetricsSink(MetricsConfig(address=f"{host}:0"), list, lambda *error: None)
    with pytest.raises(UsageError, match=f"--dashboard: {words}"):
        DashboardSink(DashboardConfig(address=f"{host}:0"), {"due": "host"}, lambda *error: None)


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (OSError(errno.EADDRINUSE, ""), 1, "port 80 of pi is taken by another program .* give another port"),
        (PermissionError(errno.EACCES, ""), 2, "need the rights of root: give a port from 1024 on, not 80"),
        (OSError(errno.ENFILE, "too many"), 2, "cannot listen on pi:80: .*too many"),
    ],
)
def test_what_hinders_is_told_with_what_to_do(error: OSError, code: int, words: str) -> None:
    with pytest.raises(FlteaError, match=f"^--listen: .*{words}") as told:
        raise cannot_listen("--listen", "pi", 80, error)
    assert told.value.exit_code == code


@pytest.mark.parametrize("host", ["127.0.0.1", "0.0.0.0"])
def test_the_page_and_the_metrics_at_one_port_are_refused_by_name(host: str) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    outputs = ("--dashboard", str(port), "--metrics", f"{host}:{port}")
    done = fltea_here("run", "-s", "synthetic:?n=100", "--once", "--format", "none", *outputs)
    assert done.returncode == 2
    assert f"--metrics: the live page has the port {port}, too. Give another port." in done.stderr
