"""Share what all made-up boards have in common: a HELLO, and the numbering of their frames.

The boards differ in when they speak and what they remember. `standin` serves a port in real time.
`faults.pty_board` remembers every byte that it sent. `tests/rig/estimating_board` needs no port.
`bench.feeder` speaks for hundreds of boards.
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
"""HELLO of an MPU-9250 at 100 Hz and ±2000 deg/s. Each board replaces the fields that differ."""


class Voice:
    """Numbers the messages of a board, each message type separately, and encodes them as frames."""

    def __init__(self) -> None:
        self._next = dict.fromkeys(wire.MESSAGES, 0)

    def number(self, message: wire.Message) -> int:
        """Return the sequence number of the next message of this type, modulo 2**16, and count it as used."""
        sequence = self._next[message.TYPE]
        self._next[message.TYPE] = (sequence + 1) % SEQUENCE_WRAP
        return sequence

    def next_sample(self) -> int:
        """Return the sequence number that the next SAMPLE will have."""
        return self._next[wire.Sample.TYPE]

    def says(self, message: wire.Message, device_us: int, sequence: int | None = None) -> bytes:
        """Return `message` as a frame.

        `sequence`: used instead of the next number of this type. `sequence` and `device_us` are reduced to
        their width on the wire.
        """
        number = self.number(message) if sequence is None else sequence % SEQUENCE_WRAP
        return encode(message, number, device_us % TIME_WRAP_US)
