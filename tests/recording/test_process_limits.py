"""Tests of reader processes, which read files with other programs' libraries.

They keep within the limits of the login session, report which limit ended them, and end when the process that
started them ends.
"""

import os
import resource
import signal
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest
from fltea.recording.process_limits import OUT_OF_MEMORY, SILENT_RATIO, ProcessLimits
from fltea.recording.quota import Quota
from fltea.records.errors import FlteaError, UsageError
from fltea.settings.limits import Limits

from tests.rig.corpus_files import HERE
from tests.rig.tiers import slow

LIMITED = """
import resource, sys
from pathlib import Path
from fltea.sources.replay import ReplaySource
what, soft, hard = map(int, sys.argv[1:4])
resource.setrlimit(what, (soft, hard))
print(ReplaySource(Path(sys.argv[4])))
"""
GB, NONE = 1 << 30, resource.RLIM_INFINITY


@pytest.mark.parametrize(
    ("what", "soft", "hard"),
    [slow(resource.RLIMIT_AS, GB, GB), (resource.RLIMIT_AS, GB, NONE), slow(resource.RLIMIT_CPU, 12, 12)],
    ids=["addresses", "addresses, soft", "processor time"],
)
def test_lower_limits_of_a_session_are_kept(what: int, soft: int, hard: int) -> None:
    words = [str(what), str(soft), str(hard), str(HERE / "pandas.parquet")]
    found = subprocess.run([sys.executable, "-c", LIMITED, *words], capture_output=True, text=True)
    assert found.returncode == 0, found.stderr


def limits_of(path: Path) -> tuple[ProcessLimits, Quota]:
    quota = Quota(path, Limits())
    return ProcessLimits.of(quota), quota


def test_limits_are_the_least_of_ours_and_the_sessions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a").touch()
    ours, quota = limits_of(tmp_path / "a")
    assert (ours.is_cpu_ours, ours.is_memory_ours, ours.silent_s) == (True, True, SILENT_RATIO * ours.cpu_s)
    monkeypatch.setattr(resource, "getrlimit", lambda what: (NONE, {resource.RLIMIT_AS: GB}.get(what, NONE)))
    found = ProcessLimits.of(quota)
    assert (found.memory_bytes, found.is_memory_ours, found.is_cpu_ours) == (GB, False, True)
    monkeypatch.setattr(resource, "getrlimit", lambda what: (7, NONE))
    assert (ProcessLimits.of(quota).cpu_s, ProcessLimits.of(quota).is_cpu_ours) == (7, False)


OURS, SESSIONS = (True, True), (False, False)


@pytest.mark.parametrize(
    ("code", "ours", "kind", "said"),
    [
        (-signal.SIGXCPU, OURS, UsageError, "took more than 5 s of processor time"),
        (-signal.SIGXCPU, (False, True), FlteaError, r"more than the 9 s of processor time .*ulimit -t"),
        (-signal.SIGXCPU, (True, False), FlteaError, r"\(SIGXCPU\), most likely .*5 MB of addresses"),
        (-signal.SIGKILL, OURS, FlteaError, r"killed by the system \(SIGKILL\).*the memory ran out"),
        (-signal.SIGKILL, SESSIONS, FlteaError, r"\(SIGKILL\).*5 MB of addresses \(ulimit -v"),
        (-signal.SIGALRM, OURS, FlteaError, "nothing came of it for 60 s"),
        (-signal.SIGSEGV, OURS, UsageError, r"SIGSEGV\)\. Is the file damaged\?"),
        (-signal.SIGSEGV, SESSIONS, FlteaError, r"SIGSEGV\), most likely since this session .*ulimit -v"),
        (-signal.SIGTERM, OURS, FlteaError, r"\(SIGTERM\), by somebody who ended it"),
        (OUT_OF_MEMORY, OURS, UsageError, r"0\.0 GB would be needed that a file of its size may take"),
        (OUT_OF_MEMORY, SESSIONS, FlteaError, r"needs more memory than there is, .*ulimit -v"),
        (1, OURS, UsageError, r"exit code 1\)\. Is the file damaged\?"),
    ],
)  # fmt: skip
def test_what_ended_a_reader_is_said(
    code: int, ours: tuple[bool, bool], kind: type[FlteaError], said: str, tmp_path: Path
) -> None:
    (tmp_path / "a.h5").touch()
    limits = ProcessLimits(1, 9, 60, 5_000_000, *ours)
    error = limits.ended(Quota(tmp_path / "a.h5", Limits()), code)
    assert type(error) is kind
    with pytest.raises(FlteaError, match=rf"a\.h5: .*{said}"):
        raise error


HELD = """
import json, os, signal, sys, time
import msgspec
from fltea.recording.process_limits import ProcessLimits
limits = msgspec.json.decode(sys.argv[1], type=ProcessLimits)
os.close(0)
limits.hold()
print(os.getpid(), flush=True)
if sys.argv[2] == "sleep":
    time.sleep(999)
with limits.waiting():
    time.sleep(1.1)
while sys.argv[2] == "busy":
    pass
"""
PARENT = """
import msgspec, os, signal, subprocess, sys
from fltea.recording.process_limits import ProcessLimits
limits = msgspec.json.encode(ProcessLimits(os.getpid(), 600, 600, 1 << 30)).decode()
child = subprocess.Popen([sys.executable, "-c", sys.argv[1], limits, "sleep"])
sys.stdin.readline()
os.kill(os.getpid(), signal.SIGKILL)
"""


def ended_by(limits: ProcessLimits, how: str) -> int:
    words = [sys.executable, "-c", HELD, msgspec.json.encode(limits).decode(), how]
    return subprocess.run(words, capture_output=True).returncode


@pytest.mark.slow
def test_what_a_reader_takes_too_much_of_ends_it() -> None:
    here = os.getpid()
    assert ended_by(ProcessLimits(here, 1, 60, GB), "busy") == -signal.SIGXCPU
    assert ended_by(ProcessLimits(here, 60, 1, GB), "sleep") == -signal.SIGALRM
    assert ended_by(ProcessLimits(here, 60, 1, GB), "wait") == 0
    # the parent's process id in the limits is not that of the actual parent, so the reader concludes that its
    # parent has ended
    assert ended_by(ProcessLimits(here + 1, 60, 60, GB), "sleep") == 1


@pytest.mark.skipif(sys.platform != "linux", reason="prctl(2) is of Linux")
def test_a_reader_ends_with_who_started_it() -> None:
    """A reader process ends when the process that started it ends. Both hold one stdout open, so this stdout
    reaches its end when both have ended.
    """
    words = [sys.executable, "-c", PARENT, HELD]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        try:
            assert parent.communicate(b"\n", timeout=60) == (b"", None)
        except BaseException:
            os.kill(child, signal.SIGKILL)
            raise
    assert parent.returncode == -signal.SIGKILL
