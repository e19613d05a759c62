"""Faults of the board and of the line to it."""

import json
import os
import random
import signal
import termios
import threading
import time
from pathlib import Path

from tools.faults import daemon
from tools.faults.case import Case, Outcome
from tools.faults.program import Program
from tools.faults.pty_board import RATE_HZ, Board, Damage
from tools.faults.stage import Stage

BEFORE = AFTER = 150
CUT = "the half frame"
MODEM = b"AT\r"
DUE = "USB VID:PID=2341:003D SER=75230303 LOCATION=1-1"


def replug(stage: Stage) -> Outcome:
    """The link, as udev makes it, points to another port afterwards."""
    board, program = daemon.pair(stage)
    board.send(BEFORE)
    with stage.fault():
        _unplug_in_mid_frame(board, program)
        program.wait_for(lambda: "no_port" in program.errors(), "the loss")
        board.plug()
    daemon.introduce(board, program)
    board.send(AFTER)
    daemon.finish(board, program)
    return daemon.outcome(stage, board, program, excuse=CUT)


def replug_found_by_usb_id(stage: Stage) -> Outcome:
    """Without --source: the daemon looks for a Due, whatever its port is called."""
    board = stage.board()
    ports = stage.folder / "ports.json"

    def show(*devices: str) -> None:
        part = stage.folder / "ports.part"
        part.write_text(json.dumps([[device, "Arduino Due Prog. Port", DUE] for device in devices]))
        part.replace(ports)

    show(board.port)
    program = stage.daemon("--record", stage.folder / daemon.RECORDING, ports=ports)
    daemon.introduce(board, program)
    board.send(BEFORE)
    first = board.port
    with stage.fault():
        _unplug_in_mid_frame(board, program)
        show()
        program.wait_for(lambda: "no_port" in program.errors(), "the loss")
        board.plug()
        show(board.port)
    daemon.introduce(board, program)
    board.send(AFTER)
    same = [f"the port is {first} again"] if board.port == first else []
    daemon.finish(board, program)
    return daemon.outcome(stage, board, program, excuse=CUT, wrong=same)


def reset_in_mid_frame(stage: Stage) -> Outcome:
    """Half a frame, then the boot's 0x00 and HELLO."""
    board, program = daemon.pair(stage)
    board.send(BEFORE)
    with stage.fault():
        board.begin_frame()
        board.boot()
    board.send(AFTER)
    daemon.finish(board, program)
    return daemon.outcome(
        stage, board, program, excuse=CUT, figures={"bad frames": daemon.bad_frames(program)}
    )


def modem_manager_writes(stage: Stage) -> Outcome:
    """Another program opens the port and writes; the board does not listen, the line has no echo."""
    board, program = daemon.pair(stage)
    board.send(BEFORE)
    with stage.fault():
        for _ in range(3):
            _write_to(board.link, MODEM)
            board.send(10)
    board.send(AFTER)
    wrong = [] if (heard := board.heard()) == 3 * MODEM else [f"the board heard {heard!r}"]
    daemon.finish(board, program)
    return daemon.outcome(stage, board, program, wrong=wrong)


def modem_bytes_in_the_stream(stage: Stage) -> Outcome:
    """As a board or an adapter with echo would send them back: between frames, and inside one."""
    board, program = daemon.pair(stage)
    board.send(BEFORE)
    with stage.fault():
        board.inject(MODEM)
        board.send(10)
        board.send(1, lambda data: data[:-9] + MODEM + data[-9:])
        board.send(10)
        board.inject(MODEM * 100)
    board.send(AFTER)
    daemon.finish(board, program)
    return daemon.outcome(stage, board, program, figures={"bad frames": daemon.bad_frames(program)})


