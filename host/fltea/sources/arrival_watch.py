"""Checks whether live samples without times arrive at the rate that the user states."""

from itertools import pairwise

import numpy as np

from fltea.records.events import Trouble


class ArrivalWatch:
    """Checks whether samples that are numbered by their order arrive at the stated rate.

    A buffer between sender and program delays samples, and then many arrive at once. So of each second or so,
    only the arrival with the smallest delay is used. If this delay suddenly becomes larger and stays larger,
    samples were lost, or the sender paused.
    """

    WHILE_S, CHUNKS, LEAST_JUMP_S = 1.0, 3, 0.1
    NEEDED, RATE_S, RATE_TOLERANCE = 4, 10.0, 0.02

    def __init__(self, url: str, rate_hz: float) -> None:
        self._url, self._rate_hz = url, rate_hz
        self._reported_rate = False
        self.begin()

    def begin(self) -> None:
        """Forget all arrivals of samples, since the sender restarted."""
        self._origin: tuple[float, float] | None = None
        self._whiles: list[tuple[float, float]] = []
        self._doubt: tuple[float, float] | None = None
        self._open: list[tuple[float, float]] = []
        self._pauses_s: list[float] = []

    def add(self, device_us: int, host_ns: int) -> Trouble | None:
        """Note the device time and the arrival time of the last of several samples that arrived together.

        Return a warning if samples now come later than before, or not at the stated rate.
        """
        host_s, device_s = host_ns * 1e-9, device_us * 1e-6
        if self._origin is None:
            self._origin = (host_s, device_s)
        host_s, device_s = host_s - self._origin[0], device_s - self._origin[1]
        self._open.append((host_s - device_s, host_s))
        if len(self._open) < self.CHUNKS or host_s - self._open[0][1] < self.WHILE_S:
            return None
        late_s = min(late for late, _ in self._open)
        chunks_s = [at for _, at in self._open]
        self._open = []
        return self._judge(host_ns, late_s, host_s, max(b - a for a, b in pairwise(chunks_s)))

    def _judge(self, now_ns: int, late_s: float, host_s: float, longest_s: float) -> Trouble | None:
        if len(self._whiles) >= self.NEEDED:
            slope = self._slope()
            reference = self._whiles[-1]
            jump_s = late_s - reference[0] - slope * (host_s - reference[1])
            least_s = max(self.LEAST_JUMP_S, 3 / self._rate_hz, float(np.median(self._pauses_s)))
            if jump_s > least_s and self._doubt is None:
                # the smallest delay in the next second shows whether the delay stays this large
                self._doubt = late_s, host_s
                return None
            if jump_s > least_s:
                self._whiles, self._doubt = [(late_s, host_s)], None
                text = (
                    f"{self._url}: samples come {jump_s:.3g} s later than before, and stay late: about "
                    f"{jump_s * self._rate_hz:.0f} were lost on the way, or the sender paused. Nobody can "
                    "tell which ones, so the numbers of the samples go on as if none were missing. If "
                    "the sender writes its own time (--time-column), gaps are found."
                )
                return Trouble("arrival_jump", text, now_ns, fatal=False)
            self._doubt = None
        self._whiles = [*self._whiles[-29:], (late_s, host_s)]
        self._pauses_s = [*self._pauses_s[-29:], longest_s]
        return self._rate(now_ns)

    def _slope(self) -> float:
        """Return by how much the delay of the samples grows per second. Jumps of the delay are not included.

        The result is the median of the changes from each second to the next. The slope of a straight line
        (`clock_fit`) would be worse, since a jump that has not been recognised yet would change it.
        """
        late, host = np.array(self._whiles).T
        return float(np.median(np.diff(late) / np.diff(host)))

    def _rate(self, now_ns: int) -> Trouble | None:
        span_s = self._whiles[-1][1] - self._whiles[0][1]
        if self._reported_rate or len(self._whiles) < 2 * self.NEEDED or span_s < self.RATE_S:
            return None
        slope = self._slope()
        if abs(slope) <= self.RATE_TOLERANCE:
            return None
        self._reported_rate = True
        text = (
            f"{self._url}: samples come at {self._rate_hz * (1 - slope):.4g} Hz, but --rate says "
            f"{self._rate_hz:g}: all figures in seconds or Hz are wrong by as much. Give the true rate, or a "
            "column of times (--time-column). For a stored file use replay:/dev/stdin."
        )
        return Trouble("rate_differs", text, now_ns, fatal=False)
