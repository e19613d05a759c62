"""The faults' own tools: books of samples that find what nobody counted, and a line that can be cut."""

import contextlib
import socket
from typing import Any, cast

import pytest

from tools.fault_script.cut_line import CutLine
from tools.fault_script.program import Program
from tools.faults.row import Row
from tools.faults.sample_books import account


class Worker:
    """Records as a program's."""

    def __init__(self, *records: dict[str, Any]) -> None:
        self._records = records

    def of(self, kind: str) -> list[dict[str, Any]]:
        return [record for record in self._records if record["class"] == kind]

    def errors(self) -> list[str]:
        return [record["kind"] for record in self.of("error")]


def walked(*numbers: int) -> list[dict[str, Any]]:
    return [{"class": "sample", "device": "a", "seq": seq} for seq in numbers]


def gap(seq: int, missing: int) -> dict[str, Any]:
    return {"class": "gap", "device": "a", "seq": seq, "missing": missing}


def books(*workers: Worker, published: int = 300) -> Row:
    return account("a fault", ["a"], published, [cast(Program, worker) for worker in workers])


def test_every_sample_is_delivered_or_lost_or_of_the_first_message() -> None:
    row = books(
        Worker(*walked(*range(100, 200)), {"class": "error", "kind": "nats_lost"}),
        Worker(*walked(*range(150, 210)), gap(210, 5), *walked(*range(215, 300))),
    )
    assert row.is_right
    assert list(row.where.values()) == [195, 5, 100]
    assert row.told == ["nats_lost"]
    assert "50 delivered twice" in row.more


@pytest.mark.parametrize(
    ("records", "text"),
    [
        ([*walked(*range(100, 290))], "nobody knows of: 10 of a from 290"),
        ([*walked(*range(100, 301))], "nobody sent: 1 of a from 300"),
        ([*walked(*range(100, 300)), gap(120, 3)], "counted as lost, but delivered: 3 of a from 120"),
    ],
)
def test_what_is_wrong_is_named(records: list[dict[str, Any]], text: str) -> None:
    row = books(Worker(*records))
    assert row.wrong == [text]
    assert not row.is_right


def test_a_line_that_is_cut_holds_back_what_is_sent_and_its_end() -> None:
    with contextlib.ExitStack() as stack:
        server = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
        line = stack.enter_context(contextlib.closing(CutLine(server.getsockname()[1])))
        client = stack.enter_context(socket.create_connection(("127.0.0.1", line.port), timeout=10))
        there, _ = server.accept()
        stack.enter_context(there)
        there.settimeout(10)
        client.sendall(b"before")
        assert there.recv(10) == b"before"
        line.cut()
        client.sendall(b"meanwhile")
        client.shutdown(socket.SHUT_WR)
        there.settimeout(0.1)
        with pytest.raises(TimeoutError):
            there.recv(10)
        there.settimeout(10)
        line.heal()
        assert (there.recv(10), there.recv(10)) == (b"meanwhile", b"")
