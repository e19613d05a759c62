"""Tests of the fleet's history on a PostgreSQL server that stops and comes back, refuses commands, or has
changed tables.
"""

import contextlib
import itertools
import signal
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from fltea.cli import fleet
from fltea.fleet import databases
from fltea.fleet import history as histories
from fltea.fleet.databases import Postgres
from fltea.fleet.history import TABLES, History
from fltea.records.errors import UsageError

from tests.rig.history_support import add, axis, rows_of, times_of, write_out
from tests.rig.host_support import PATIENCE_S, each_ended
from tests.rig.postgres_support import Server, started

NUMBERS = itertools.count()
"""Numbers that make the names of databases unique."""


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """Start a server for all tests that do not stop it. Each test has a database of its own."""
    one = started(tmp_path_factory.mktemp("server") / "pg")
    yield one
    one.stop()


@dataclass
class Lab:
    """A database of the shared server that only one test uses."""

    server: Server
    name: str
    encoding: str = "UTF8"

    def __post_init__(self) -> None:
        words = f"TEMPLATE template0 ENCODING '{self.encoding}' LC_COLLATE 'C' LC_CTYPE 'C'"
        self.server.ask(f"CREATE DATABASE {self.name} {words}")

    @property
    def url(self) -> str:
        return self.server.url_of(self.name)

    def ask(self, command: str) -> list[Any]:
        return self.server.ask(command, self.name)


@pytest.fixture
def lab(server: Server, monkeypatch: pytest.MonkeyPatch) -> Lab:
    monkeypatch.setattr(databases, "AGAIN_S", 0.0)
    return Lab(server, f"lab{next(NUMBERS)}")


Keep = Callable[[Lab], History]


@pytest.fixture
def keep() -> Iterator[Keep]:
    """Return a function that makes a history in which every fit is stored."""
    yield from each_ended(lambda lab: History(Postgres(lab.url, TABLES), 0.0), lambda one: one.close())


def postgres(history: History) -> Postgres:
    assert isinstance(history._database, Postgres)
    return history._database


