"""Decode the bytes from the board as the host does: with fltea's own decoder and sequence tracker."""

from typing import Any

from fltea.records.events import SEQUENCE_WRAP, TIME_WRAP_US, RawSample, block_of
from fltea.records.stats import SampleStats
from fltea.stream.decode import Decoded, Decoder
from fltea.wire import layout as wire
from fltea.wire.block_reader import FrameReader
from fltea.wire.message_events import hello_event
from fltea.wire.messages import Frame, Refused

from tools.due_emulator.board import Board
from tools.due_emulator.instants import Boot, Burst, BusWatch
from tools.due_emulator.machine import PS_PER_S, PS_PER_US
from tools.due_emulator.reset_controller import ResetType

CHUNK_BYTES = 64
"""Largest number of received bytes that wait to be decoded. They are decoded when a frame ends, or at the
latest when there are so many.
"""
MAX_GAP = 1 << 30
"""Limit for gaps, in lost samples: after a longer gap, the decoder would begin a new epoch (a new numbering
of samples). No gap reaches this limit, so the samples of every gap are counted as lost.
"""


class ToldByBoard:
    """What the board says of itself in its messages.

    `hello`: the newest HELLO. `hello_count`: number of HELLOs received. `boot_count`: number of boots that
    sent one. `statuses`: the last STATUS message of each boot that sent one. `faults`: name of the fault
    code, and detail, of each FAULT message. `fault_texts`: for each FAULT message, a text for people with
    name, detail and time.
    """

    def __init__(self) -> None:
        self.hello: wire.Hello | None = None
        self.hello_count = self.boot_count = 0
        self.statuses: list[wire.Status] = []
        self.faults: list[tuple[str, int]] = []
        self.fault_texts: list[str] = []
        self._new_boot = True

    def on_hello(self, hello: wire.Hello) -> bool:
        """Take a HELLO. Return whether it is the first one of a boot."""
        is_new = self.hello is None or hello.boot_id != self.hello.boot_id
        self.hello = hello
        self.hello_count += 1
        self.boot_count += is_new
        self._new_boot |= is_new
        return is_new

    def on_status(self, status: wire.Status) -> None:
        """Take a STATUS message, which replaces an earlier one of the same boot."""
        if not self._new_boot:
            self.statuses.pop()
        self.statuses.append(status)
        self._new_boot = False

    def on_fault(self, code: int, detail: int, device_us: int) -> None:
        """Take a FAULT message that the board sent `device_us` after its boot."""
        known = code in wire.FaultCode._value2member_map_
        name = wire.FaultCode(code).name.lower() if known else str(code)
        self.faults.append((name, detail))
        self.fault_texts.append(f"{name} (detail {detail}) at {device_us / 1e6:.3f} s since boot")


class Steps:
    """The steps of the device's time from one sample to the next.

    `min_us`, `max_us`: the shortest and the longest step over which no sample was lost [µs]; None until there
    is such a step.
    """

    def __init__(self) -> None:
        self.min_us: int | None = None
        self.max_us: int | None = None
        self._count = self._total_us = 0
        self._last: tuple[int, int] | None = None
        """Sequence number and device time of the last sample. The numbers in the messages wrap around to 0;
        these two do not.
        """

    def add(self, seq: int, device_us: int, missing: int, *, new_epoch: bool) -> None:
        """Take a sample before which `missing` samples were lost. No step leads to the first of an epoch."""
        if not new_epoch and self._last is not None:
            step_us = device_us - self._last[1]
            self._count += seq - self._last[0]
            self._total_us += step_us
            if not missing:
                self.min_us = min(step_us, self.min_us or step_us)
                self.max_us = max(step_us, self.max_us or step_us)
        self._last = seq, device_us

    @property
    def rate_hz(self) -> float | None:
        """Sampling rate by the device's own clock [Hz]; lost samples count. None before the second sample."""
        return self._count / self._total_us * 1e6 if self._total_us else None


