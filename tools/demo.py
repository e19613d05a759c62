"""`make run`: start the emulated Due with its real firmware and `fltea run` with its live page.

Ctrl-C ends both. The noise of the emulated sensor is so strong that its order is known after a minute. The
true parameters of the noise are printed first, and are part of the device's name. If standard output is no
terminal and ARGS has no --format, one line a second is printed instead of every record.

On a terminal this program takes the foreground, so that Ctrl-C reaches the daemon and not make, which would
report a failure.
"""

import contextlib
import json
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
from typing import IO, Any

from fltea.noise.spectra import noise_variance
from fltea.records.plus_minus import plus_minus

ROOT = Path(__file__).resolve().parents[1]

ALPHA, F = 0.8, -1.0
S2_OVER_R = 3.0
R = 0.02
"""Variance of the white noise [(deg/s)²]: 2.3 LSB rms, as the MPU-9250 has in the paper on FLTEA. Rounding to
counts adds 1.5 %.
"""
RATE_HZ = 100.0
NOISE = f"alpha={ALPHA:g}&f={F:g}&Q={noise_variance(ALPHA, S2_OVER_R * R, 1 / RATE_HZ):.6g}&R={R:g}"
DEVICE = f"due-alpha_{ALPHA:g}-f_{F:g}"
"""Name of the serial port, which is also the device's name."""
KNOWN = ((30, 0.08, 0.8), (60, 0.06, 0.6), (600, 0.02, 0.2))
"""Smallest possible 95 % uncertainties of the noise's parameters after some times, as (time [s], ± of α, ± of
f). They were computed by tools/validation/evaluate/cramer_rao.py.
"""
TRUTH = (
    f"make run: the true noise of this sensor has α = {ALPHA:g} and f = {F:g} s^-α, in white noise (s2/R = "
    f"{S2_OVER_R:g}, R = {R:g} (deg/s)²). It cannot be known exactly from a short record: at best "
    + ", ".join(f"α ± {alpha:g} and f ± {f:g} after {seconds} s" for seconds, alpha, f in KNOWN)
    + " (95 %)."
)

SLOW = "real time"
"""Words that occur only in the emulator's warning that it is slower than real time."""
MEANING = (
    "make run: the emulator is too slow, so the board's clock looks slow to this computer, and fewer samples "
    "come per second; α, f and noise per sample are unaffected, because the board samples by its own clock."
)
STOP_TIMEOUT_S = 5.0
PAGE_PORT = 5006
STATE = ROOT / "build/demo.state"