def test_postgres_keeps_the_same_and_may_go_and_come_back(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    server, history = lab.server, History(Postgres(lab.url, TABLES), 0.0)
    try:
        for number in range(10):
            history.add(1000.0 + number, "a", {"gyro_x": axis(value=number)})
        history.add_alert(1005.0, "raised", "silent", "a", "it's text")
        write_out(history)
        found = rows_of(history, "a")
        assert [(row["unix_s"], row["N"], row["K"]) for row in found] == [
            (1000.0 + n, n, None) for n in range(10)
        ]
        assert history.alerts().result()[0]["text"] == "it's text"
        assert write_out(history, 1006.0) == 7
        server.stop()
        add(history, 2000.0)
        write_out(history)
        assert (history.lost, history.waiting, history.trouble_kind) == (0, 1, "history_lost")
        assert rows_of(history, "a") == []
        server.start()
        add(history, 3000.0)
        history.add(3000.0, "nul\0", {"gyro_x": axis()})
        write_out(history)
        assert (history.trouble, history.waiting, history.lost) == ("", 0, 1)
        assert len(rows_of(history, "a")) == 6
        server.signal(signal.SIGSTOP)
        monkeypatch.setattr(histories, "STUCK_S", 0.0)
        add(history, 4000.0)
        history.work()
        history.work()
        history.settle()
        server.signal(signal.SIGCONT)
        assert (history.trouble_kind, history.waiting) == ("history_lost", 1)
        history.close()
        assert history.lost == 1
        lab.ask("UPDATE fltea_fleet SET version = 9")
        with pytest.raises(UsageError, match="another version"):
            Postgres(lab.url, TABLES)
        server.stop()
        with pytest.raises(UsageError, match="Does the server run"):
            Postgres(lab.url, TABLES)
    finally:
        server.start()


READ_ONLY = "ALTER DATABASE {name} SET default_transaction_read_only = "
FULL = """
CREATE FUNCTION full_disk() RETURNS trigger LANGUAGE plpgsql AS
$$ BEGIN RAISE EXCEPTION 'could not extend file' USING ERRCODE = '53100'; END $$;
CREATE TRIGGER full_disk BEFORE INSERT ON fit EXECUTE FUNCTION full_disk()
"""


@pytest.mark.parametrize(
    ("harm", "mend", "kind", "words"),
    [
        (
            READ_ONLY + "on",
            f"BEGIN READ WRITE; {READ_ONLY}off; COMMIT",
            "history_lost",
            "is the server a standby now",
        ),
        ("ALTER TABLE fit RENAME TO f", "ALTER TABLE f RENAME TO fit", "history_lost", "table dropped or"),
        (
            "ALTER TABLE fit RENAME verdict TO v",
            "ALTER TABLE fit RENAME v TO verdict",
            "history_lost",
            '"verdict" of relation "fit" does not exist); was a table dropped or changed?',
        ),
        (FULL, "DROP TRIGGER full_disk ON fit", "disk_full", "is the server's disk full?"),
    ],
)
def test_rows_wait_while_the_server_refuses_them(
    harm: str, mend: str, kind: str, words: str, lab: Lab, keep: Keep
) -> None:
    history = keep(lab)

    def change(command: str) -> None:
        """Change a setting of a database, and connect again, because the change takes effect for new
        connections only.
        """
        lab.ask(command.format(name=lab.name))
        postgres(history)._connection.close()
        write_out(history)

    add(history, 1.0)
    write_out(history)
    add(history, 2.0, 3.0)
    change(harm)
    assert (history.lost, history.waiting, history.trouble_kind) == (0, 2, kind)
    assert words in history.trouble
    change(mend)
    assert (history.lost, history.waiting, history.trouble) == (0, 0, "")
    assert times_of(history, "a") == [1.0, 2.0, 3.0]


@pytest.mark.parametrize("is_committed", [True, False])
def test_a_connection_that_ends_at_a_commit_leaves_each_row_once(
    is_committed: bool, lab: Lab, keep: Keep
) -> None:
    """A connection that is lost during a COMMIT does not show whether the server has executed it."""
    history = keep(lab)
    database = postgres(history)
    add(history, 1.0)
    write_out(history)
    connection = database._connection
    transaction = connection.transaction

    @contextlib.contextmanager
    def cut() -> Iterator[None]:
        with transaction():
            yield
            if not is_committed:
                raise OperationalError("cut")
        raise OperationalError("cut")

    from psycopg import OperationalError

    connection.transaction = cut
    add(history, 2.0, 3.0)
    write_out(history)
    assert (history.waiting, history.trouble_kind) == (2, "history_lost")
    assert lab.ask("SELECT count(*) FROM fit") == [(3 if is_committed else 1,)]
    connection.close()
    add(history, 4.0)
    write_out(history)
    assert times_of(history, "a") == [1.0, 2.0, 3.0, 4.0]
    assert (history.lost, history.waiting, history.trouble) == (0, 0, "")


def test_what_the_server_is_still_writing_is_not_written_twice(lab: Lab, keep: Keep) -> None:
    """A server may continue a transaction whose connection is gone."""
    import psycopg

    history = keep(lab)
    with psycopg.connect(lab.url) as other:
        (number,) = other.execute("SELECT txid_current()").fetchone() or (0,)
        postgres(history)._unsure = number
        add(history, 1.0)
        write_out(history)
        assert (history.waiting, "still under way" in history.trouble) == (1, True)
        other.rollback()
    write_out(history)
    assert times_of(history, "a") == [1.0]
    # `_unsure`: number of a transaction whose connection was lost, so that it may or may not be committed.
    # This number is of another server: it is larger than all numbers of this server.
    postgres(history)._unsure = 10**15
    add(history, 2.0)
    write_out(history)
    assert times_of(history, "a") == [1.0, 2.0]


def test_programs_that_start_together_all_find_the_tables(lab: Lab) -> None:
    ready, failed = threading.Barrier(6), list[UsageError]()

    def start() -> None:
        ready.wait(PATIENCE_S)
        try:
            Postgres(lab.url, TABLES).close()
        except UsageError as error:
            failed.append(error)

    threads = [threading.Thread(target=start) for _ in range(6)]
    for one in threads:
        one.start()
    for one in threads:
        one.join()
    assert failed == []
    assert lab.ask("SELECT * FROM fltea_fleet") == [(databases.SCHEMA_VERSION,)]


def test_columns_that_somebody_adds_change_no_answer(lab: Lab, keep: Keep) -> None:
    history = keep(lab)
    lab.ask("ALTER TABLE alert ADD note TEXT; ALTER TABLE fit ADD note TEXT")
    history.add_alert(1.0, "raised", "silent", "a", "text")
    add(history, 1.0)
    write_out(history)
    (found,) = history.alerts().result()
    assert found == {"unix_s": 1.0, "state": "raised", "kind": "silent", "device_id": "a", "text": "text"}
    assert times_of(history, "a") == [1.0]


@pytest.mark.parametrize(("encoding", "names"), [("SQL_ASCII", ["ä", "日本"]), ("LATIN1", ["ä"])])
def test_names_are_text_whatever_the_encoding_of_the_database(
    encoding: str, names: list[str], server: Server, keep: Keep
) -> None:
    """A name that the database cannot hold is no failure of the database: only its row is lost."""
    history = keep(Lab(server, f"lab{next(NUMBERS)}", encoding))
    for name in ("ä", "日本"):
        add(history, 1.0, device=name)
    write_out(history)
    assert history.lost == 2 - len(names)
    for name in ("ä", "日本"):
        assert [row["device_id"] for row in rows_of(history, name)] == [name] * (name in names)
    assert history.trouble == ""


def test_a_standby_can_be_exported(lab: Lab, keep: Keep, tmp_path: Path) -> None:
    """A standby server can only be read. A fleet that has to write to it reports this when it starts."""
    history = keep(lab)
    add(history, 1.0, 2.0)
    write_out(history)
    lab.ask(READ_ONLY.format(name=lab.name) + "on")
    out = tmp_path / "o.parquet"
    fleet._export(None, lab.url, out)
    assert pq.read_table(out)["unix_s"].to_pylist() == [1.0, 2.0]
    with pytest.raises(UsageError, match="read-only transaction"):
        Postgres(lab.url, TABLES)
