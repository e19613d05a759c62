"""Tests in which each kind of source is recorded into several files.

All files of the recording are then read. If a file is damaged, a message names it, and the exit code is 1.

If a kind of source cannot be recorded, the program says so, and what can be done instead.
"""

import contextlib
import json
import os
import socket
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from fltea.settings.config import SETTINGS
from fltea.settings.outputs import OUTPUTS
from fltea.sources.synthetic import parse_noise

from tests.rig.fake_iio import imu, scan
from tests.rig.host_support import Processes, fltea_here, wait_until
from tests.rig.mcap_support import files
from tests.rig.terminal import speaking
from tests.rig.tiers import long, long_but
from tools.standin import Device

EVERY_S = 0.02
LINES = np.random.default_rng(1).integers(-50, 50, (100_000, 3))
Source = contextlib.AbstractContextManager[list[str]]


def boards(rate_hz: int = 500) -> Callable[[int], bytes]:
    """Return a function that gives the bytes that a board sends in each fiftieth of a second."""
    device = Device(parse_noise(f"seed=1&rate_hz={rate_hz}"), boot_id=1)
    return lambda turn: (
        (b"" if turn else device.booted()) + b"".join(device.next_frames() for _ in range(rate_hz // 50))
    )


def lines(turn: int) -> bytes:
    """Return the counts of a fiftieth of a second as text. That makes 500 lines a second."""
    return b"".join(b"%d,%d,%d\n" % tuple(row) for row in LINES[10 * turn : 10 * turn + 10].tolist())


@contextlib.contextmanager
def played(write: Callable[[bytes], object], speech: Callable[[int], bytes]) -> Iterator[None]:
    """Write the bytes or text that `speech` returns, until the `with` block ends or no program listens."""
    stop = threading.Event()

    def play() -> None:
        with contextlib.suppress(OSError):
            turn = 0
            while not stop.wait(EVERY_S):
                write(speech(turn))
                turn += 1

    thread = threading.Thread(target=play)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


@contextlib.contextmanager
def port(folder: Path) -> Iterator[list[str]]:
    with speaking(boards(), EVERY_S) as one:
        yield [f"serial:{one.port}"]


@contextlib.contextmanager
def tcp(folder: Path) -> Iterator[list[str]]:
    with socket.create_server(("127.0.0.1", 0)) as server:
        heard: list[socket.socket] = []

        def write(data: bytes) -> None:
            heard.extend([] if heard else [server.accept()[0]])
            heard[0].sendall(data)

        with played(write, boards()):
            yield [f"serial:socket://127.0.0.1:{server.getsockname()[1]}"]
        for one in heard:
            one.close()


TEXT = ["--columns", "1,2,3", "--units", "lsb:16.4", "--rate", "500"]


@contextlib.contextmanager
def text_port(folder: Path) -> Iterator[list[str]]:
    with speaking(lines, EVERY_S) as one:
        yield [f"serial-text:{one.port}", *TEXT]


@contextlib.contextmanager
def text(folder: Path) -> Iterator[list[str]]:
    os.mkfifo(folder / "pipe")
    held = os.open(folder / "pipe", os.O_RDWR)
    with played(lambda data: os.write(held, data), lines):
        yield [f"stdin:{folder / 'pipe'}", *TEXT]
    os.close(held)


@contextlib.contextmanager
def i2c(folder: Path) -> Iterator[list[str]]:
    yield ["i2c:///dev/i2c-1?addr=0x68"]


@contextlib.contextmanager
def synthetic(folder: Path) -> Iterator[list[str]]:
    yield ["synthetic:?seed=1&rate_hz=500"]


KINDS = long_but([i2c, tcp], [port, text, i2c, tcp, text_port, synthetic], quick=[port])
START = ["--startup", "20"]
REPLAY = ["run", "--once", "--samples", *START]
IDENTIFY = ["identify", "--json", "--shuffles", "0", *START]


@pytest.mark.parametrize("command", ["record", long("run")])
@pytest.mark.parametrize("kind", KINDS)
def test_all_files_of_a_recording_are_used_or_named(
    kind: Callable[[Path], Source], command: str, tmp_path: Path, processes: Processes
) -> None:
    folder = tmp_path / "rec"
    words = [folder] if command == "record" else ["--format", "none", "--record", folder]
    launcher = ["-m", "tests.e2e.pi_launcher", "seed=1"] if kind is i2c else []
    with kind(tmp_path) as source:
        program = processes.daemon(
            *words, "-s", *source, "--rotate-s", "0.4", command=command, program=launcher
        )
        wait_until(lambda: len(files(folder)) > 6, "the files")
        said = program.end_well()
    # The sensor's FIFO overflows if a busy machine suspends the program for a while.
    lossless = kind is not i2c or "fifo_overflow" not in said
    whole = files(folder)
    summary = json.loads(fltea_here("info", "--json", folder).stdout)
    assert (summary["files"], summary["whole"], summary["breaks"]) == (len(whole), True, 0)
    assert samples_of(folder, lossless) == summary["samples"] > 100
    whole[1].write_bytes(whole[1].read_bytes().replace(b"format", b"farmat", 1))
    for one in (["info"], IDENTIFY, [*REPLAY, "-s"]):
        done = fltea_here(*one, f"replay:{folder}" if one[-1] == "-s" else folder)
        assert done.returncode == 1
        assert f"a part of the recording could not be read; the rest is used: {whole[1]}: " in done.stderr


def samples_of(folder: Path, lossless: bool) -> int:
    """Return how many samples of a recording `replay:` and `identify` find.

    Also check that the samples are consecutive, if none was lost.
    """
    done = fltea_here(*REPLAY, "-s", f"replay:{folder}")
    assert done.returncode == 0, done.stderr
    seqs = [one["seq"] for one in map(json.loads, done.stdout.splitlines()) if one["class"] == "sample"]
    assert seqs == list(range(seqs[0], seqs[0] + len(seqs))) if lossless else seqs == sorted({*seqs})
    done = fltea_here(*IDENTIFY, folder)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["files"][0]["samples"]["samples"] == len(seqs)
    return len(seqs)


@contextlib.contextmanager
def iio(folder: Path) -> Iterator[list[str]]:
    """Yield the URL of an imitated BMI160 whose scale cannot be stated exactly in a frame."""
    device = imu(folder)
    held = os.open(device.node, os.O_RDWR)
    os.write(held, b"".join(scan(k, k * 5_000_000) for k in range(500)))
    yield [f"{device.url}?rate_hz=200"]
    os.close(held)


OF_MANY = dict.fromkeys(
    flag for row in OUTPUTS if row.of_many and not row.when for flag in SETTINGS[row.on].setting.flags[:1]
)
"""The flags of the outputs that take the records of a source of many devices."""
INSTEAD = f"Their records go to {', '.join(OF_MANY)} and the standard output."

REFUSED: dict[str, tuple[list[str], str]] = {
    "replay": (["replay:rest.npz"], "a recording already; use 'fltea export' or 'fltea recover'."),
    "mqtt": (["mqtt://127.0.0.1:1"], INSTEAD),
    "nats": (["nats://127.0.0.1:1"], INSTEAD),
    "rates as text": (["stdin:rest.csv"], "Write its samples instead: fltea run --samples."),
    "iio": ([], "Write its samples instead: fltea run --samples."),
}


@pytest.mark.parametrize("command", [["record", "rec"], ["run", "--format", "none", "--record", "rec"]])
@pytest.mark.parametrize("kind", REFUSED)
def test_what_cannot_be_recorded_says_what_to_do(
    kind: str, command: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    np.savez("rest.npz", gyro_raw=LINES[:900], fs_hz=100.0, lsb_per_dps=16.4)
    Path("rest.csv").write_text("time_s,gyro_x_dps\n" + "".join(f"{k / 100},{k % 7}\n" for k in range(300)))
    source, text = REFUSED[kind]
    with iio(tmp_path) if kind == "iio" else contextlib.nullcontext(source) as words:
        done = fltea_here(*command, "-s", *words)
    assert (done.returncode, text in done.stderr) == (2, True), done.stderr
