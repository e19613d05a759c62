"""What a worker that was killed leaves on its disk goes with the next file; what is in use stays."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from fltea.identification.work_folder import work_folder

KILLED = """
import os
from fltea.identification.work_folder import work_folder
with work_folder() as folder:
    (folder / "recording.csv").write_bytes(b"1234")
    os.kill(os.getpid(), 9)
"""


def age(folder: Path) -> None:
    os.utime(folder, (1, 1))


def test_what_a_killed_worker_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    killed = subprocess.run([sys.executable, "-c", KILLED], env={**os.environ, "TMPDIR": str(tmp_path)})
    assert killed.returncode == -9
    (left,) = tmp_path.iterdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with work_folder() as one:
        assert left.exists()  # so young that its process may just have made it
        age(one)
        age(left)
        (tmp_path / f"{left.name}-link").symlink_to(one)
        (tmp_path / "another-x").mkdir()
        age(tmp_path / "another-x")
        with work_folder() as other:
            assert not left.exists()
            assert one.exists()
            assert other != one
    assert sorted(path.name for path in tmp_path.iterdir()) == ["another-x", f"{left.name}-link"]
