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
"""Largest number of received bytes that wait to be decoded. So many are decoded even if no frame has ended.
"""
MAX_GAP = 1 << 30
"""Longest gap, in lost samples, after which the decoder does not begin a new epoch (a new numbering of
samples). It is so large that no gap begins one, and the samples of every gap are counted as lost.
"""


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
        self.hello: wire.Hello | None = None
        self.hello_count = self.boot_count = 0
        """Number of HELLOs received, and number of boots that sent one."""
        self.statuses: list[wire.Status] = []
        """The last STATUS message of each boot that sent one."""
        self.faults: list[tuple[str, int]] = []
        """The FAULT messages: for each, the name of its fault code, and its detail."""
        self.fault_texts: list[str] = []
        self.refused: str | None = None
        self.flags: dict[str, int] = {}
        """For each flag's name: number of samples that had this flag set."""
        self.min_step_us: int | None = None
        self.max_step_us: int | None = None
        self._steps = self._steps_us = 0
        self._last: tuple[int, int] | None = None
        """Sequence number and device time of the last sample. Both go on growing where the numbers in the
        messages wrap.
        """
        self._block = bytearray()
        self._new_boot = True
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

    @property
    def rate_hz(self) -> float | None:
        """Sampling rate by the device's own clock [Hz]. Lost samples count, too.

        None before two samples have arrived.
        """
        return self._steps / self._steps_us * 1e6 if self._steps_us else None

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
                self.hello_count += 1
                if self.hello is None or hello.boot_id != self.hello.boot_id:
                    self.boot_count += 1
                    self._new_boot = True
                    self._heard_boot = self.boots[-1]
                self.hello = hello
                self._decoder.on_hello(hello_event(hello, "emulator", host_ns))
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
                self.faults.append((name, detail))
                text = f"{name} (detail {detail}) at {frame.device_us / 1e6:.3f} s since boot"
                self.fault_texts.append(text)

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
            if piece.new_epoch is None and self._last is not None:
                step_us = device_us - self._last[1]
                self._steps += seq - self._last[0]
                self._steps_us += step_us
                if not piece.missing:
                    self.min_step_us = min(step_us, self.min_step_us or step_us)
                    self.max_step_us = max(step_us, self.max_step_us or step_us)
            self._last = seq, device_us
            boot = self._heard_boot
            boot.heard = (boot.heard[0] if boot.heard else seq, seq)

    @property
    def counts(self) -> SampleStats:
        """Counts of delivered, lost and rejected samples."""
        return self._decoder.counts

    @property
    def due(self) -> int | None:
        """Number of samples that the board's timer demanded. None if the sensor's clock times the samples."""
        timer = self.hello is not None and self.hello.sampling_mode == wire.SamplingMode.TIMER
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
