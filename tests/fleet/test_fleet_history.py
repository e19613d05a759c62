"""The history: what is kept, how it is pruned, and that nothing breaks it."""

import os
import signal
import sqlite3
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from fltea.fleet.databases import Postgres, Sqlite
from fltea.fleet.figures import Figure
from fltea.fleet.history import COLUMNS, TABLES, History
from fltea.fleet.history_table import write
from fltea.fleet.program import Clock
from fltea.fleet.roll import Axis
from fltea.records.errors import UsageError
from host_support import fltea


def opened(path: Path, every_s: float) -> History:
    return History(Sqlite(path, TABLES), every_s)


def database(history: History) -> Sqlite:
    assert isinstance(history._database, Sqlite)
    return history._database


def axis(verdict: str = "white", value: float = 1.0) -> Axis:
    return Axis(verdict, "text", "deg/s", 100, {"N": Figure(value, value - 0.1, value + 0.1)}, 0.0)


def test_fits_are_kept_now_and_then_and_at_each_change(tmp_path: Path) -> None:
    history = opened(tmp_path / "h.db", 60.0)
    for second in range(200):
        history.add(1000.0 + second, "a", "gyro_x", axis("drift" if second >= 130 else "white", second))
    history.add_alert(1100.0, "raised", "silent", "a", "text")
    history.flush()
    found = history.of_device("a")
    assert [(row["unix_s"], row["verdict"]) for row in found] == [
        (1000.0, "white"), (1060.0, "white"), (1120.0, "white"), (1130.0, "drift"), (1190.0, "drift"),
    ]  # fmt: skip
    assert (found[1]["N"], found[1]["N_low"], found[1]["K"]) == (60.0, 59.9, None)
    assert [row["unix_s"] for row in history.of_device("a", most=2)] == [1130.0, 1190.0]
    assert history.of_device("b") == []
    assert history.prune(1125.0) == 4  # three fits and the alert
    assert [row["unix_s"] for row in history.of_device("a")] == [1130.0, 1190.0]
    assert history.alerts() == []
    history.add(500.0, "a", "gyro_x", axis("drift"))  # the clock was set back
    history.flush()
    assert [row["unix_s"] for row in history.of_device("a")] == [500.0, 1130.0, 1190.0]
    history.close()


CHILD = """
import sys
from pathlib import Path
from fltea.fleet.databases import Sqlite
from fltea.fleet.history import TABLES, History
from fltea.fleet.roll import Axis
history = History(Sqlite(Path(sys.argv[1]), TABLES), 0.0)
for number in range(10**9):
    for axis in "xyz":
        history.add(float(number), "a", axis, Axis("white", "", "deg/s", number, {}, 0.0))
    history.flush()
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
    rows = list(history.rows())
    numbers = [row[COLUMNS.index("samples")] for row in rows]
    assert numbers == [number for number in range(len(rows) // 3) for _ in range(3)]
    assert len(rows) // 3 >= told + 1  # all that was told to be there is there
    history.close()


def test_a_full_disk_is_counted_and_told_and_ends(tmp_path: Path) -> None:
    history = opened(tmp_path / "h.db", 0.0)
    pages = database(history).connection.execute("PRAGMA page_count").fetchone()[0]
    database(history).connection.execute(f"PRAGMA max_page_count = {pages}")
    for number in range(500):
        history.add(float(number), "a", "gyro_x", axis())
    history.flush()
    assert history.lost == 500
    assert "is the disk full?" in history.trouble
    database(history).connection.execute("PRAGMA max_page_count = 100000")
    history.add(1000.0, "a", "gyro_x", axis())
    history.flush()
    assert (history.trouble, len(history.of_device("a"))) == ("", 1)
    history.close()


def test_files_that_are_no_history(tmp_path: Path) -> None:
    (tmp_path / "text").write_text("x" * 5000)
    with pytest.raises(UsageError, match="cannot be used as a history"):
        opened(tmp_path / "text", 1.0)
    other = sqlite3.connect(tmp_path / "other")
    other.execute("PRAGMA user_version = 9")
    other.close()
    with pytest.raises(UsageError, match="another version"):
        opened(tmp_path / "other", 1.0)
    with pytest.raises(UsageError, match="cannot be used"):
        opened(tmp_path / "no/folder", 1.0)


def test_export(tmp_path: Path) -> None:
    history = opened(tmp_path / "h.db", 0.0)
    for number in range(10):
        history.add(float(number), "ä|b", "gyro_x", axis(value=number))
    history.close()
    done = fltea("fleet", "--history", tmp_path / "h.db", "--export", tmp_path / "out.parquet")
    assert (done.returncode, done.stderr) == (0, f"{tmp_path}/out.parquet: 10 rows\n")
    found = pq.read_table(tmp_path / "out.parquet").to_pydict()
    assert (found["N"], found["K"][0], found["device_id"][0]) == (list(range(10)), None, "ä|b")
    assert write(Sqlite(tmp_path / "h.db", TABLES), tmp_path / "again.parquet") == 10
    assert not [name for name in os.listdir(tmp_path) if name.endswith(".part")]
    done = fltea("fleet", "--export", tmp_path / "x.parquet")
    assert (done.returncode, "which history?" in done.stderr) == (2, True)


def test_a_wall_clock_that_jumps() -> None:
    times = {"wall": 1000.0, "steady": 5.0}
    clock = Clock(lambda: times["wall"], lambda: times["steady"])
    times |= {"wall": 1010.5, "steady": 15.0}
    assert (clock.unix_s(), clock.jumps) == (1010.0, 0)  # half a second of NTP is no jump
    times |= {"wall": 4620.0, "steady": 20.0}
    assert (clock.unix_s(), clock.jumps, clock.long_jump) == (4620.0, 1, False)
    times |= {"wall": 4e9, "steady": 21.0}
    assert (clock.unix_s(), clock.jumps, clock.long_jump) == (4e9, 2, True)


BIN = sorted(Path("/usr/lib/postgresql").glob("*/bin"))
NOBODY = 65534


class Server:
    """A PostgreSQL of our own, on a socket in a folder; it refuses to run as root."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir()
        if os.geteuid() == 0:
            os.chown(folder, NOBODY, NOBODY)
            for parent in folder.parents:
                if parent != Path("/tmp") and os.stat(parent).st_uid == 0 and parent.is_relative_to("/tmp"):
                    parent.chmod(0o755)
        self.call("initdb", "-D", folder / "data", "-U", "me", "-A", "trust", "--no-sync")
        self.start()
        self.url = f"postgresql://me@/postgres?host={folder}"

    def call(self, program: str, *arguments: str | Path) -> None:
        user = NOBODY if os.geteuid() == 0 else None
        command = [str(BIN[-1] / program), *map(str, arguments)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, cwd=self.folder, user=user, group=user)

    def start(self) -> None:
        options = f"-c listen_addresses= -c unix_socket_directories={self.folder} -c fsync=off"
        self.call(
            "pg_ctl", "-D", self.folder / "data", "-l", self.folder / "log", "-o", options, "-w", "start"
        )

    def stop(self) -> None:
        self.call("pg_ctl", "-D", self.folder / "data", "-m", "immediate", "-w", "stop")


