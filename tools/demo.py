"""`make run`: the emulated Due with its real firmware, `fltea run` and its live page; Ctrl-C ends both.

Not on a terminal, and with no --format in ARGS, one line a second comes out instead of every record.

On a terminal this program takes the foreground, so that Ctrl-C reaches the daemon and not make, which would
turn it into a failure.
"""

import contextlib
import os
import shlex
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import IO

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tools.ndjson_summary import Summary  # noqa: E402

SLOW = "real time"
"""Stands in the emulator's warning that it does not keep up, and in no other."""
MEANING = (
    "make run: what the figures then mean: the board's clock looks slow to this computer, and fewer samples "
    "come per second; α, f and noise per sample are unaffected, because the board samples by its own clock."
)
STOP_TIMEOUT_S = 5.0
PAGE_PORT = 5006


@contextlib.contextmanager
def foreground() -> Iterator[None]:
    """Own the terminal for a while, if there is one and it is ours to take."""
    try:
        terminal = os.open("/dev/tty", os.O_RDWR)
    except OSError:
        yield
        return
    before = os.tcgetpgrp(terminal)
    if before != os.getpgrp() or before == os.getpid():
        os.close(terminal)
        yield
        return
    signal.signal(signal.SIGTTOU, signal.SIG_IGN)
    os.setpgid(0, 0)
    os.tcsetpgrp(terminal, os.getpgrp())
    try:
        yield
    finally:
        os.tcsetpgrp(terminal, before)
        os.close(terminal)


def stop(process: subprocess.Popen[str]) -> str:
    """Ask a process to end, and insist if it does not; returns the rest of what it said."""
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
    try:
        process.wait(STOP_TIMEOUT_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    # Its last words are a few lines: they wait in the pipe. Standard error has a reader of its own.
    return "" if process.stdout is None or process.stdout.closed else process.stdout.read()


def page(arguments: list[str]) -> list[str]:
    """The flag for the live page, unless one was given; its usual port, or any if that is taken."""
    if any(argument.startswith("--dashboard") for argument in arguments):
        return []
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", PAGE_PORT))
        except OSError:
            return ["--dashboard", "0"]
    return ["--dashboard", str(PAGE_PORT)]


def output(arguments: list[str]) -> list[str]:
    """The flag for lines that are made short here; none on a terminal, or if a format was asked for."""
    asked = any(argument.startswith("--format") for argument in arguments)
    return [] if asked or sys.stdout.isatty() else ["--format", "ndjson"]


def show_summary(records: IO[str]) -> None:
    """Print one line a second of the daemon's NDJSON, to its end or until nobody reads."""
    summary = Summary()
    for record in records:
        if (line := summary.line(record.rstrip("\n"))) is None:
            continue
        try:
            print(line, flush=True)
        except BrokenPipeError:
            # Python would fail once more when it flushes at the end.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            records.close()
            return


def pass_on(warnings: Iterable[str]) -> None:
    """Pass the emulator's warnings on, and say once what being too slow means for the figures."""
    explained = False
    for line in warnings:
        print(line, end="", file=sys.stderr, flush=True)
        if SLOW in line and not explained:
            explained = True
            print(MEANING, file=sys.stderr, flush=True)


def run_daemon(port: Path, arguments: list[str]) -> int:
    """Run `fltea run` on the port to its end; returns its exit code."""
    short = output(arguments)
    command = ["run", "--source", f"serial:{port}", *page(arguments), *short, *arguments]
    daemon = subprocess.Popen(
        [sys.executable, "-m", "fltea", *command], text=True, stdout=subprocess.PIPE if short else None
    )
    # Ctrl-C reaches the daemon by itself; what is sent to this program alone is passed on.
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: daemon.send_signal(signal.SIGTERM))
    try:
        if daemon.stdout is not None:
            show_summary(daemon.stdout)
        return daemon.wait()
    finally:
        stop(daemon)


def main() -> int:
    """Run both until the daemon ends; its exit code is ours."""
    arguments = shlex.split(os.environ.get("ARGS", "")) + sys.argv[1:]
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: None)
    with foreground(), tempfile.TemporaryDirectory() as folder:
        port = Path(folder) / "due"
        # Out of reach of Ctrl-C: a board that vanished before the daemon ends would be reported as unplugged.
        board = subprocess.Popen(
            [sys.executable, "-m", "tools.due_emulator", "--pty", "--link", port],
            cwd=ROOT,
            process_group=0,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert board.stderr is not None
        listener = threading.Thread(target=pass_on, args=(board.stderr,), daemon=True)
        listener.start()
        try:
            assert board.stdout is not None
            announcement = board.stdout.readline().strip()
            if not announcement:
                print("demo: the emulated Due did not start.", file=sys.stderr)
                return 1
            print(f"Emulated Arduino Due on {announcement} (true noise). Ctrl-C ends.", file=sys.stderr)
            return run_daemon(port, arguments)
        finally:
            # Here it also says whether this machine kept up with it.
            print(f"Emulated Arduino Due: {stop(board)}", end="", file=sys.stderr)
            listener.join(STOP_TIMEOUT_S)


if __name__ == "__main__":
    sys.exit(main())
