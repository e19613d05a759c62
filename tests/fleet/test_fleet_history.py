"""Tests of the fleet's history of fits and alerts: what is stored, how old rows are deleted, and that faults
do not damage it.
"""

import contextlib
import math
import os
import signal
import sqlite3
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from fltea.fleet import databases
from fltea.fleet import history as histories
from fltea.fleet.clock import Clock
from fltea.fleet.databases import Sqlite
from fltea.fleet.history import COLUMNS, TABLES, History
from fltea.fleet.history_table import write
from fltea.fleet.roll import Axis
from fltea.records.errors import UsageError

from tests.rig.history_support import add, axis, opened, rows_of, times_of, write_out
from tests.rig.host_support import PATIENCE_S, fltea_here


@pytest.fixture
def history(tmp_path: Path) -> Iterator[History]:
    """Yield a history in a file, in which every fit is stored."""
    made = opened(tmp_path / "h.db", 0.0)
    yield made
    made.close()


def database(history: History) -> Sqlite:
    assert isinstance(history._database, Sqlite)
    return history._database


def test_fits_are_kept_now_and_then_and_at_each_change(tmp_path: Path) -> None:
    history = opened(tmp_path / "h.db", 60.0)
    for second in range(200):
        history.add(1000.0 + second, "a", {"gyro_x": axis("drift" if second >= 130 else "white", second)})
    history.add_alert(1100.0, "raised", "silent", "a", "text")
    write_out(history)
    found = rows_of(history, "a")
    assert [(row["unix_s"], row["verdict"]) for row in found] == [
        (1000.0, "white"), (1060.0, "white"), (1120.0, "white"), (1130.0, "drift"), (1190.0, "drift"),
    ]  # fmt: skip
    assert (found[1]["N"], found[1]["N_low"], found[1]["K"]) == (60.0, 59.9, None)
    assert [row["unix_s"] for row in rows_of(history, "a", most=2)] == [1130.0, 1190.0]
    assert rows_of(history, "b") == []
    assert write_out(history, 1125.0) == 4  # the four deleted rows are three fits and the alert
    assert times_of(history, "a") == [1130.0, 1190.0]
    assert history.alerts().result() == []
    # this time is before all others: the clock was set back
    history.add(500.0, "a", {"gyro_x": axis("drift")})
    write_out(history)
    assert times_of(history, "a") == [500.0, 1130.0, 1190.0]
    history.close()


CHILD = """
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from fltea.fleet.databases import Sqlite
from fltea.fleet.history import TABLES, History
from fltea.fleet.roll import Axis
history = History(Sqlite(Path(sys.argv[1]), TABLES), 0.0)
for number in range(10**9):
    history.add(float(number), "a", {axis: Axis("white", "", "deg/s", number, {}, 0.0) for axis in "xyz"})
    history.work()
    history.settle()
    print(number, flush=True)
"""


