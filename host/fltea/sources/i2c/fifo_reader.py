"""Reads a running sensor's samples from its FIFO, and numbers them.

Samples that may be wrong are not passed on, but only counted.
"""

from collections import Counter
from collections.abc import Callable
from itertools import takewhile
from typing import NamedTuple

from fltea.records.events import SEQUENCE_WRAP, TIME_WRAP_US, RawSample
from fltea.sources.i2c.chip import Row
from fltea.sources.i2c.driver import BURST_BYTES, Driver, Level, SensorFault, TransferFailed
from fltea.sources.i2c.fifo_clock import FifoClock, Span
from fltea.wire.layout import FaultCode, SampleFlags

TIMELY_NS = 2_000_000
"""A reading of the FIFO's fill level is used to estimate the clock only if it took at most this time [ns]."""
SILENT_NS = 100_000_000
"""After this time without a sample, the sensor counts as stopped [ns]."""
MOST_EQUAL = 10
"""After this many equal samples in succession, a sensor counts as frozen. The noise of a working sensor makes
its samples differ.
"""


class Loss(NamedTuple):
    """Samples that were lost when the FIFO was emptied.

    Their true number differs from `missing` by at most `doubt`.
    """

    cause: str
    missing: int
    doubt: int


class Unchecked(NamedTuple):
    """A sample that was read, before the check that the sensor still has its settings.

    `arrived_ns`: estimated time of its arrival [ns].
    """

    row: Row
    number: int
    arrived_ns: int
    flags: SampleFlags


class NominalTime:
    """Computes the device times of samples from their sequence numbers and the sensor's nominal rate."""

    def __init__(self, rate_hz: float) -> None:
        self._origin = (0, 0.0)
        self._period_us = 1e6 / rate_hz

    def begin(self, number: int, rate_hz: float) -> None:
        """Go on at another nominal rate after the sample with this sequence number."""
        self._origin = (number, self.us(number))
        self._period_us = 1e6 / rate_hz

    def us(self, number: int) -> float:
        """Return the device time of a sample [us]."""
        first, first_us = self._origin
        return first_us + (number - first) * self._period_us


class Repeats:
    """Counts how many samples in succession are equal."""

    def __init__(self) -> None:
        self._last: Row = ()
        self._equal = 0

    def add(self, row: Row) -> int:
        """Return the length of the run of equal samples that ends with this one, this one included."""
        self._equal = self._equal + 1 if row == self._last else 1
        self._last = row
        return self._equal


class Restarts:
    """Restarts of the FIFO, which empty it.

    `counts`: number of restarts, by cause. `is_due`: whether the next poll has to restart the FIFO.
    `may_be_due`: whether the FIFO may have overflowed while it was read, so that the sensor has to be asked.
    `cause`: cause of the last restart, or of the one that is due; empty if the sensor was just set up.
    `last_ns`: time of the last restart [ns].
    """

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.is_due = self.may_be_due = False
        self.cause = ""
        self.last_ns = 0

    def demand(self, cause: str) -> None:
        """Let the next poll restart the FIFO."""
        self.cause, self.is_due = cause, True

    def note(self, cause: str, now_ns: int) -> None:
        """Note that the FIFO was restarted."""
        self.is_due = self.may_be_due = False
        self.cause, self.last_ns = cause, now_ns
        if cause:
            self.counts[cause] += 1