class HostView:
    """Receives the board's bytes as they arrive, and keeps only counts.

    A longer run therefore needs no more memory.
    """

    def __init__(self, board: Board) -> None:
        self.board = board
        self.boots = [Boot(ResetType.POWER_UP, 0)]
        self._heard_boot = self.boots[0]
        self.reader = FrameReader()
        self._decoder = Decoder(lambda: 0, MAX_GAP)
        self.told = ToldByBoard()
        self.refused: str | None = None
        self.flags: dict[str, int] = {}
        """For each flag's name: number of samples that had this flag set."""
        self.steps = Steps()
        self._block = bytearray()
        BusWatch(board, self.on_burst)
        board.on_reset = self._on_reset

    @property
    def now_ps(self) -> int:
        """Virtual time [ps]."""
        return self.board.machine.now_ps

    def take(self, byte: int) -> bool:
        """Receive one byte; return True, since every byte is accepted."""
        # A frame ends with its only byte that is 0.
        self._block.append(byte)
        if not byte or len(self._block) >= CHUNK_BYTES:
            data, self._block = bytes(self._block), bytearray()
            self.on_data(data)
        return True

    def stop(self) -> None:
        """Store the present time as the end of the present boot.

        If the boot continues, a later call replaces the stored time.
        """
        self.boots[-1].ended_ps = self.now_ps

    @property
    def bytes_in(self) -> int:
        """Number of bytes received."""
        return self.reader.bytes_in + len(self._block)

    def on_data(self, data: bytes) -> None:
        """Process bytes that arrived together."""
        for item in self.reader.feed(data):
            if isinstance(item, Refused):
                self.refused = item.message
            else:
                self.on_frame(item)

    def on_frame(self, frame: Frame) -> None:
        """Process a frame that has passed its checks."""
        host_ns = self.now_ps // 1000
        match frame.message:
            case wire.Hello() as hello:
                if self.told.on_hello(hello):
                    self._heard_boot = self.boots[-1]
                self._decoder.on_hello(hello_event(hello, "emulator", host_ns))
            case wire.Sample() as sample:
                self._on_sample(sample, frame, host_ns)
            case wire.Status() as status:
                self.told.on_status(status)
            case wire.Fault(code, detail):
                self.told.on_fault(code, detail, frame.device_us)

    def on_burst(self, burst: Burst) -> None:
        """Handle the moment at which the board begins to read the sensor's data."""
        boot = self.boots[-1]
        boot.first_ps = burst.at_ps if boot.first_ps is None else boot.first_ps

    def _on_reset(self, cause: ResetType) -> None:
        self.stop()
        self.boots.append(Boot(cause, self.now_ps))

    def _on_sample(self, sample: wire.Sample, frame: Frame, host_ns: int) -> None:
        for flag in wire.SampleFlags:
            if sample.flags & flag:
                name = str(flag.name).lower()
                self.flags[name] = self.flags.get(name, 0) + 1
        gyro = (sample.gyro_x, sample.gyro_y, sample.gyro_z)
        raw = RawSample(frame.sequence % SEQUENCE_WRAP, frame.device_us % TIME_WRAP_US, host_ns, gyro)
        for piece in self._decoder.feed(block_of([raw])):
            assert isinstance(piece, Decoded)
            seq, device_us = int(piece.block.seq[0]), int(piece.block.device_us[0])
            self.steps.add(seq, device_us, piece.missing, new_epoch=piece.new_epoch is not None)
            boot = self._heard_boot
            boot.heard = (boot.heard[0] if boot.heard else seq, seq)

    @property
    def counts(self) -> SampleStats:
        """Counts of delivered, lost and rejected samples."""
        return self._decoder.counts

    @property
    def due(self) -> int | None:
        """Number of samples that the board's timer demanded. None if the sensor's clock times the samples."""
        hello = self.told.hello
        timer = hello is not None and hello.sampling_mode == wire.SamplingMode.TIMER
        return sum(boot.due for boot in self.boots) if timer else None


def plain(message: wire.Message | None) -> dict[str, Any] | None:
    """Return a message's fields in a form that JSON can hold; bytes become hexadecimal text."""
    if message is None:
        return None
    return {
        name: value.hex() if isinstance(value, bytes) else value
        for name, value in zip(message._fields, message, strict=True)
    }


def seconds(ps: int) -> float:
    """Convert picoseconds to seconds, rounded to microseconds."""
    return round(ps / PS_PER_US) * PS_PER_US / PS_PER_S
