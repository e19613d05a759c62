"""`make run`: the stand-in device, and `fltea run` on its port; Ctrl-C ends both, exit 0.

On a terminal this program takes the foreground, so that Ctrl-C reaches the two and not make, which
would turn it into a failure.
"""

import contextlib
import os
import shlex
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

TOOLS = Path(__file__).parent
STOP_TIMEOUT_S = 5.0


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


def stop(process: subprocess.Popen[str]) -> None:
    """Ask a process to end, and insist if it does not."""
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
    try:
        process.wait(STOP_TIMEOUT_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def main() -> int:
    """Run both until the daemon ends; its exit code is ours."""
    arguments = shlex.split(os.environ.get("ARGS", "")) + sys.argv[1:]
    # From here on Ctrl-C is the daemon's affair: it ends, and then we do.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: None)
    with foreground(), tempfile.TemporaryDirectory() as folder:
        port = Path(folder) / "stand-in"
        device = subprocess.Popen(
            [sys.executable, TOOLS / "standin.py", "--link", port], stdout=subprocess.PIPE, text=True
        )
        try:
            assert device.stdout is not None
            announcement = device.stdout.readline().strip()
            if not announcement:
                print("demo: the stand-in device did not start.", file=sys.stderr)
                return 1
            print(f"Stand-in device on {announcement} (true values). Ctrl-C ends.", file=sys.stderr)
            daemon = subprocess.Popen(
                [sys.executable, "-m", "fltea", "run", "--source", f"serial:{port}", *arguments], text=True
            )
            try:
                while True:
                    with contextlib.suppress(InterruptedError):
                        return daemon.wait()
            finally:
                stop(daemon)
        finally:
            stop(device)


if __name__ == "__main__":
    sys.exit(main())
