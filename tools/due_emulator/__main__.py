"""Run an image for the Arduino Due on an emulated Due, with an MPU-9250 on its I2C pins.

  --virtual S runs S seconds of virtual time as fast as possible, and prints a report on the bytes that a host
  receives.
                 Two runs with the same arguments give the same bytes.
  --pty         offers the programming port as a pseudo-terminal in real time. Opening it resets the board;
                 a wrong baud rate gives garbage; 1200 baud erases the flash. Ctrl-C ends it.

The board is strict: an access to an unknown register or to a peripheral without clock, an overrun, too few
wait states, a second write of the watchdog's mode and the like end the run with a reason.
"""

import argparse
import contextlib
import json
import math
import signal
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from fltea.records.errors import FlteaError, UsageError
from fltea.sources.synthetic import parse_noise

from tools.due_emulator.board import Board
from tools.due_emulator.faults import KINDS, LONGEST_S, Fault, never_happened, parse_fault, schedule_faults
from tools.due_emulator.host_view import HostView
from tools.due_emulator.image import Image, read_image
from tools.due_emulator.machine import EmulationFault, Machine
from tools.due_emulator.noise import World, fractional_world, recorded_world
from tools.due_emulator.pty_front import Front
from tools.due_emulator.report import describe, make_report
from tools.pty_port import PtyPort

SIGNALS = (signal.SIGINT, signal.SIGTERM)
IMAGE = Path(__file__).resolve().parents[2] / "firmware/due/image/fltea_due.bin"
EPILOG = f"""
Kinds of faults: {", ".join(KINDS)}.
Examples:
  python -m tools.due_emulator --virtual 20 --json
  python -m tools.due_emulator --virtual 10 --fault 'sda_stuck at=2 clocks=5' --fault 'unplug at=5 for=1'
  python -m tools.due_emulator --pty --link /tmp/due --noise 'alpha=0.5&f=-1'
Exit codes: 0, or 1 if the program did what the real board does not tolerate, or 2 for wrong arguments.
"""


def parse_arguments(arguments: list[str] | None) -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.due_emulator",
        description=__doc__,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    mode = parser.add_mutually_exclusive_group(required=True)
    mode.add_argument("--virtual", type=float, metavar="S", help="seconds of virtual time to run")
    mode.add_argument("--pty", action="store_true", help="offer the port as a pseudo-terminal, in real time")
    parser.add_argument(
        "--image", type=Path, default=IMAGE, help="raw binary for the Due (default: the committed image)"
    )
    parser.add_argument(
        "--seed", type=int, default=1, help="seed of RAM's contents, random numbers and losses"
    )
    world = parser.add_mutually_exclusive_group()
    world.add_argument(
        "--noise",
        default="",
        metavar="KEY=VALUE&…",
        help="as in synthetic:?… of 'fltea run': alpha, f, Q, R, offset_dps, rate_hz, seed, window",
    )
    world.add_argument(
        "--recording", type=Path, metavar="FILE", help="replay .npz or .csv as the sensor's rate"
    )
    parser.add_argument(
        "--fault", action="append", default=[], metavar="'KIND at=S …'", help="one fault; may be given again"
    )
    parser.add_argument("--json", action="store_true", help="print the report as one JSON object")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the bytes that reach the host")
    parser.add_argument("--baud", type=float, default=250_000, help="the host's baud rate with --virtual")
    parser.add_argument("--link", type=Path, help="with --pty: a symbolic link to the port")
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return the exit code."""
    for number in SIGNALS:
        signal.signal(number, signal.default_int_handler)
    options = parse_arguments(arguments)
    try:
        _check(options)
        image = read_image(options.image)
        world = recorded_world(options.recording) if options.recording else fractional_world(options.noise)
        return _run(options, image, world)
    except FlteaError as error:
        print(f"due_emulator: error: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        return 0 if options.pty else 130


def _check(options: argparse.Namespace) -> None:
    if options.virtual is not None and not 0 < options.virtual <= LONGEST_S:
        raise UsageError(
            f"--virtual {options.virtual:g}: has to be a positive number of seconds, at most {LONGEST_S:g}."
        )
    if options.link and not options.pty:
        raise UsageError("--link: there is a port to link to only with --pty.")
    if not (math.isfinite(options.baud) and options.baud > 0):
        raise UsageError(f"--baud {options.baud:g}: has to be positive and finite.")
    if options.seed < 0:
        raise UsageError(f"--seed {options.seed}: has to be 0 or more.")


def _run(options: argparse.Namespace, image: Image, world: World) -> int:
    board, faults = _build(options, image, world)
    board.bridge.host_baud = options.baud
    host, front, error, wall_s = HostView(board), None, None, None
    with contextlib.ExitStack() as stack:
        write = stack.enter_context(_writer(options.out))
        board.bridge.deliver = lambda byte: write(byte) and host.take(byte)
        if options.pty:
            port = stack.enter_context(contextlib.closing(PtyPort(options.link)))
            board.bridge.strict_baud = False
            board.bridge.deliver = lambda byte: port.put(byte) and write(byte) and host.take(byte)
            front = Front(board, port)
            name = options.link or port.name
            print(f"{name}: {image.path.name} {image.build_id}, {_truth(options)}", flush=True)
            stack.enter_context(contextlib.suppress(KeyboardInterrupt))
        begin_s = time.perf_counter()
        try:
            if front is not None:
                front.serve()
            board.run_until(options.virtual)
        except EmulationFault as fault:
            error = fault.reason
        wall_s = None if front else time.perf_counter() - begin_s
    notes = [*(front.notes if front else ()), *never_happened(faults, board.now_s)]
    report = make_report(board, host, image, wall_s=wall_s, error=error, notes=notes)
    print(json.dumps(report, ensure_ascii=False) if options.json else describe(report), flush=True)
    return 1 if error else 0


def _build(options: argparse.Namespace, image: Image, world: World) -> tuple[Board, list[Fault]]:
    faults = [parse_fault(text) for text in options.fault]
    board = Board(image.content, seed=options.seed, world=world)
    schedule_faults(board, faults)
    _end_on_signals(board.machine)
    return board, faults


def _end_on_signals(machine: Machine) -> None:
    """Let signals set a flag of the machine.

    An exception raised in a callback of the processor would be lost.
    """
    for number in SIGNALS:
        signal.signal(number, lambda *_: setattr(machine, "interrupted", True))


@contextlib.contextmanager
def _writer(path: Path | None) -> Iterator[Callable[[int], bool]]:
    """Yield a function that writes a byte to the file, if there is one, and returns True."""
    if path is None:
        yield lambda byte: True
        return
    try:
        with path.open("wb") as file:
            yield lambda byte: bool(file.write(bytes((byte,))))
    except OSError as error:
        raise UsageError(f"--out {path}: cannot be written ({error.strerror}).") from error


def _truth(options: argparse.Namespace) -> str:
    if options.recording:
        return f"replaying {options.recording}"
    settings = parse_noise(options.noise)
    return f"α {settings.alpha:g}, f {settings.f:g}, Q {settings.Q:g}, R {settings.R:g}"


if __name__ == "__main__":
    sys.exit(main())