def test_postgres_keeps_the_same_and_may_go_and_come_back(tmp_path: Path) -> None:
    """Not installed by `make setup`: it is for those who have a server already."""
    pytest.importorskip("psycopg", reason="psycopg is not installed")
    if not BIN:
        pytest.skip("no PostgreSQL server: sudo apt-get install postgresql")
    server = Server(tmp_path / "pg")
    try:
        history = History(Postgres(server.url, TABLES), 0.0)
        for number in range(10):
            history.add(1000.0 + number, "a", "gyro_x", axis(value=number))
        history.add_alert(1005.0, "raised", "silent", "a", "it's text")
        history.flush()
        found = history.of_device("a")
        assert [(row["unix_s"], row["N"], row["K"]) for row in found] == [
            (1000.0 + n, n, None) for n in range(10)
        ]
        assert history.alerts()[0]["text"] == "it's text"
        assert history.prune(1006.0) == 7
        server.stop()
        history.add(2000.0, "a", "gyro_x", axis())
        history.flush()
        assert (history.lost, "cannot be written" in history.trouble) == (1, True)
        assert history.of_device("a") == []
        server.start()
        history.add(3000.0, "a", "gyro_x", axis())
        history.flush()
        assert (history.trouble, len(history.of_device("a"))) == ("", 5)
        history.close()
        again = History(Postgres(server.url, TABLES), 0.0)
        assert len(list(again.rows())) == 5
        again.close()
    finally:
        server.stop()
    with pytest.raises(UsageError, match="Does the server run"):
        Postgres(server.url, TABLES)


def test_after_a_number_that_no_database_keeps_the_next_rows_are_written(tmp_path: Path) -> None:
    history = opened(tmp_path / "h.db", 0.0)
    history.add(1000.0, "a", "gyro_x", Axis("white", "text", "deg/s", 10**30, {}, 0.0))
    with pytest.raises(OverflowError):
        history.flush()
    history.add(1001.0, "a", "gyro_x", axis())
    history.flush()
    assert [row["unix_s"] for row in history.of_device("a")] == [1001.0]
    history.close()


@pytest.mark.parametrize(
    ("out", "words"), [("gone/o.parquet", "cannot be written"), ("o.csv", "NAME.parquet")]
)
def test_an_export_that_cannot_be_written_is_a_message(tmp_path: Path, out: str, words: str) -> None:
    opened(tmp_path / "h.db", 60.0).close()
    done = fltea("fleet", "--history", tmp_path / "h.db", "--export", tmp_path / out)
    assert done.returncode != 0
    assert words in done.stderr
    assert "Traceback" not in done.stderr