@contextlib.contextmanager
def foreground() -> Iterator[None]:
    """Make this process the foreground process of its terminal.

    If there is no terminal, or the system does not allow it, nothing happens.
    """
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
    """Ask a process to end, and kill it if it does not; return the rest of its standard output."""
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
    try:
        process.wait(STOP_TIMEOUT_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    # The last output is only a few lines long, so it fits into the pipe. Another thread reads standard error.
    return "" if process.stdout is None or process.stdout.closed else process.stdout.read()


def page(arguments: list[str]) -> list[str]:
    """Return the options of `fltea run` for the live page, or none if `arguments` already has such options.

    The page is on its usual TCP port, or on any free port if that one is in use. If it is on the usual port,
    the daemon also stores the state of its estimators, so that the next run resumes from this one.
    """
    if any(argument.startswith("--dashboard") for argument in arguments):
        return []
    kept = any(argument.startswith(("--state", "--estimate-on")) for argument in arguments)
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", PAGE_PORT))
        except OSError:
            return ["--dashboard", "0"]
    STATE.parent.mkdir(exist_ok=True)
    return ["--dashboard", str(PAGE_PORT), *([] if kept else ["--state", str(STATE)])]


def output(arguments: list[str]) -> list[str]:
    """Return the option that makes the daemon write NDJSON, which this program summarises.

    No option is returned on a terminal, or if the user has chosen a format.
    """
    asked = any(argument.startswith("--format") for argument in arguments)
    return [] if asked or sys.stdout.isatty() else ["--format", "ndjson"]


class Summary:
    """Turns the records of one run into a line of text for each `stats` record, which comes once a second."""

    def __init__(self) -> None:
        self._axes: dict[str, dict[str, Any]] = {}
        """For each device, the axes of the last estimate in the present epoch."""
        self._errors: dict[str, int] = {}
        """For each device, the number of errors since the last line about it."""

    def line(self, text: str) -> str | None:
        """Process a line of the daemon's NDJSON. Return the text to show for it, or None.

        A line that is not a record is returned unchanged.
        """
        try:
            record = json.loads(text)
            kind, device = record["class"], record["device"]
        except (ValueError, KeyError, TypeError):
            return text
        match kind:
            case "epoch":
                self._axes.pop(device, None)
            case "estimate":
                self._axes[device] = record["axes"]
            case "error":
                self._errors[device] = self._errors.get(device, 0) + 1
            case "stats":
                return self._of_stats(device, record)
        return None

    def _of_stats(self, device: str, stats: dict[str, Any]) -> str:
        samples, axes = stats["sample_counts"], self._axes.get(device)
        parts = [f"{samples['delivered']} samples, {samples['lost']} lost"]
        if axes is not None:
            parts += [f"{name} {_axis(axis)}" for name, axis in axes.items()]
        elif stats["startup_remaining"]:
            parts.append(f"start-up: {stats['startup_remaining']} samples to go")
        if errors := self._errors.pop(device, 0):
            parts.append(f"{errors} errors")
        return f"{device}: " + "; ".join(parts)


def _axis(axis: dict[str, Any]) -> str:
    """Return a text with the verdict and the bias of an axis.

    If the noise has an order, α and f with their intervals are included.
    """
    verdict = axis["verdict"] or "no stable verdict yet"
    order = [f"{name} {p}" for name in ("alpha", "f") if (p := _interval(axis[name]))]
    words = [verdict, *(text.replace("alpha", "α") for text in order)]
    if axis["bias"] is not None and axis["bias_std"] is not None:
        words.append(f"bias {plus_minus(axis['bias'], axis['bias_std'])} {axis['unit']}")
    return ", ".join(words) + (", moving" if axis["moving"] else "")


def _interval(p: dict[str, float | None]) -> str:
    value, low, high = p["value"], p["low"], p["high"]
    if value is None or low is None or high is None:
        return ""
    return f"{value:.2f} [{low:.2f}, {high:.2f}]".replace("-0.00", "0.00")


def show_summary(records: IO[str]) -> None:
    """Print one line a second from the daemon's NDJSON, until it ends or standard output is closed."""
    summary = Summary()
    for record in records:
        if (line := summary.line(record.rstrip("\n"))) is None:
            continue
        try:
            print(line, flush=True)
        except BrokenPipeError:
            # Nobody reads standard output any more, so it is redirected to the null device. Otherwise Python
            # would raise the error again when it flushes standard output at exit.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            records.close()
            return


def pass_on(warnings: Iterable[str]) -> None:
    """Print the emulator's warnings. If it is too slow, explain once what this means for the figures."""
    explained = False
    for line in warnings:
        print(line, end="", file=sys.stderr, flush=True)
        if SLOW in line and not explained:
            explained = True
            print(MEANING, file=sys.stderr, flush=True)


def run_daemon(port: Path, arguments: list[str]) -> int:
    """Run `fltea run` on the emulated board's port until it ends, and return its exit code."""
    short = output(arguments)
    command = ["run", "--source", f"serial:{port}", *page(arguments), *short, *arguments]
    daemon = subprocess.Popen(
        [sys.executable, "-m", "fltea", *command], text=True, stdout=subprocess.PIPE if short else None
    )
    # The terminal sends Ctrl-C to the daemon directly. Signals that only this program gets are passed on to
    # the daemon.
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: daemon.send_signal(signal.SIGTERM))
    try:
        if daemon.stdout is not None:
            show_summary(daemon.stdout)
        return daemon.wait()
    finally:
        stop(daemon)


def main() -> int:
    """Run the board and the daemon until the daemon ends; return the daemon's exit code."""
    arguments = shlex.split(os.environ.get("ARGS", "")) + sys.argv[1:]
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: None)
    with foreground(), tempfile.TemporaryDirectory() as folder:
        port = Path(folder) / DEVICE
        # The board is in a process group of its own, so that Ctrl-C does not reach it. If the board vanished
        # before the daemon ended, the daemon would report it as unplugged.
        board = subprocess.Popen(
            [sys.executable, "-m", "tools.due_emulator", "--pty", "--link", port, "--noise", NOISE],
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
            print(f"Emulated Arduino Due on {announcement}. Ctrl-C ends.\n{TRUTH}", file=sys.stderr)
            return run_daemon(port, arguments)
        finally:
            # The last output of the emulator also says whether this machine kept up with real time.
            print(f"Emulated Arduino Due: {stop(board)}", end="", file=sys.stderr)
            listener.join(STOP_TIMEOUT_S)


if __name__ == "__main__":
    sys.exit(main())
