"""Tests recordings that come through pipes: /dev/stdin, FIFOs, and files without an extension."""

import contextlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from fltea.recording.kind import is_of_this_process, is_one_file, is_stream
from fltea.records import small_file
from fltea.records.errors import UsageError
from fltea.settings.limits import Limits
from fltea.sources.replay import ReplaySource

from tests.rig.blocks import samples_of
from tests.rig.corpus_files import HERE, N
from tests.rig.host_support import fltea_here

CSV = b"time_s,gyro_x_dps\n" + b"".join(b"%.2f,%d\n" % (k / 100, k % 7) for k in range(50))
NDJSON = b'{"class":"hello","source":"x","host_ns":0,"rate_hz":100,"sampling_mode":"timer"}\n' + b"".join(
    b'{"class":"sample","seq":%d,"device_us":%d,"host_ns":%d,"epoch":1,"gyro_dps":[0.5]}\n'
    % (k, k * 10_000, k * 10_000_000)
    for k in range(50)
)
TEXTS = {"csv": CSV, "ndjson": NDJSON}


def feed(path: Path, data: bytes) -> threading.Thread:
    def write() -> None:
        with contextlib.suppress(BrokenPipeError):
            path.write_bytes(data)

    thread = threading.Thread(target=write, daemon=True)
    thread.start()
    return thread


def fltea(*arguments: object, **how: object) -> subprocess.CompletedProcess[bytes]:
    command = [sys.executable, "-m", "fltea", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, timeout=120, check=False, **how)  # type: ignore[call-overload]


def samples(source: ReplaySource) -> int:
    return len(samples_of(source.events()))


@pytest.mark.parametrize("name", TEXTS)
def test_a_fifo_is_read_once_whatever_is_in_it(name: str, fifo: Path) -> None:
    thread = feed(fifo, TEXTS[name])
    assert samples(ReplaySource(fifo)) == 50
    thread.join()


@pytest.mark.parametrize("suffix", [".csv", ".ndjson"])
def test_a_fifo_with_an_ending_is_what_it_says(suffix: str, fifo: Path) -> None:
    path = fifo.rename(fifo.with_suffix(suffix))
    thread = feed(path, TEXTS[suffix[1:]])
    assert samples(ReplaySource(path)) == 50
    thread.join()


@pytest.mark.parametrize("begin", [b"PK\x03\x04", b"\x89MCAP0\r\n"])
def test_what_has_to_be_a_file_is_refused_from_a_pipe(begin: bytes, fifo: Path) -> None:
    thread = feed(fifo, begin + bytes(100))
    with pytest.raises(UsageError, match=r"pipe: is a pipe, and (a compressed file|MCAP) has to be a file"):
        ReplaySource(fifo)
    thread.join()
    for suffix in (".npz", ".mcap"):
        fifo = fifo.rename(fifo.with_suffix(suffix))
        thread = feed(fifo, begin)
        with pytest.raises(UsageError, match=r"is a pipe, and (a compressed file|MCAP) has to be a file"):
            ReplaySource(fifo)
        thread.join()


def test_nothing_in_a_pipe_and_more_than_allowed(fifo: Path) -> None:
    feed(fifo, b"")
    with pytest.raises(UsageError, match="is empty"):
        ReplaySource(fifo)
    for text in (CSV, NDJSON):
        feed(fifo, text)
        with pytest.raises(UsageError, match=r"pipe:\d+: .*replay\.max_mb"):
            ReplaySource(fifo, limits=Limits(max_mb=0.0004))


COMMANDS = {
    "info": ["info", "PIPE"],
    "identify": ["identify", "--shuffles", "0", "PIPE"],
    "export": ["export", "PIPE", "--to", "out.npz"],
    "run": ["run", "--once", "--format", "none", "--startup", "10", "-s", "replay:PIPE"],
    "recover": ["recover", "PIPE"],
    "a folder": ["info", "FOLDER"],
}


