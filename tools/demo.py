"""`make run`: the emulated Due with its real firmware, `fltea run` and its live page; Ctrl-C ends both.

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
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
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
        return process.communicate(timeout=STOP_TIMEOUT_S)[0] or ""
    except subprocess.TimeoutExpired:
        process.kill()
        return process.communicate()[0] or ""


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


def run_daemon(port: Path, arguments: list[str]) -> int:
    """Run `fltea run` on the port to its end; returns its exit code."""
    daemon = subprocess.Popen(
        [sys.executable, "-m", "fltea", "run", "--source", f"serial:{port}", *page(arguments), *arguments],
        text=True,
    )
    # Ctrl-C reaches the daemon by itself; what is sent to this program alone is passed on.
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: daemon.send_signal(signal.SIGTERM))
    try:
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
            text=True,
        )
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


if __name__ == "__main__":
    sys.exit(main())
