"""A device on a pseudo-terminal that remembers every byte it sent."""

import contextlib
import os
import random
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from fltea.wire import layout as wire

from tools.faults.program import PATIENCE_S
from tools.made_up_board import HELLO, LEVEL, STATUS, MadeUpBoard, frames
from tools.pty_port import PtyPort

RATE_HZ = 100
PERIOD_NS = 10**9 // RATE_HZ
LSB_PER_DPS = HELLO.gyro_lsb / 10
INTRODUCTION_S = 0.2

Damage = Callable[[bytes], bytes]
Instants = set[tuple[int, int]]
"""A set of sampling instants. Each is given by the number of the boot (from 0) and the number of the instant
in that boot.
"""


class Boot:
    """One boot of the board. `sequence`: number of its first sampling instant.

    `counts`: the gyroscope's counts at each instant. `frames`: number of frames of any kind that were sent.
    """

    def __init__(self, boot_id: int, sequence: int) -> None:
        self.boot_id = boot_id
        self.sequence = sequence
        self.counts: list[tuple[int, int, int]] = []
        self.frames = 0

    @property
    def due(self) -> int:
        """Number of sampling instants of this boot so far."""
        return len(self.counts)


class Board:
    """A board that samples at 100 Hz of real time, with HELLO and STATUS once a second.

    Its methods send in the caller's thread, and wait until the board's clock reaches each sampling instant.
    `streams`: bytes sent, for each time that the board was plugged in. `dropped`: number of frames that were
    lost because the port was full. `longest_silence_s`: longest time without sending while the board was
    plugged in. This time may be long because a busy system lets this process wait.
    """

    def __init__(self, link: Path, seed: int = 1) -> None:
        self.link = link
        self.boots: list[Boot] = []
        self.streams: list[bytearray] = []
        self.dropped = 0
        self.longest_silence_s = 0.0
        self._random = random.Random(seed)
        self._blocks: dict[bytes, tuple[int, int]] = {}
        self._begin_ns = 0
        self._port = PtyPort(held=True)
        hello = HELLO._replace(device_id=b"faults".ljust(16, b"\0"), firmware_version="faults")
        self._board = MadeUpBoard(hello, status=STATUS, rate_hz=RATE_HZ)
        self.plug()

    # --- plugging and unplugging ---

    def plug(self) -> None:
        """Appear as a new port, to which `link` points."""
        self._port.show_as(self.link)
        self.streams.append(bytearray())
        self._said_s = time.monotonic()

    @property
    def port(self) -> str:
        """Name of the port in the system."""
        return self._port.name

    def unplug(self) -> None:
        """Remove the port and the link. At the next `plug`, the port has another name."""
        before, self._port = self._port, PtyPort(held=True)
        before.close()

    def close(self) -> None:
        """Close the port."""
        self._port.close()

    # --- sending ---

    def introduce(self, heard: Callable[[], bool], **how: int) -> None:
        """Boot, and send HELLO until `heard` returns True. `how`: parameters of the boot, as for `boot`."""
        self._begin_boot(**how)
        deadline_s = time.monotonic() + PATIENCE_S
        while not heard():
            if time.monotonic() > deadline_s:
                raise TimeoutError("nobody heard the board's HELLO")
            with contextlib.suppress(BlockingIOError):  # no program has the port open
                os.write(self._port.master, self._board.booted())
            self._note_silence()
            until_s = time.monotonic() + INTRODUCTION_S
            while not heard() and time.monotonic() < until_s:
                time.sleep(0.01)
        self.boots[-1].frames = 0
        self._begin_ns = time.monotonic_ns()

    def boot(self, **how: int) -> None:
        """Boot again, even if only a part of the last frame has been sent.

        `sequence`, `device_us`: number and time of the first sampling instant. `protocol_major`, `stated_hz`:
        what HELLO states.
        """
        self._begin_boot(**how)
        self.boots[-1].frames += 1
        self._write(self._board.booted())

    def send(self, instants: int, damage: Damage | None = None) -> None:
        """Send the frames of a number of sampling instants.

        `damage`: function that changes the bytes of each instant before they are sent.
        """
        for _ in range(instants):
            data = self._tick()
            self._write(damage(data) if damage else data)

    def send_until(self, condition: Callable[[], bool], what: str) -> None:
        """Send samples until a condition is true."""
        deadline_s = time.monotonic() + PATIENCE_S
        while not condition():
            if time.monotonic() > deadline_s:
                raise TimeoutError(f"waited in vain for {what}")
            self.send(1)

    def send_during(self, action: Callable[[], object]) -> None:
        """Send samples while another thread runs `action`; an exception of `action` is raised here."""
        with ThreadPoolExecutor(1) as pool:
            doing = pool.submit(action)
            self.send_until(doing.done, "the action of the other thread")
            doing.result()

    def stall(self, instants: int) -> None:
        """Hold back the frames of `instants` sampling instants, then send all of them together."""
        self._write(b"".join(self._tick() for _ in range(instants)))

    def lose(self, instants: int) -> None:
        """Let `instants` sampling instants pass without sending their frames."""
        for _ in range(instants):
            self._tick()

    def begin_frame(self) -> None:
        """Send only the first half of the next sample's frame."""
        self._write(self._tick()[:-14])

    def inject(self, data: bytes) -> None:
        """Send bytes that do not come from the board's program."""
        self._write(data)

    def fill_the_line(self) -> None:
        """Send idle bytes, which have no meaning, until the port is full, since no program reads."""
        full = 0
        # The port is full only if it takes no byte five times in a row. A busy system may still move bytes
        # from one of the port's buffers to the next, which makes room again.
        while full < 5:
            full = 0 if self._port.fill() else full + 1
            time.sleep(0.05)

    def heard(self) -> bytes:
        """Return the bytes that programs sent to the board, which itself ignores them."""
        return self._port.heard()

    def arrived(self) -> Instants:
        """Return the samples whose frames were sent completely."""
        return set().union(*(self.samples_in(bytes(stream)) for stream in self.streams))

    def samples_in(self, wire: bytes) -> Instants:
        """Return the samples whose frames are complete in these bytes."""
        return {self._blocks[block] for block in wire.split(b"\0")[:-1] if block in self._blocks}

    # --- private methods ---

    def _begin_boot(
        self,
        sequence: int = 0,
        device_us: int = 0,
        protocol_major: int = wire.PROTOCOL_MAJOR,
        stated_hz: int = RATE_HZ,
    ) -> None:
        self.boots.append(boot := Boot(len(self.boots) + 1, sequence))
        self._board.restart(
            first=sequence,
            device_us=device_us,
            boot_id=boot.boot_id,
            protocol_major=protocol_major,
            sample_rate=stated_hz * 1000,
        )
        self._begin_ns = time.monotonic_ns()

    def _tick(self) -> bytes:
        """Wait for the next sampling instant; return its frames."""
        boot = self.boots[-1]
        k = boot.due
        left_ns = self._begin_ns + k * PERIOD_NS - time.monotonic_ns()
        if left_ns > 0:
            time.sleep(left_ns * 1e-9)
        gyro = x, y, z = tuple(round(self._random.gauss(0, 3)) for _ in range(3))
        # The accelerations x and y are no physical values: they make each frame differ from all frames of all
        # boots.
        accel = boot.boot_id, self._random.randrange(1 << 15), LEVEL[2]
        self._board.status = STATUS._replace(dropped_frames=self.dropped)
        sent = self._board.tick(gyro, accel)
        boot.frames += len(sent)
        boot.counts.append((x, y, z))
        self._blocks[sent[-1].frame[:-1]] = (len(self.boots) - 1, k)
        return frames(sent)

    def _note_silence(self) -> None:
        before_s, self._said_s = self._said_s, time.monotonic()
        self.longest_silence_s = max(self.longest_silence_s, self._said_s - before_s)

    def _write(self, data: bytes) -> None:
        """Send bytes, or drop them if the port is full."""
        self._note_silence()
        if self._port.send(data):
            self.streams[-1] += data
        else:
            self.dropped += data.count(0)
