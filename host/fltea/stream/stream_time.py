"""Follow the time of one device's stream, and when the statistics of the device are due."""

from fltea._native import Device
from fltea.records.clock import SECOND_NS
from fltea.stream.epoch import NEVER
from fltea.stream.fit_times import turn
from fltea.stream.fit_worker import FitWorker


class StreamTime:
    """The present time of a stream.

    `now_ns`: arrival time of the newest event or sample on the monotonic clock [ns]. `source_offset_ns`: the
    source's present offset from host time to Unix time [ns]. `offset_ns`: the offset with which records get
    their times [ns]. It is the source's offset until the first epoch begins, and then changes only where an
    epoch begins.
    """

    def __init__(self, offset_ns: int) -> None:
        self.now_ns = 0
        self.offset_ns = self.source_offset_ns = offset_ns

    def take_offset(self) -> None:
        """From now on, give records their times with the source's present offset."""
        self.offset_ns = self.source_offset_ns

    @property
    def unix_ns(self) -> int:
        """Present Unix time [ns]."""
        return self.now_ns + self.offset_ns


class StatsTimes:
    """Knows when the statistics of a device are due: at the first event of each new period of `stats_s`.

    `fit_worker`: knows how many devices there are. `number`: index of this device. The beginning of its
    periods depends on both (`fit_times.turn`). `watched`: whether an output shows the statistics; if not,
    none are due.
    """

    def __init__(
        self, device: Device, stats_s: int, fit_worker: FitWorker | None, number: int, *, watched: bool
    ) -> None:
        self._device, self._watched = device, watched
        self._period_ns = stats_s * SECOND_NS
        self._offset_ns = turn(fit_worker or FitWorker(), number, self._period_ns)
        self._knows_time = False
        device.stats_due_ns = -NEVER if watched else NEVER

    def pass_time(self, now_ns: int) -> bool:
        """Take notice of an event, and return whether to publish the statistics before it is processed.

        At the very first event no statistics are due, since nothing has happened yet.
        """
        if not self._watched or (self._knows_time and now_ns < self._device.stats_due_ns):
            return False
        is_due, self._knows_time = self._knows_time, True
        begun = (now_ns - self._offset_ns) // self._period_ns
        self._device.stats_due_ns = (begun + 1) * self._period_ns + self._offset_ns
        return is_due
