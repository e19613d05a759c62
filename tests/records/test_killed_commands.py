"""A command that is killed leaves temporary files, and the next command removes them."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest
import zstandard

from tests.rig.bag_support import even, write_bag
from tests.rig.identify_files import counts, npz

KILLED = """
import os, signal, sys
from pathlib import Path
from fltea.cli.app import main
def watch(event, arguments):
    if event in ("open", "sqlite3.connect"):
        if any(file.stat().st_size for file in Path(os.environ["TMPDIR"]).glob("fltea-work-*/*")):
            os.kill(os.getpid(), signal.SIGKILL)
sys.addaudithook(watch)
main()
"""
"""A program that runs `fltea`. It kills itself on opening a file while a temporary file holds data."""


@pytest.mark.parametrize("command", ["info", "identify"])
def test_what_a_killed_command_left_goes_with_the_next(
    command: str, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path_factory.mktemp("t")  # a short name, since the path of a socket may have 107 bytes
    monkeypatch.setenv("TMPDIR", str(folder))
    if command == "info":
        (bag,) = write_bag(tmp_path / "bag.db3", {"/imu": even(500)}).glob("*.db3")
        path = tmp_path / "x.db3.zstd"
        path.write_bytes(zstandard.compress(bag.read_bytes()))
        line = ["info", str(path)]
    else:
        path = npz(tmp_path / "a.npz", counts(1000))
        line = ["identify", "--shuffles", "0", "--jobs", "2", str(path), str(path)]
    killed = subprocess.run([sys.executable, "-c", KILLED, *line], capture_output=True, text=True)
    assert killed.returncode == -signal.SIGKILL, killed
    assert [*folder.iterdir()]
    again = subprocess.run([sys.executable, "-m", "fltea", *line], capture_output=True, text=True)
    assert again.returncode == 0, again
    assert not [*folder.iterdir()]
