"""Faults of the board and of its serial port."""

import contextlib
import json
import os
import random
import select
import signal
import termios
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from tools.faults.case import Case
from tools.faults.daemon import Scene, bad_frames, time_stamps_off_ms
from tools.faults.expected import SOME, Expected
from tools.faults.outcome import LOST, Outcome
from tools.faults.pty_board import RATE_HZ, Damage
from tools.faults.stage import Stage

CUT = "the half frame"
MOST_OTHERS_DROPPED = 6
"""Largest number of HELLO and STATUS frames that the board may drop in addition to samples; the board sends
four such frames in two seconds.
"""
MODEM = b"AT\r"
DUE = "USB VID:PID=2341:003D SER=75230303 LOCATION=1-1"


def replug(stage: Stage) -> Outcome:
    """Unplug the board and plug it in again.

    When the board is plugged in again, the link (like a link that udev makes) points to another port.
    """
    scene = Scene(stage)
    _unplug_and_plug(scene)
    return scene.outcome(excuse=CUT)


def replug_found_by_usb_id(stage: Stage) -> Outcome:
    """Unplug the board and plug it in again, without --source: the daemon searches for a Due on any port."""
    ports = stage.folder / "ports.json"

    def show(*devices: str) -> None:
        part = stage.folder / "ports.part"
        part.write_text(json.dumps([[device, "Arduino Due Prog. Port", DUE] for device in devices]))
        part.replace(ports)

    board = stage.board()
    show(board.port)
    scene = Scene(stage, board=board, source=(), ports=ports)
    first = board.port
    _unplug_and_plug(scene, show)
    same = [f"the port is {first} again"] if board.port == first else []
    return scene.outcome(excuse=CUT, wrong=same)


def _unplug_and_plug(scene: Scene, show: Callable[..., None] = lambda *devices: None) -> None:
    """Unplug the board in the middle of a frame, and plug it in again.

    `show`: makes ports of these names known to the daemon.
    """
    with scene.fault() as board:
        # Wait until the daemon has all samples. The port's buffer may still contain bytes, and these would be
        # lost when the board is unplugged.
        scene.program.wait_for_sample(board.boots[-1].boot_id, board.boots[-1].due - 1)
        board.begin_frame()
        # Hide the port before the board is unplugged. After that, the system may give the port's name to a
        # new port of another program, and the daemon would open that one.
        show()
        board.unplug()
        scene.program.wait_for(lambda: "no_port" in scene.program.errors(), "the loss")
        board.plug()
        show(board.port)
    scene.introduce()


def reset_in_mid_frame(stage: Stage) -> Outcome:
    """Reset the board in the middle of a frame.

    The board sends half a frame, then the 0x00 and the HELLO of a new boot.
    """
    scene = Scene(stage)
    with scene.fault() as board:
        board.begin_frame()
        board.boot()
    scene.finish()
    return scene.outcome(excuse=CUT, figures=bad_frames(scene.program))


def modem_manager_writes(stage: Stage) -> Outcome:
    """Let another program open the port and write to it. The board ignores this, and the port has no echo."""
    scene = Scene(stage)
    with scene.fault() as board:
        for _ in range(3):
            _write_to(board.link, MODEM)
            board.send(10)
    return scene.outcome(
        wrong=[] if (heard := board.heard()) == 3 * MODEM else [f"the board heard {heard!r}"]
    )


def modem_bytes_in_the_stream(stage: Stage) -> Outcome:
    """Send bytes of a modem command between frames and inside a frame.

    Such bytes come back from a port with an echo when ModemManager writes to it.
    """
    scene = Scene(stage)
    with scene.fault() as board:
        board.inject(MODEM)
        board.send(10)
        board.send(1, lambda data: data[:-9] + MODEM + data[-9:])
        board.send(10)
        board.inject(MODEM * 100)
    scene.finish()
    return scene.outcome(figures=bad_frames(scene.program))