def another_reader(stage: Stage) -> Outcome:
    """Another program reads the port too, as ModemManager does for some seconds: it takes what it gets."""
    board, program = daemon.pair(stage)
    board.send(BEFORE)
    thief = os.open(board.link, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
    stop = threading.Event()
    stolen = 0

    def steal() -> None:
        nonlocal stolen
        while not stop.is_set():
            try:
                stolen += len(os.read(thief, 64))
            except BlockingIOError:
                time.sleep(0.0002)

    thread = threading.Thread(target=steal)
    with stage.fault():
        thread.start()
        board.send(80)  # fewer than `link.max_gap`, whoever gets them
        stop.set()
        thread.join()
        os.close(thief)
    board.send(AFTER)
    daemon.finish(board, program)
    figures = {"bytes taken": stolen}
    return daemon.outcome(
        stage, board, program, others=daemon.dropped(program), line_is_known=False, figures=figures
    )


def flipped_frames(stage: Stage) -> Outcome:
    """One bit in 1 % of the frames."""
    rng = random.Random(4)

    def damage(data: bytes) -> bytes:
        frames = [frame + b"\0" for frame in data.split(b"\0")[:-1]]
        return b"".join(_flip(frame, rng) if rng.random() < 0.01 else frame for frame in frames)

    return _damaged(stage, damage)


def flipped_bytes(stage: Stage) -> Outcome:
    """One bit in 1 % of the bytes: every fourth frame."""
    rng = random.Random(5)

    def damage(data: bytes) -> bytes:
        return bytes(b ^ 1 << rng.randrange(8) if rng.random() < 0.01 else b for b in data)

    return _damaged(stage, damage)


def stall_of_the_line(stage: Stage) -> Outcome:
    """Half a second of frames comes late and at once."""
    board, program = daemon.pair(stage)
    board.send(BEFORE)
    with stage.fault():
        board.stall(RATE_HZ // 2)
    board.send(AFTER)
    daemon.finish(board, program)
    off_ms = daemon.time_stamps_off_ms(program, 1)
    return daemon.outcome(stage, board, program, figures={"time stamps off [ms]": off_ms})


def stall_of_the_program(stage: Stage) -> Outcome:
    """The machine is busy, or asleep: the daemon does not run for half a second."""
    board, program = daemon.pair(stage)
    board.send(BEFORE)
    with stage.fault():
        program.process.send_signal(signal.SIGSTOP)
        board.send(RATE_HZ // 2)
        program.process.send_signal(signal.SIGCONT)
    board.send(AFTER)
    daemon.finish(board, program)
    off_ms = daemon.time_stamps_off_ms(program, 1)
    return daemon.outcome(stage, board, program, figures={"time stamps off [ms]": off_ms})


def long_stall_of_the_program(stage: Stage) -> Outcome:
    """For longer than the line can hold: the board drops whole frames, and the daemon sees the gap."""
    board, program = daemon.pair(stage)
    board.send(BEFORE)
    with stage.fault():
        program.process.send_signal(signal.SIGSTOP)
        board.fill_the_line()  # 70 kB, which would take half a minute
        board.send(200)
        program.process.send_signal(signal.SIGCONT)
    board.send(AFTER)
    daemon.finish(board, program)
    figures = {"frames dropped by the board": board.dropped}
    return daemon.outcome(stage, board, program, others=daemon.dropped(program), figures=figures)


def wraps(stage: Stage) -> Outcome:
    """Sequence at 65536 and device time at 2^32 us, and twenty samples lost across each."""
    board, program = daemon.pair(stage, sequence=(1 << 16) - 110, device_us=(1 << 32) - 2_100_000)
    board.send(100)
    with stage.fault():
        board.lose(20)
        board.send(80)
        board.lose(20)
    board.send(AFTER)
    daemon.finish(board, program)
    samples = program.of("sample")
    wrong = [] if samples[-1]["seq"] > 1 << 16 and samples[-1]["device_us"] > 1 << 32 else ["did not wrap"]
    return daemon.outcome(stage, board, program, wrong=wrong)


def wrong_version(stage: Stage) -> Outcome:
    """The board comes back with firmware of another protocol, then with the right one."""
    board, program = daemon.pair(stage)
    board.send(BEFORE)
    with stage.fault():
        board.boot(protocol_major=9)
        board.send(120)
        board.boot()
    board.send(AFTER)
    daemon.finish(board, program)
    refused = program.of("stats")[-1]["link"]["refused"]
    sent = board.boots[1].frames
    wrong = [] if refused == sent else [f"link.refused is {refused}, but {sent} frames were sent"]
    figures = {"frames refused": refused}
    return daemon.outcome(
        stage, board, program, excuse="those of that firmware", figures=figures, wrong=wrong
    )


def _unplug_in_mid_frame(board: Board, program: Program) -> None:
    program.wait_for_sample(board.boots[-1].boot_id, board.boots[-1].due - 1)  # the line has room for more
    board.begin_frame()
    board.unplug()


def _damaged(stage: Stage, damage: Damage) -> Outcome:
    board, program = daemon.pair(stage)
    board.send(BEFORE)
    with stage.fault():
        board.send(300 if stage.short else 3000, damage)
    board.send(AFTER)
    daemon.finish(board, program)
    return daemon.outcome(stage, board, program, figures={"bad frames": daemon.bad_frames(program)})


def _flip(data: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(data))
    return data[:at] + bytes([data[at] ^ 1 << rng.randrange(8)]) + data[at + 1 :]


def _write_to(path: Path, data: bytes) -> None:
    """As ModemManager does it: open, set the line up, write."""
    fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        termios.tcsetattr(fd, termios.TCSANOW, termios.tcgetattr(fd))
        os.write(fd, data)
    finally:
        os.close(fd)


CASES = (
    Case("unplugged in mid-frame, back as another port", replug),
    Case("the same, found by its USB id", replug_found_by_usb_id),
    Case("reset in mid-frame", reset_in_mid_frame),
    Case("another program writes `AT\\r` to the port", modem_manager_writes),
    Case("`AT\\r` in the stream", modem_bytes_in_the_stream),
    Case("another program reads the port too", another_reader),
    Case("a bit flipped in 1 % of frames", flipped_frames),
    Case("a bit flipped in 1 % of bytes", flipped_bytes),
    Case("line stalls 500 ms, then a burst", stall_of_the_line),
    Case("daemon stopped for 500 ms", stall_of_the_program),
    Case("daemon stopped until the line is full", long_stall_of_the_program),
    Case("sequence and time wrap, 20 samples lost at each", wraps),
    Case("firmware of another protocol version", wrong_version),
)
