"""Tests that no Python module in the current folder is run, in whatever way fltea starts a process."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from fltea.identification.workers import Processes

from tests.rig.host_support import PATIENCE_S
from tests.rig.tiers import slow

COMMAND = [str(Path(sys.executable).with_name("fltea"))]
MODULE = [sys.executable, "-m", "fltea"]
LIBRARIES = {"h5py", "lz4", "mcap", "msgspec", "numpy", "openpyxl", "pyarrow", "rich", "scipy", "typer"}
LATE = {
    "h5py",
    "heapq",
    "logging",
    "multiprocessing",
    "numpy",
    "pyarrow",
    "random",
    "resource",
    "scipy",
    "socket",
}
"""Modules that only fltea or its libraries import.

Python itself imports other modules when `python -m` starts. It takes these from the current folder before
fltea can prevent that, so they are not in this list.
"""

WORKERS = ["identify", "a.npz", "b.npz", "--jobs", "2"]
APART = ["info", "a.h5"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with two .npz recordings and one HDF5 recording, which a separate process (the reader
    process) reads.
    """
    y = np.random.default_rng(1).standard_normal((3000, 3))
    for name in ("a", "b"):
        np.savez(tmp_path / f"{name}.npz", gyro_dps=y, fs_hz=100.0)
    with pytest.importorskip("h5py").File(tmp_path / "a.h5", "w") as file:
        file["gyro_dps"], file["fs"] = y, 100.0
    return tmp_path


def lay(folder: Path, names: set[str]) -> None:
    """Write modules to the folder. A module that is run writes a file."""
    for name in names:
        (folder / f"{name}.py").write_text("open(__file__ + '.ran', 'w').close()\n")


def marks(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.glob("*.ran"))


@pytest.mark.parametrize("arguments", [slow(WORKERS), APART], ids=["workers", "process apart"])
@pytest.mark.parametrize(
    ("command", "names"), [(COMMAND, sys.stdlib_module_names | LIBRARIES), (MODULE, LATE)]
)
def test_no_module_of_the_current_folder_is_run(
    folder: Path, command: list[str], names: set[str], arguments: list[str]
) -> None:
    lay(folder, names)
    done = subprocess.run(
        [*command, *arguments], cwd=folder, capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    assert (marks(folder), done.returncode) == ([], 0), done.stderr


STARTED_AGAIN = f"""
import os
from multiprocessing import forkserver
from fltea.identification.workers import Processes
if __name__ == "__main__":
    workers = Processes(1)
    pid = forkserver._forkserver._forkserver_pid
    os.kill(pid, {signal.SIGKILL:d})
    os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT)
    workers.renew()
    print(workers.submit(os.getpid).result() != os.getpid())
    workers.close()
"""


def test_nor_by_what_starts_in_place_of_a_forkserver_that_died(folder: Path) -> None:
    """The script that kills the forkserver is not in the current folder, since Python itself imports modules
    from the folder of a script.
    """
    lay(folder, set(sys.stdlib_module_names))
    script = folder / "elsewhere/script.py"
    script.parent.mkdir()
    script.write_text(STARTED_AGAIN)
    done = subprocess.run(
        [sys.executable, script], cwd=folder, capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    assert (marks(folder), done.stdout) == ([], "True\n"), done.stderr


def test_the_programs_that_others_start_are_left_alone() -> None:
    before = dict(os.environ)
    workers = Processes(1)
    try:
        assert workers.submit(os.getpid).result() != os.getpid()
        workers.renew()
        assert workers.submit(os.getppid).result() != os.getpid()
    finally:
        workers.close()
    assert dict(os.environ) == before


def test_fltea_is_found_where_it_lies_in_the_current_folder() -> None:
    host = Path(__file__).parents[2] / "host"
    done = subprocess.run([*MODULE, "--version"], cwd=host, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