def test_kill_9_leaves_whole_transactions(tmp_path: Path) -> None:
    path = tmp_path / "h.db"
    with subprocess.Popen([sys.executable, "-c", CHILD, path], stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        told = -1
        while told < 50:
            told = int(child.stdout.readline())
        child.send_signal(signal.SIGKILL)
        told = max([told, *(int(line) for line in child.stdout.read().splitlines())])
    history = opened(path, 0.0)
    rows = list(history._database.rows(f"SELECT {', '.join(COLUMNS)} FROM fit ORDER BY unix_s"))
    numbers = [row[COLUMNS.index("samples")] for row in rows]
    assert numbers == [number for number in range(len(rows) // 3) for _ in range(3)]
    assert len(rows) // 3 >= told + 1  # at least the rows that were reported as stored are there
    history.close()


def test_rows_wait_for_room_on_a_full_disk(history: History, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows wait as long as there is room in memory. Further rows are lost and counted."""
    monkeypatch.setattr(histories, "MOST_WAITING", 300)
    pages = database(history).connection.execute("PRAGMA page_count").fetchone()[0]
    database(history).connection.execute(f"PRAGMA max_page_count = {pages}")
    add(history, *range(500))
    write_out(history)
    assert (history.lost, history.waiting, history.trouble_kind) == (200, 300, "disk_full")
    assert "is the disk full?" in history.trouble
    database(history).connection.execute("PRAGMA max_page_count = 100000")
    write_out(history)
    assert (history.trouble, history.trouble_kind, history.waiting) == ("", "", 0)
    assert times_of(history, "a") == list(range(300))


def test_rows_that_find_their_place_taken_are_counted(
    history: History, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While three rows are sent to the database, it goes away, and two more rows come. Only three rows may
    wait here, so the two new ones are lost, and counted.
    """
    monkeypatch.setattr(histories, "MOST_WAITING", 3)

    def away(commands: object) -> None:
        add(history, 3.0, 4.0, device="b")
        raise sqlite3.OperationalError

    monkeypatch.setattr(history._database, "write", away)
    add(history, 0.0, 1.0, 2.0)
    history.work(-math.inf)
    history.settle()
    assert (history.lost, history.waiting) == (2, 3)
    monkeypatch.undo()


def test_what_a_closed_history_could_not_write_is_lost(tmp_path: Path) -> None:
    history = opened(tmp_path / "h.db", 0.0)
    database(history).connection.execute("PRAGMA query_only = 1")
    add(history, 1.0)
    history.close()
    assert (history.lost, history.trouble_kind) == (1, "history_lost")


def test_a_device_that_alternates_or_renames_its_axes_fills_nothing(tmp_path: Path) -> None:
    history = opened(tmp_path / "h.db", 600.0)
    for second in range(1200):
        history.add(1000.0 + second, "a", {"gyro_x": axis("white" if second % 2 else "drift")})
    for number in range(100):
        history.add(5000.0, "b", {f"axis{number}": axis()})
    write_out(history)
    assert len(rows_of(history, "a")) == 20  # one row for each minute is stored
    assert (len(rows_of(history, "b")), history.lost) == (6, 94)
    history.forget(["b"])
    add(history, 5000.0, device="b")
    write_out(history)
    assert len(rows_of(history, "b")) == 7
    history.close()


def test_in_memory_the_newest_rows_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(databases, "MEMORY_ROWS", 50)
    history = opened(None, 0.0)
    add(history, *range(120))
    write_out(history)
    assert times_of(history, "a") == list(range(70, 120))
    history.close()


def test_files_that_are_no_history(tmp_path: Path) -> None:
    (tmp_path / "text").write_text("x" * 5000)
    for name, command, words in (
        ("no/folder", "", "cannot be used"),
        ("text", "", "cannot be used as a history"),
        ("newer", "PRAGMA user_version = 9", "another version"),
        ("foreign", "CREATE TABLE bookmarks (url TEXT)", "another program"),
        # the application id of a Fossil checkout
        ("marked", "PRAGMA application_id = 252006674", "another program"),
    ):
        path = tmp_path / name
        if command:
            with contextlib.closing(sqlite3.connect(path)) as other:
                other.execute(command)
        before = path.read_bytes() if path.exists() else None
        with pytest.raises(UsageError, match=words):
            opened(path, 1.0)
        assert before == (path.read_bytes() if path.exists() else None)


def test_a_history_that_is_a_link_or_a_pipe_is_refused(tmp_path: Path) -> None:
    """SQLite would create or fill the file to which a link leads."""
    opened(tmp_path / "mine", 1.0).close()
    (tmp_path / "empty").touch()
    before = {name: (tmp_path / name).read_bytes() for name in ("mine", "empty")}
    for name in ("mine", "empty", "none"):
        (tmp_path / f"to {name}").symlink_to(name)
        with pytest.raises(UsageError, match=r"used as a history .it is a link, and has to be a file"):
            opened(tmp_path / f"to {name}", 1.0)
    (tmp_path / "hard").hardlink_to(tmp_path / "empty")
    with pytest.raises(UsageError, match="hard link to another file"):
        opened(tmp_path / "hard", 1.0)
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(UsageError, match="it is a pipe or a device"):
        opened(tmp_path / "pipe", 1.0)
    assert before == {name: (tmp_path / name).read_bytes() for name in before}
    assert sorted(os.listdir(tmp_path)) == ["empty", "hard", "mine", "pipe", "to empty", "to mine", "to none"]


def test_export(tmp_path: Path) -> None:
    history = opened(tmp_path / "h.db", 0.0)
    for number in range(10):
        history.add(float(number), "ä|b", {"gyro_x": axis(value=number)})
    history.close()
    done = fltea_here("fleet", "--history", tmp_path / "h.db", "--export", tmp_path / "out.parquet")
    assert (done.returncode, done.stderr) == (0, f"{tmp_path}/out.parquet: 10 rows\n")
    found = pq.read_table(tmp_path / "out.parquet").to_pydict()
    assert (found["N"], found["K"][0], found["device_id"][0]) == (list(range(10)), None, "ä|b")
    assert write(Sqlite(tmp_path / "h.db", TABLES), tmp_path / "again.parquet") == 10
    assert not [name for name in os.listdir(tmp_path) if name.endswith(".part")]
    done = fltea_here("fleet", "--export", tmp_path / "x.parquet")
    assert (done.returncode, "no history is named" in done.stderr) == (2, True)


def test_a_wall_clock_that_jumps() -> None:
    times = {"wall": 1000.0, "steady": 5.0}
    clock = Clock(lambda: times["wall"], lambda: times["steady"])
    times |= {"wall": 1010.5, "steady": 15.0}
    assert (clock.unix_s(), clock.jumps) == (1010.0, 0)  # a correction of half a second by NTP is no jump
    times |= {"wall": 4620.0, "steady": 20.0}
    assert (clock.unix_s(), clock.jumps, clock.long_jump) == (4620.0, 1, False)
    times |= {"wall": 4e9, "steady": 21.0}
    assert (clock.unix_s(), clock.jumps, clock.long_jump) == (4e9, 2, True)


def test_a_row_that_no_database_takes_is_lost_alone(history: History) -> None:
    add(history, 1000.0)
    history.add(1001.0, "a", {"gyro_x": Axis("white", "text", "deg/s", 10**30, {}, 0.0)})
    add(history, 1002.0)
    write_out(history)
    assert times_of(history, "a") == [1000.0, 1002.0]
    assert (history.lost, history.trouble) == (1, "")


def test_a_database_that_hangs_holds_up_nobody(history: History, monkeypatch: pytest.MonkeyPatch) -> None:
    """If the database is locked, only its thread waits, and requests to it. All other work continues."""
    go = threading.Event()
    write = database(history).write
    monkeypatch.setattr(database(history), "write", lambda commands: (go.wait(PATIENCE_S), write(commands)))
    add(history, 1.0)
    history.work()
    history.work()
    asked = history.of_device("a")
    add(history, 2.0)
    assert not asked.done()
    go.set()
    assert len(asked.result(PATIENCE_S)) == 2


@pytest.mark.parametrize(
    ("out", "words"), [("gone/o.parquet", "cannot be written"), ("o.csv", "NAME.parquet")]
)
def test_an_export_that_cannot_be_written_is_a_message(tmp_path: Path, out: str, words: str) -> None:
    opened(tmp_path / "h.db", 60.0).close()
    done = fltea_here("fleet", "--history", tmp_path / "h.db", "--export", tmp_path / out)
    assert done.returncode != 0
    assert words in done.stderr
    assert "Traceback" not in done.stderr


def test_a_database_that_fails_costs_no_row(history: History, monkeypatch: pytest.MonkeyPatch) -> None:
    """A damaged database loses no row. A row is left out only if its own values cause the error."""
    add(history, 1.0, 2.0)

    def damaged(commands: object) -> None:
        raise sqlite3.DatabaseError("database disk image is malformed")

    with monkeypatch.context() as patch:
        patch.setattr(history._database, "write", damaged)
        write_out(history)
    assert (history.lost, history.waiting, history.trouble_kind) == (0, 2, "history_lost")
    write_out(history)
    assert (times_of(history, "a"), history.lost, history.trouble) == ([1.0, 2.0], 0, "")
