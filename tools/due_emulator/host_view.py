"""What a host makes of the bytes: fltea's own decoder and its own judgement of continuity, frame by frame."""

from typing import Any

from fltea.records.events import SEQUENCE_WRAP, TIME_WRAP_US, RawSample, block_of
from fltea.stream.place import Place
from fltea.wire import layout as wire
from fltea.wire.block_reader import FrameReader
from fltea.wire.message_events import hello_event
from fltea.wire.messages import Frame, Refused

from tools.due_emulator.board import Board
from tools.due_emulator.instants import Instants
from tools.due_emulator.machine import PS_PER_S, PS_PER_US

CHUNK_BYTES = 512
"""So many bytes without an end of frame are handed on as they are."""
MAX_GAP = 1 << 30
"""No gap is too long to be counted as one."""


class HostView:
    """Takes bytes as they arrive and keeps counts."""

    def __init__(self, board: Board) -> None:
        self._machine = board.machine
        self._instants = Instants(board)
        self._spans: dict[int, tuple[int, int]] = {}
        """Of each boot that was heard, by its place: numbers of the first and of the last sample."""
        self._boot = 0
        self.reader = FrameReader()
        self.place = Place(MAX_GAP)
        self.hello: wire.Hello | None = None
        self.hellos = 0
        self.boots: list[int] = []
        """boot_id of each boot that was heard."""
        self.statuses: list[wire.Status] = []
        """The last one of each boot that gave one."""
        self.faults: list[str] = []
        self.refused: str | None = None
        self.flags: dict[str, int] = {}
        """How many samples had each flag."""
        self.min_step_us: int | None = None
        self.max_step_us: int | None = None
        self._steps = 0
        self._steps_us = 0
        self._last: tuple[int, int] | None = None
        """Number and time of the last sample, unwrapped."""
        self._block = bytearray()
        self._new_boot = True

    def take(self, byte: int) -> bool:
        """Take one byte; the answer is always that it was taken."""
        # What a frame is, its last byte decides, and no other byte is 0.
        self._block.append(byte)
        if byte and len(self._block) < CHUNK_BYTES:
            return True
        block, self._block = bytes(self._block), bytearray()
        for item in self.reader.feed(block):
            if isinstance(item, Refused):
                self.refused = item.message
            else:
                self._on_frame(item)
        return True

    @property
    def bytes_in(self) -> int:
        """Bytes taken."""
        return self.reader.bytes_in + len(self._block)

    @property
    def rate_hz(self) -> float | None:
        """Samples per second of the device's own clock, lost ones included; None before two samples."""
        return self._steps / self._steps_us * 1e6 if self._steps_us else None

    def _on_frame(self, frame: Frame) -> None:
        host_ns = self._machine.now_ps // 1000
        match frame.message:
            case wire.Hello() as hello:
                self.hellos += 1
                if self.hello is None or hello.boot_id != self.hello.boot_id:
                    self.boots.append(hello.boot_id)
                    self._new_boot = True
                    self._boot = self._instants.boot
                self.hello = hello
                self.place.on_hello(hello_event(hello, "emulator", host_ns))
            case wire.Sample() as sample:
                self._on_sample(sample, frame, host_ns)
            case wire.Status() as status:
                if not self._new_boot:
                    self.statuses.pop()
                self.statuses.append(status)
                self._new_boot = False
            case wire.Fault(code, detail):
                known = code in wire.FaultCode._value2member_map_
                name = wire.FaultCode(code).name.lower() if known else str(code)
                self.faults.append(f"{name} (detail {detail}) at {frame.device_us / 1e6:.3f} s since boot")

    def _on_sample(self, sample: wire.Sample, frame: Frame, host_ns: int) -> None:
        for flag in wire.SampleFlags:
            if sample.flags & flag:
                name = str(flag.name).lower()
                self.flags[name] = self.flags.get(name, 0) + 1
        gyro = (sample.gyro_x, sample.gyro_y, sample.gyro_z)
        raw = RawSample(frame.sequence % SEQUENCE_WRAP, frame.device_us % TIME_WRAP_US, host_ns, gyro)
        for piece in self.place.on_block(block_of([raw])):
            seq, device_us = int(piece.seq[0]), int(piece.device_us[0])
            if piece.new_epoch is None and self._last is not None:
                step_us = device_us - self._last[1]
                self._steps += seq - self._last[0]
                self._steps_us += step_us
                if not piece.missing:
                    self.min_step_us = min(step_us, self.min_step_us or step_us)
                    self.max_step_us = max(step_us, self.max_step_us or step_us)
            self._last = seq, device_us
            first = self._spans.get(self._boot, (seq, 0))[0]
            self._spans[self._boot] = (first, seq)

    @property
    def due(self) -> int | None:
        """Instants that were due, by the timer; None where the sensor's clock or another program decides."""
        timer = self.hello is not None and self.hello.sampling_mode == wire.SamplingMode.TIMER
        return sum(self._instants.due) if timer else None

    @property
    def unheard(self) -> int | None:
        """Those before the first and after the last sample that was heard of each boot; None as for `due`."""
        heard = sum(last - first + 1 for first, last in self._spans.values())
        return None if self.due is None else self.due - heard


def plain(message: wire.Message | None) -> dict[str, Any] | None:
    """Fields of a message as JSON can hold them; bytes in hex."""
    if message is None:
        return None
    return {
        name: value.hex() if isinstance(value, bytes) else value
        for name, value in zip(message._fields, message, strict=True)
    }


def seconds(ps: int) -> float:
    """Picoseconds to seconds, to the microsecond."""
    return round(ps / PS_PER_US) * PS_PER_US / PS_PER_S