def another_reader(stage: Stage) -> Outcome:
    """Let another program read the port too, as ModemManager does for some seconds.

    The other program takes away some of the bytes.
    """
    scene = Scene(stage)
    thief = os.open(scene.board.link, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
    stop = threading.Event()
    stolen = 0

    def steal() -> None:
        nonlocal stolen
        while not stop.is_set():
            # Arriving bytes wake this thread and the daemon at the same time. Each of them gets some bytes.
            select.select([thief], [], [], 0.01)
            with contextlib.suppress(BlockingIOError):
                stolen += len(os.read(thief, 64))

    thread = threading.Thread(target=steal)
    with scene.fault() as board:
        thread.start()
        # The other program reads while 80 samples are sent, fewer than `link.max_gap`. So the daemon begins
        # no new epoch (run of samples), even if it misses all 80.
        board.send(80)
        stop.set()
        thread.join()
        os.close(thief)
    return scene.outcome(line_is_known=False, recording_is_whole=False, figures={"bytes taken": stolen})


def flipped_frames(stage: Stage) -> Outcome:
    """Flip one bit in 1 % of the frames."""
    rng = random.Random(4)

    def damage(data: bytes) -> bytes:
        frames = [frame + b"\0" for frame in data.split(b"\0")[:-1]]
        return b"".join(_flip(frame, rng) if rng.random() < 0.01 else frame for frame in frames)

    return _damaged(stage, damage)


def flipped_bytes(stage: Stage) -> Outcome:
    """Flip one bit in 1 % of the bytes, which damages every fourth frame."""
    rng = random.Random(5)

    def damage(data: bytes) -> bytes:
        return bytes(b ^ 1 << rng.randrange(8) if rng.random() < 0.01 else b for b in data)

    return _damaged(stage, damage)


def stall_of_the_line(stage: Stage) -> Outcome:
    """Hold back the frames of half a second, then send them together."""
    return _stalled(stage, lambda scene: scene.board.stall(RATE_HZ // 2))


def stall_of_the_program(stage: Stage) -> Outcome:
    """Stop the daemon for half a second, as on a busy or sleeping machine."""

    def stop(scene: Scene) -> None:
        scene.program.process.send_signal(signal.SIGSTOP)
        scene.board.send(RATE_HZ // 2)
        scene.program.process.send_signal(signal.SIGCONT)

    return _stalled(stage, stop)


def _stalled(stage: Stage, stall: Callable[[Scene], None]) -> Outcome:
    scene = Scene(stage)
    with scene.fault():
        stall(scene)
    scene.finish()
    return scene.outcome(figures=time_stamps_off_ms(scene.program, 1))


def long_stall_of_the_program(stage: Stage) -> Outcome:
    """Stop the daemon for so long that the buffer of the port is full.

    The board then drops frames, so there is a gap.
    """
    scene = Scene(stage)
    with scene.fault() as board:
        scene.program.process.send_signal(signal.SIGSTOP)
        # sends 70 kB at once, since the board alone would take half a minute to fill the port's buffer
        board.fill_the_line()
        board.send(200)
        scene.program.process.send_signal(signal.SIGCONT)
    scene.finish()
    figures = {"frames dropped by the board": board.dropped}
    found = scene.outcome(recording_is_whole=False, figures=figures)
    others = board.dropped - found.where[LOST]
    if 0 <= others <= MOST_OTHERS_DROPPED:
        return found
    return replace(
        found, wrong=[*found.wrong, f"the board dropped {others} more frames than samples are lost"]
    )


def wraps(stage: Stage) -> Outcome:
    """Let the sequence number wrap at 65536 and device time at 2^32 us.

    Twenty samples are lost at each of the two wraps.
    """
    scene = Scene(stage, boot={"sequence": (1 << 16) - 110, "device_us": (1 << 32) - 2_100_000})
    with scene.fault(before=100) as board:
        board.lose(20)
        board.send(80)
        board.lose(20)
    scene.finish()
    last = scene.program.of("sample")[-1]
    return scene.outcome(
        wrong=[] if last["seq"] > 1 << 16 and last["device_us"] > 1 << 32 else ["did not wrap"]
    )


def wrong_version(stage: Stage) -> Outcome:
    """Boot the board with firmware of another protocol version, then with the right version."""
    scene = Scene(stage)
    with scene.fault() as board:
        board.boot(protocol_major=9)
        board.send(120)
        board.boot()
    scene.finish()
    refused, sent = scene.program.of("stats")[-1]["link"]["refused"], board.boots[1].frames
    wrong = [] if refused == sent else [f"link.refused is {refused}, but {sent} frames were sent"]
    return scene.outcome(excuse="those of that firmware", figures={"frames refused": refused}, wrong=wrong)


def contradicting_rate(stage: Stage) -> Outcome:
    """Boot the board with firmware whose HELLO states twice the true rate, then with correct firmware."""
    scene = Scene(stage)
    with scene.fault() as board:
        board.boot(stated_hz=2 * RATE_HZ)
        scene.send_until_error("rate_differs")
        board.send(120)
        board.boot()
    scene.finish()
    program, sent = scene.program, board.boots[1]
    epochs = {record["epoch"] for record in program.of("epoch") if record["boot_id"] == sent.boot_id}
    delivered = sum(record["epoch"] in epochs for record in program.of("sample"))
    unused = program.of("stats")[-1]["sample_counts"]["rate_differs"]
    wrong = []
    if delivered + unused != sent.due:
        wrong.append(f"{delivered} delivered + {unused} counted as rate_differs are not the {sent.due} sent")
    if "estimate" in {record["class"] for record in program.records if record.get("epoch") in epochs}:
        wrong.append("estimates at a rate that the board's clock contradicts")
    figures = {"delivered before it was known": delivered, "counted as rate_differs": unused}
    return scene.outcome(excuse="those of the contradicting boot", figures=figures, wrong=wrong)


def _damaged(stage: Stage, damage: Damage) -> Outcome:
    scene = Scene(stage)
    with scene.fault() as board:
        board.send(300 if stage.short else 3000, damage)
    scene.finish()
    return scene.outcome(figures=bad_frames(scene.program))


def _flip(data: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(data))
    return data[:at] + bytes([data[at] ^ 1 << rng.randrange(8)]) + data[at + 1 :]


def _write_to(path: Path, data: bytes) -> None:
    """Write to the port as ModemManager does: open the port, configure it, and write."""
    fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        termios.tcsetattr(fd, termios.TCSANOW, termios.tcgetattr(fd))
        os.write(fd, data)
    finally:
        os.close(fd)


UNPLUGGED = ("unplugged", "no_port", "restart")
CASES = (
    Case(
        "unplugged in mid-frame, back as another port",
        replug,
        Expected(UNPLUGGED, due=301, excused=1),
    ),
    Case(
        "the same, found by its USB id",
        replug_found_by_usb_id,
        Expected(UNPLUGGED, due=301, excused=1),
    ),
    Case("reset in mid-frame", reset_in_mid_frame, Expected(("restart",), due=301, excused=1)),
    Case("another program writes `AT\\r` to the port", modem_manager_writes, Expected(due=330)),
    Case("`AT\\r` in the stream", modem_bytes_in_the_stream, Expected(due=321, lost=3)),
    Case(
        "another program reads the port too",
        another_reader,
        Expected(due=380, lost=SOME, figures={"bytes taken": SOME}),
    ),
    Case("a bit flipped in 1 % of frames", flipped_frames, Expected(due=600, lost=4)),
    Case("a bit flipped in 1 % of bytes", flipped_bytes, Expected(due=600, lost=65)),
    Case("line stalls 500 ms, then a burst", stall_of_the_line, Expected(due=350)),
    Case("daemon stopped for 500 ms", stall_of_the_program, Expected(due=350)),
    Case(
        "daemon stopped until the line is full",
        long_stall_of_the_program,
        Expected(("gap",), due=500, lost=SOME),
    ),
    Case(
        "sequence and time wrap, 20 samples lost at each",
        wraps,
        Expected(due=370, lost=40),
    ),
    Case(
        "firmware of another protocol version",
        wrong_version,
        Expected(("version", "restart"), due=420, excused=120),
    ),
    Case(
        "a contradicting rate",
        contradicting_rate,
        Expected(("rate_differs", "restart", "restart"), excused=SOME),
    ),
)