@pytest.mark.parametrize("command", COMMANDS)
def test_a_pipe_into_which_nobody_writes_is_told(
    command: str, fifo: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(small_file, "PATIENCE_S", 0.05)
    monkeypatch.chdir(fifo.parent)
    place = fifo.rename(fifo.with_suffix(".mcap")) if command in ("recover", "a folder") else fifo
    words = {"PIPE": str(place), "FOLDER": str(fifo.parent), "replay:PIPE": f"replay:{place}"}
    done = fltea_here(*(words.get(word, word) for word in COMMANDS[command]))
    assert done.returncode == 2, done.stdout
    text = "no program has opened this pipe" if place == fifo else "is a pipe"
    assert str(place) in done.stderr
    assert text in done.stderr


def test_a_writer_may_take_its_time_once_it_has_come(fifo: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(small_file, "PATIENCE_S", 0.05)
    held = os.open(fifo, os.O_RDWR)  # opening the FIFO in this way does not wait for a writer

    def write() -> None:
        for data in (CSV[:100], CSV[100:]):
            time.sleep(0.2)
            os.write(held, data)
        os.close(held)

    thread = threading.Thread(target=write, daemon=True)
    thread.start()
    assert samples(ReplaySource(fifo)) == 50
    thread.join()


@pytest.mark.parametrize("name", ["rest.ndjson", "rest"])
def test_objects_of_other_programs_are_text(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(b"".join(b'{"t_ms":%d,"wx_rads":0.5}\n' % (k * 10) for k in range(50)))
    (first, *_) = samples_of(ReplaySource(path).events())
    assert samples(ReplaySource(path)) == 50
    assert first.gyro[0] == pytest.approx(np.degrees(0.5))


def test_a_file_without_an_ending_is_what_it_holds(tmp_path: Path) -> None:
    for name, text in TEXTS.items():
        path = tmp_path / f"rest_{name}"
        path.write_bytes(text)
        assert is_one_file(path)
        assert samples(ReplaySource(path)) == 50
    np.savez(tmp_path / "rest.npz", gyro_dps=np.ones((50, 1)), fs_hz=100.0)
    (tmp_path / "rest.npz").rename(tmp_path / "rest")
    assert samples(ReplaySource(tmp_path / "rest")) == 50
    (tmp_path / "mcap").write_bytes(b"\x89MCAP0\r\n")
    assert not is_one_file(tmp_path / "mcap")


def test_which_paths_are_streams(tmp_path: Path, fifo: Path) -> None:
    (tmp_path / "file").touch()
    assert all(map(is_stream, (fifo, Path("/dev/null"))))
    assert not any(map(is_stream, (tmp_path, tmp_path / "file", tmp_path / "none")))
    assert is_of_this_process(Path("/dev/stdin"))
    assert not is_of_this_process(tmp_path / "file")


@pytest.mark.parametrize("name", ["csv", "ndjson"])
@pytest.mark.parametrize("how", ["pipe", "file"])
def test_standard_input_of_run(name: str, how: str, tmp_path: Path) -> None:
    flags = ("-s", "replay:/dev/stdin", "--once", "--startup", "10", "--samples")
    if how == "pipe":
        done = fltea("run", *flags, input=TEXTS[name])
    else:
        (tmp_path / "rest").write_bytes(TEXTS[name])
        with (tmp_path / "rest").open("rb") as file:
            done = fltea("run", *flags, stdin=file)
    assert done.returncode == 0, done.stderr
    assert sum(json.loads(line)["class"] == "sample" for line in done.stdout.splitlines()) == 50


WAYS = {
    "file": "info /dev/stdin < {}",
    "descriptor": "info /dev/fd/7 7< {}",
    "its link": "info /proc/self/fd/7 7< {}",
    "pipe": "cat {} | fltea info /dev/stdin",
    "substitution": "info <(cat {})",
}
"""Ways in which a shell passes the content of a file to a program."""
IN_ONE_GO = {"plain.csv"}


@pytest.mark.parametrize(
    ("way", "names"),
    [
        *((way, ("plain.csv", "px4.ulg")) for way in WAYS),
        pytest.param(
            "file",
            ("pandas.parquet", "phyphox.xlsx", "phyphox.zip", "json.mcap", "matlab.mat"),
            marks=pytest.mark.slow,
        ),
    ],
)
def test_what_a_shell_hands_over(way: str, names: tuple[str, ...]) -> None:
    """The program reads recordings that a shell passes to it. This also works if it reads them in another
    process, whose standard input is a different one.

    A pipe is refused for formats that cannot be read sequentially.
    """
    command = WAYS[way] if "fltea" in WAYS[way] else "fltea " + WAYS[way]
    said_of = {"json.mcap": " --units rad/s"}
    script = [f"{command.format(HERE / name)}{said_of.get(name, '')} || echo refused" for name in names]
    define = f'fltea() {{ {sys.executable} -m fltea "$@" 2>&1; }}'
    done = subprocess.run(
        ["bash", "-c", "\n".join([define, *(f"{one}; echo ---" for one in script)])],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    for name, said in zip(names, done.stdout.split("---\n"), strict=False):
        if way in ("pipe", "substitution") and name not in IN_ONE_GO:
            assert re.search(r"/dev/\S+: is a pipe, and .* has to be a file.*\nrefused", said), said
        else:
            assert re.search(rf"samples +{N}, 0 lost", said), (name, said)


def test_a_redirected_file_that_has_no_name_any_more(tmp_path: Path) -> None:
    path = tmp_path / "rest.ulg"
    shutil.copy(HERE / "px4.ulg", path)
    with path.open("rb") as file:
        path.unlink()
        done = fltea("info", "/dev/stdin", stdin=file)
    assert re.search(rf"samples +{N}, 0 lost".encode(), done.stdout), done.stderr


@pytest.mark.parametrize("jobs", [1, 2])
def test_standard_input_of_identify(jobs: int, tmp_path: Path) -> None:
    """`identify` reads standard input together with a further file. With several jobs, other processes read
    the files, but only this process has the standard input.
    """
    rng = np.random.default_rng(1)
    rows = "".join(f"{value:.6f}\n" for value in rng.normal(size=5000))
    (tmp_path / "rest.csv").write_text("gyro_x_dps\n" + rows)
    flags = ("--rate", "100", "--shuffles", "0", "--json", "--jobs", jobs)
    done = fltea(
        "identify", "/dev/stdin", tmp_path / "rest.csv", *flags, input=(tmp_path / "rest.csv").read_bytes()
    )
    assert done.returncode == 0, done.stderr
    first, second = json.loads(done.stdout)["files"]
    first.pop("file")
    second.pop("file")
    assert first == second


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("command", ["run", "identify", "info"])
def test_a_pipe_that_says_nothing_can_be_interrupted(
    command: str, number: signal.Signals, fifo: Path
) -> None:
    words = ["run", "-s", f"replay:{fifo}"] if command == "run" else [command, str(fifo)]
    process = subprocess.Popen([sys.executable, "-m", "fltea", *words], stderr=subprocess.PIPE)
    try:
        held = _opened_by_a_reader(fifo, process)
        _wait_until_it_reads(process)
        said = _interrupted(process, number)
        os.close(held)
    finally:
        process.kill()
    assert b"Traceback" not in said
    # `run` ends as asked; the other commands end with the code that shells give to the signal
    assert process.returncode in ((0,) if command == "run" else (128 + number, -number))


def _interrupted(process: subprocess.Popen[bytes], number: signal.Signals) -> bytes:
    """Interrupt a program by a signal, and return what the program wrote to stderr.

    Send the signal again if it came just before the program began to read from the pipe.
    """
    for _ in range(60):
        process.send_signal(number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            return process.communicate(timeout=1)[1]
    raise AssertionError("it goes on, whatever the signal")


def _opened_by_a_reader(fifo: Path, process: subprocess.Popen[bytes]) -> int:
    """Open the pipe for writing, which succeeds as soon as a program reads from it."""
    while process.poll() is None:
        with contextlib.suppress(OSError):
            return os.open(fifo, os.O_WRONLY | os.O_NONBLOCK)
        time.sleep(0.05)
    raise AssertionError(process.communicate())


def _wait_until_it_reads(process: subprocess.Popen[bytes]) -> None:
    """Wait until the program waits for data in the kernel's function `read`.

    A signal just before this call of `read` would be handled only when the call returns.
    """
    process_files = Path(f"/proc/{process.pid}")
    while process.poll() is None:
        where = (process_files / "wchan").read_text()
        state = (process_files / "stat").read_text().rpartition(")")[2].split()[0]
        # not every kernel names the function in which a process waits
        if "pipe_read" in where or (where == "0" and state == "S"):
            return
        time.sleep(0.02)
