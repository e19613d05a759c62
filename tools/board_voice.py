"""What all made-up boards have in common: a HELLO, and how their frames are numbered.

The boards differ in when they speak and what they remember: `standin` serves a port at its own pace,
`faults.pty_board` remembers every bit that it put on the line, `tests/rig/estimating_board` needs no line,
`bench.feeder` speaks for hundreds.
"""

from fltea.records.events import SEQUENCE_WRAP, TIME_WRAP_US
from fltea.wire import layout as wire
from fltea.wire.messages import encode

HELLO = wire.Hello(
    wire.PROTOCOL_MAJOR,
    wire.PROTOCOL_MINOR,
    wire.SCHEMA_HASH,
    boot_id=5,
    device_id=bytes(range(16)),
    firmware_version="1.2.3",
    who_am_i=0x71,
    sensor_starts=1,
    sample_rate=100_000,
    gyro_range=2000,
    gyro_lsb=164,
    accel_range=2,
    accel_lsb=16384,
    gyro_dlpf=184,
    sampling_mode=wire.SamplingMode.TIMER,
)
"""An MPU-9250 at 100 Hz and ±2000 deg/s; boards replace what is their own."""


class Voice:
    """Numbers the messages of a board, each type by itself, and makes frames of them."""

    def __init__(self) -> None:
        self._next = dict.fromkeys(wire.MESSAGES, 0)

    def number(self, message: wire.Message) -> int:
        """The number of the next message of this type, modulo 2**16."""
        sequence = self._next[message.TYPE]
        self._next[message.TYPE] = (sequence + 1) % SEQUENCE_WRAP
        return sequence

    def next_sample(self) -> int:
        """The number that the next SAMPLE will have."""
        return self._next[wire.Sample.TYPE]

    def says(self, message: wire.Message, device_us: int, sequence: int | None = None) -> bytes:
        """The message as a frame. sequence: in place of the next number of its type. Both may still wrap."""
        number = self.number(message) if sequence is None else sequence % SEQUENCE_WRAP
        return encode(message, number, device_us % TIME_WRAP_US)
