"""Makes the frames of a simulated board, one sampling instant after another.

The board has no port and no clock: its time is the number of sampling instants divided by its rate. The
modules that use it decide when its frames are sent, and what is stored of them: `standin` serves a port in
real time, `faults.pty_board` remembers every byte, `bench.feeder` sends for hundreds of boards, and tests
feed the frames to the host directly (`estimating_board`, `wire_story` and `frames_messages` in tests/rig).
"""

from collections import deque
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from fltea.records.events import SEQUENCE_WRAP, TIME_WRAP_US
from fltea.wire import layout as wire
from fltea.wire.messages import encode

from tools.own_estimator import OwnEstimator

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
STATUS = wire.Status(0, 0, 0, 0, 0, wire.ResetCause.USER, 0, 0)
"""STATUS of a board that has nothing to report."""
LEVEL = (0, 0, HELLO.accel_lsb)
"""Acceleration of a board that lies still [counts]."""
TEMPERATURE_25C = round((25.0 - 21.0) * 333.87)


class Sent(NamedTuple):
    """A message with its header, as the board sends it.

    Attributes:
        instant: Number of the sampling instant since the boot at which it is sent.
        message: The message.
        sequence: Number of the message, counted separately for each type of message and each boot, modulo
            2**16.
        device_us: Time since the boot [us], modulo 2**32.
    """

    instant: int
    message: wire.Message
    sequence: int
    device_us: int

    @property
    def frame(self) -> bytes:
        """The encoded bytes of the frame with this message."""
        return encode(self.message, self.sequence, self.device_us)


def frames(sent: Iterable[Sent]) -> bytes:
    """Return the encoded bytes of several messages, one after another."""
    return b"".join(one.frame for one in sent)


class MadeUpBoard:
    """A simulated board that sends samples, and a greeting at its first instant and then once a second.

    The greeting is HELLO, ESTIMATOR if the board estimates, and STATUS.

    Each type of message is numbered separately; a SAMPLE has the number of its sampling instant.

    Attributes:
        hello: The HELLO that the board sends.
        status: The STATUS that it sends after HELLO, or None if it sends none.
        instant: Number of sampling instants since the boot. If a caller increases this number, the board
            skips the samples between the old and the new number.

    Args:
        hello: As the attribute.
        status: As the attribute.
        rate_hz: Sampling rate [Hz]; None for the rate that `hello` states.
        pace: Ratio of the true sampling period to the nominal period.
        first: Number of the first SAMPLE.
        own: The estimator that the board runs; None if the board does not estimate.
        own_late: Number of sampling instants from a sample to the sending of its estimates.
    """

    def __init__(
        self,
        hello: wire.Hello = HELLO,
        *,
        status: wire.Status | None = None,
        rate_hz: float | None = None,
        pace: float = 1.0,
        first: int = 0,
        own: OwnEstimator | None = None,
        own_late: int = 0,
    ) -> None:
        self.hello, self.status = hello, status
        self._rate_hz = hello.sample_rate / 1000 if rate_hz is None else rate_hz
        self._period_us = 1e6 / self._rate_hz * pace
        self._own, self._own_late = own, own_late
        self.restart(first=first)

    def restart(self, *, first: int = 0, device_us: int = 0, **news: object) -> None:
        """Begin another boot, without sending anything.

        Args:
            first: Number of the first SAMPLE.
            device_us: Time of the first sampling instant [us].
            news: Fields of HELLO that have changed.
        """
        self.hello = self.hello._replace(**news)  # type: ignore[arg-type]
        self.instant, self._first, self._begin_us = 0, first, device_us
        self._numbers = dict.fromkeys(wire.MESSAGES, 0)
        self._greeted = -1
        self._late: deque[tuple[int, list[wire.Estimate]]] = deque()

    @property
    def device_us(self) -> int:
        """Time of the next sampling instant since the boot [us]."""
        return self._begin_us + round(self.instant * self._period_us)

    def jump(self, us: int) -> None:
        """Set the board's clock ahead [us]."""
        self._begin_us += us

    def says(self, message: wire.Message) -> Sent:
        """Send a message with the next number of its type.

        A SAMPLE has the number of its sampling instant.
        """
        kind = message.TYPE
        if kind == wire.Sample.TYPE:
            number = self._first + self.instant
        else:
            number = self._numbers[kind]
            self._numbers[kind] += 1
        return Sent(self.instant, message, number % SEQUENCE_WRAP, self.device_us % TIME_WRAP_US)

    def states(self) -> list[Sent]:
        """Send HELLO, and the estimator's settings if the board estimates."""
        return [self.says(self.hello), *([self.says(self._own.stated)] if self._own else [])]

    def booted(self) -> bytes:
        """Return the bytes that begin a boot.

        The bytes are 0x00, which ends any unfinished frame, then HELLO, and ESTIMATOR if the board estimates.
        """
        return b"\0" + frames(self.states())

    def greets(self) -> list[Sent]:
        """Send HELLO, the estimator's settings if the board estimates, and STATUS."""
        return [*self.states(), *([self.says(self.status)] if self.status else [])]

    def sample(self, gyro: Sequence[int], accel: Sequence[int] = LEVEL) -> Sent:
        """Send only a sample [counts], without a greeting, and continue with the next sampling instant."""
        sent = self.says(wire.Sample._make((*gyro, *accel, TEMPERATURE_25C, 0)))
        self.instant += 1
        return sent

    def tick(self, gyro: Sequence[int] | None, accel: Sequence[int] = LEVEL) -> list[Sent]:
        """Send all messages of a sampling instant.

        The messages are a greeting if a second begins, the sample, and the estimates that are due. If `gyro`
        is None, the board misses the sample and sends none.
        """
        second = int(self.instant / self._rate_hz)
        sent = self.greets() if second != self._greeted else []
        self._greeted = second
        if gyro is not None:
            sent.append(self.says(wire.Sample._make((*gyro, *accel, TEMPERATURE_25C, 0))))
        sent += map(self.says, self._estimates(gyro))
        self.instant += 1
        return sent

    def _estimates(self, gyro: Sequence[int] | None) -> list[wire.Estimate]:
        """Compute the estimates of this instant's sample, and return the estimates that are due now.

        The estimates that are due now may be of earlier samples.
        """
        if self._own is None:
            return []
        number = (self._first + self.instant) % SEQUENCE_WRAP
        self._late.append((self.instant, self._own.step(gyro, number)))
        due = []
        while self._late and self._late[0][0] <= self.instant - self._own_late:
            due += self._late.popleft()[1]
        return due
