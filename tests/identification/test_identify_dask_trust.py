"""A cluster over plain TCP is warned of: its messages are pickles, which run what their sender says."""

import pytest
from fltea.cli import identify as command
from fltea.identification.dask_trust import trust_warning
from fltea.records.errors import UsageError


@pytest.mark.parametrize(
    "address",
    ["tls://10.0.0.5:8786", "wss://lab.example:8786", "tcp://127.0.0.1:8786", "[::1]:8786", "localhost:8786"],
)
def test_nobody_else_is_on_the_way(address: str) -> None:
    assert trust_warning(address) is None


@pytest.mark.parametrize(
    "address",
    [
        "tcp://10.0.0.5:8786",
        "10.0.0.5:8786",
        "tcp://localhost.evil.example:8786",
        "ws://lab.example",
        "ucx://10.0.0.5:1",
    ],
)
def test_anybody_may_be(address: str) -> None:
    text = trust_warning(address)
    assert text is not None
    assert f"--dask {address}" in text
    assert "tls://" in text


def test_told_before_anything_is_connected(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(*arguments: object) -> None:
        assert "warning: --dask tcp://192.0.2.1:8786: not encrypted" in capsys.readouterr().err
        raise UsageError("no scheduler")

    monkeypatch.setattr(command, "load", refuse)
    with pytest.raises(UsageError, match="no scheduler"):
        command._workers(None, "tcp://192.0.2.1:8786")


def test_tls_without_a_certificate_says_what_to_set() -> None:
    from fltea.identification.dask_workers import DaskWorkers

    with pytest.raises(UsageError, match=r"no certificate to show.*CLIENT__CERT"):
        DaskWorkers("tls://192.0.2.1:8786")