class FifoReader:
    """Reads one sensor that `driver` has set up.

    `now_ns`: function that reads the host's clock [ns]. `samples`: number of samples that were passed on.
    `overruns`: number of sampling instants whose samples were lost or are not valid. `losses`: losses that
    have not been reported yet.
    """

    def __init__(self, driver: Driver, now_ns: Callable[[], int]) -> None:
        self.samples = self.overruns = 0
        self.restarts = Restarts()
        self.losses: list[Loss] = []
        self._driver = driver
        self._now_ns = now_ns
        self._clock = FifoClock(driver.chip.rate_hz, driver.chip.clock_error)
        self._empty: Span | None = None
        self._repeats = Repeats()
        self._unchecked: list[Unchecked] = []
        self._latest_ns = 0
        self._time = NominalTime(driver.chip.rate_hz)

    @property
    def hurry(self) -> bool:
        """Whether to poll again at once.

        After a loss, the arrival time of the first sample shows how many were lost, so it has to be measured
        exactly.
        """
        return self.restarts.is_due or self._empty is not None

    def begin(self) -> None:
        """Start to read a sensor that was just set up, and whose FIFO is being filled."""
        chip = self._driver.chip
        # the device time continues, at the nominal rate of the chip that is read now
        self._time.begin(max(0, self._clock.next - 1), chip.rate_hz)
        self._clock.begin(chip.rate_hz, chip.clock_error)
        self._repeats = Repeats()
        # nobody can check these samples any more, since the sensor was set up again; they count as lost
        self._unchecked = []
        self._restarted("")

    def poll(self) -> list[RawSample]:
        """Return the samples that came since the last call, or since the last call that failed.

        Samples that were read before a transfer failed are kept, and returned by the next call that succeeds.

        Raises:
            SensorFault: the sensor must be set up again.
            TransferFailed: a transfer failed because the bus is disturbed.
        """
        driver = self._driver
        self._ask_for_overflow()
        if self.restarts.is_due:
            driver.restart_fifo()
            self._restarted(self.restarts.cause)
            return []
        level, doubt = self._level()
        waiting = self._whole_samples(level, doubt)
        driver.retried = False
        rows, cut_off = self._take_out(waiting)
        flags = SampleFlags.RETRIED if driver.retried else SampleFlags(0)
        if rows:
            if self._empty is not None:
                self._resume(waiting, self._empty, level.after_ns)
            timely = doubt is None and level.after_ns - level.before_ns < TIMELY_NS
            numbers = self._clock.take(len(rows), waiting, level.after_ns, timely=timely)
            self._unchecked += [Unchecked(row, *one, flags) for row, one in zip(rows, numbers, strict=True)]
        # these samples count as lost until the check below has shown that the sensor still has its settings
        self.overruns += len(rows)
        if cause := doubt or cut_off:
            self.restarts.demand(cause)
        else:
            self._watch_overflow(level, waiting)
        samples = self._checked()
        if self._empty is not None and not self.restarts.is_due:
            if not samples and level.after_ns - self.restarts.last_ns > SILENT_NS:
                raise SensorFault(FaultCode.SENSOR_FROZEN, 0)
            self._empty = Span(level.before_ns, level.after_ns)
        return samples

    def _checked(self) -> list[RawSample]:
        """Check that the sensor still has its settings, and return the samples that were read before.

        A sensor that lost its settings does not get them back by itself. So if it has them now, it also had
        them when the samples were read, even if the bus has failed in between.
        """
        self._driver.check_settings()
        samples = [self._sample(*one) for one in self._unchecked]
        self._unchecked = []
        self.overruns -= len(samples)
        self.samples += len(samples)
        return samples

    def _level(self) -> tuple[Level, str | None]:
        """Return the FIFO's fill level, and the reason why its contents may be wrong, or None."""
        level = self._driver.level()
        doubt = self._doubt(level)
        if doubt is None or level.overflowed:
            return level, doubt
        # The fill level seems wrong, but interference may have flipped a bit, or the sensor was just writing
        # a sample. So the level is read once more.
        level = self._driver.level()
        doubt = self._doubt(level)
        self._driver.i2c_errors += doubt is None
        return level, doubt

    def _doubt(self, level: Level) -> str | None:
        samples, rest = divmod(level.bytes, self._driver.chip.packet.size)
        if level.overflowed:
            return "overflow"
        if rest:
            return "misaligned"
        if self._empty is None and self._clock.out_of_step(samples, level.before_ns, level.after_ns):
            return "out_of_step"
        return None

    def _whole_samples(self, level: Level, doubt: str | None) -> int:
        """Return the number of whole samples in the FIFO.

        `doubt`: reason why the FIFO's contents may be wrong, or None. If there is a reason, the result is 0.
        One exception: the FIFO of some chips (`keeps_oldest`) still holds whole samples after an overflow.
        """
        chip = self._driver.chip
        if doubt is None or (doubt == "overflow" and chip.keeps_oldest):
            return min(level.bytes, chip.fifo_bytes) // chip.packet.size
        return 0

    def _take_out(self, n: int) -> tuple[list[Row], str | None]:
        """Read `n` samples from the FIFO.

        Return the samples that arrived, and the reason why other samples may be lost, or None.
        """
        rows: list[Row] = []
        burst = BURST_BYTES // self._driver.chip.packet.size
        cut_off = None
        try:
            while len(rows) < n:
                rows += self._driver.read_samples(min(burst, n - len(rows)))
        except TransferFailed as failed:
            cut_off = "broken_transfer" if failed.acknowledged else None
        true = list(takewhile(self._driver.chip.packet.is_sample, rows))
        return true, cut_off or (None if len(true) == len(rows) else "out_of_step")

    def _resume(self, waiting: int, empty: Span, seen_ns: int) -> None:
        missing, doubt = self._clock.resume(waiting, empty, seen_ns)
        self.overruns += missing
        self._empty = None
        if self.restarts.cause:
            self.losses.append(Loss(self.restarts.cause, missing, doubt))

    def _watch_overflow(self, level: Level, read: int) -> None:
        """Let the next poll restart the FIFO if the FIFO overflowed after `level` was read.

        That may happen if the program was delayed.
        """
        chip = self._driver.chip
        room = chip.fifo_bytes // chip.packet.size - read
        room_ns = room / chip.rate_hz * 1e9 * (1 - max(0.1, 2 * chip.clock_error))
        self.restarts.may_be_due = self._now_ns() - level.before_ns > room_ns
        self._ask_for_overflow()

    def _ask_for_overflow(self) -> None:
        """Ask the sensor whether the FIFO overflowed, if that may have happened while it was read.

        If the transfer fails, the next poll asks again, before it reads other samples.
        """
        if self.restarts.may_be_due:
            if self._driver.level().overflowed:
                self.restarts.demand("overflow")
            self.restarts.may_be_due = False

    def _sample(self, row: Row, number: int, arrived_ns: int, flags: SampleFlags) -> RawSample:
        equal = self._repeats.add(row)
        if equal == MOST_EQUAL:
            raise SensorFault(FaultCode.SENSOR_FROZEN, equal)
        if equal > 1:
            flags |= SampleFlags.REPEATED
        accel, temperature, gyro = self._driver.counts(row)
        lowest, highest = self._driver.chip.gyro_ends
        if min(gyro) <= lowest or max(gyro) >= highest:
            flags |= SampleFlags.SATURATED
        # `arrived_ns` is an estimate. The maximum is taken so that no sample seems to arrive before the
        # sample that precedes it.
        self._latest_ns = max(self._latest_ns, arrived_ns)
        sequence, device_us = number % SEQUENCE_WRAP, round(self._time.us(number)) % TIME_WRAP_US
        return RawSample(sequence, device_us, self._latest_ns, gyro, accel, temperature, int(flags))

    def _restarted(self, cause: str) -> None:
        self._empty = self._driver.filled
        self.restarts.note(cause, self._now_ns())
