"""If the system refuses more memory or threads, the error names the limit that was probably reached, in one
sentence.
"""

import errno
import resource
import subprocess
import sys

import pytest
from fltea.cli import app
from fltea.records.errors import FlteaError
from fltea.records.scarce import LEAST_BYTES, check_address_space, is_scarcity, scarcity

NO_MEMORY = OSError(errno.ENOMEM, "Cannot allocate memory")
FAILS = [
    MemoryError("std::bad_alloc"),
    RuntimeError("can't start new thread"),
    ImportError("libopenblas.so: failed to map segment from shared object"),
    NO_MEMORY,
]


@pytest.fixture
def limited(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resource, "getrlimit", lambda what: (300_000_000, resource.RLIM_INFINITY))


@pytest.mark.parametrize("error", FAILS, ids=lambda error: type(error).__name__)
def test_a_command_says_which_limit_is_to_blame(
    error: Exception,
    limited: None,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def fails() -> None:
        # a library may catch `error` and raise an exception of its own, such as this KeyError
        raise KeyError("gyro") from error

    monkeypatch.setattr(app, "app", fails)
    monkeypatch.setattr(sys, "argv", ["fltea", "devices"])
    with pytest.raises(SystemExit) as ended:
        app.main()
    assert ended.value.code == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "limits a process to 300 MB of addresses (ulimit -v)" in line


def test_other_errors_are_none_of_memory() -> None:
    others = (
        RuntimeError("x"),
        OSError(errno.EAGAIN, "x"),
        OSError(errno.ENOSPC, "x"),
        ImportError("no numpy"),
    )
    assert not any(map(is_scarcity, others))
    assert "ulimit -u" in str(scarcity(FAILS[1]))


def test_a_session_that_allows_too_little(limited: None, monkeypatch: pytest.MonkeyPatch) -> None:
    check_address_space()
    monkeypatch.setattr(resource, "getrlimit", lambda what: (LEAST_BYTES - 1, LEAST_BYTES - 1))
    with pytest.raises(FlteaError, match=r"256 MB of addresses \(ulimit -v\), and numpy"):
        check_address_space()


def test_a_command_under_a_limit_ends_with_one_sentence() -> None:
    limit = 200_000_000
    words = ["/bin/sh", "-c", f'ulimit -v {limit // 1024}; exec "$@"', "-", sys.executable, "-m", "fltea"]
    found = subprocess.run([*words, "identify", "x.csv"], capture_output=True, text=True)
    assert (found.returncode, found.stdout) == (1, "")
    (line,) = found.stderr.splitlines()
    assert line.startswith("fltea: error: this session limits a process to 200 MB of addresses (ulimit -v)")
    assert subprocess.run([*words, "--version"], capture_output=True).returncode == 0
