"""Run a PostgreSQL server on a socket in a folder."""

import os
import subprocess
from pathlib import Path
from typing import Any

import pytest

BIN = sorted(Path("/usr/lib/postgresql").glob("*/bin"))
NOBODY = 65534


class Server:
    """A PostgreSQL server on a socket in a folder. PostgreSQL refuses to run as root."""

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
        self.url = self.url_of("postgres")

    def url_of(self, database: str) -> str:
        return f"postgresql://me@/{database}?host={self.folder}"

    def ask(self, command: str, database: str = "postgres") -> list[Any]:
        """Run an SQL command with a client, and return the rows."""
        import psycopg

        with psycopg.connect(self.url_of(database), autocommit=True) as connection:
            cursor = connection.execute(command)
            return cursor.fetchall() if cursor.description else []

    def call(self, program: str, *arguments: str | Path) -> None:
        user = NOBODY if os.geteuid() == 0 else None
        command = [str(BIN[-1] / program), *map(str, arguments)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, cwd=self.folder, user=user, group=user)

    def start(self) -> None:
        options = f"-c listen_addresses= -c unix_socket_directories={self.folder} -c fsync=off"
        self.call(
            "pg_ctl", "-D", self.folder / "data", "-l", self.folder / "log", "-o", options, "-w", "start"
        )

    def signal(self, number: int) -> None:
        """Send a signal to all processes of the server; each connection has its own."""
        first = int((self.folder / "data/postmaster.pid").read_text().split()[0])
        for pid in (first, *map(int, Path(f"/proc/{first}/task/{first}/children").read_text().split())):
            os.kill(pid, number)

    def stop(self) -> None:
        self.call("pg_ctl", "-D", self.folder / "data", "-m", "immediate", "-w", "stop")


def started(folder: Path) -> Server:
    """Start a server; skip the test without PostgreSQL, which `make setup` does not install."""
    pytest.importorskip("psycopg", reason="psycopg is not installed")
    if not BIN:
        pytest.skip("no PostgreSQL server: sudo apt-get install postgresql")
    return Server(folder)
