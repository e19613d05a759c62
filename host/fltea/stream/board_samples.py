"""Remember the newest samples of a board, since its estimates and fits arrive later than their samples."""

from typing import NamedTuple

from fltea.records.block import Block
from fltea.records.estimate import AxisEstimate
from fltea.records.events import SEQUENCE_WRAP
from fltea.records.records import GYRO_UNIT
from fltea.stream.epoch import Moment

REMEMBERED = 256
"""This many of the newest samples are remembered. An estimate never arrives more than this many samples after
its own sample: a board that falls further behind skips samples instead.
"""


class RecentSample(NamedTuple):
    """The sample in row `row` of `block`.

    `age`: number of estimates that the host's filters have made from their start-up window to this sample.
    """

    seq: int
    block: Block
    row: int
    age: int

    def moment(self) -> Moment:
        """Return number, epoch, device time and host time of the sample."""
        block, row = self.block, self.row
        return Moment(self.seq, block.epoch, int(block.device_us[row]), int(block.host_ns[row]))

    def estimates(self) -> dict[str, AxisEstimate]:
        """Return this computer's estimates after the sample.

        The estimates include those of FLTEA's filters if these run.
        """
        return self.block.estimates_at(self.row, GYRO_UNIT)

    def has_filters(self) -> bool:
        """Return whether this computer's filters gave estimates of the gyroscope.

        In their start-up window they give none.
        """
        return any(columns.unit == GYRO_UNIT for columns in self.block.estimates)


class RecentSamples:
    """Remembers the newest samples since the last restart of the filters."""

    def __init__(self) -> None:
        self._samples: dict[int, RecentSample] = {}
        self._window_end = 0

    def clear(self) -> None:
        """Forget all samples."""
        self._samples.clear()

    def add(self, block: Block) -> None:
        """Remember the newest samples of a block, and forget the oldest."""
        if not block.estimates:
            self._window_end = int(block.seq[-1])
        first = max(0, len(block) - REMEMBERED)
        for row, seq in enumerate(block.seq[first:].tolist(), first):
            self._samples[seq] = RecentSample(seq, block, row, seq - self._window_end)
        while len(self._samples) > REMEMBERED:
            del self._samples[next(iter(self._samples))]

    def newest(self) -> Moment | None:
        """Return number and times of the newest sample; None if no sample is remembered."""
        return self._samples[next(reversed(self._samples))].moment() if self._samples else None

    def find(self, number: int) -> RecentSample | None:
        """Return the sample whose number on the wire, which wraps, is `number`.

        Return None if it is not remembered.
        """
        if not self._samples:
            return None
        newest = next(reversed(self._samples))
        return self._samples.get(newest - (newest - number) % SEQUENCE_WRAP)
