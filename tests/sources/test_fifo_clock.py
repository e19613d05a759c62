"""Compares sample numbers with the true ones of a simulated sensor. The clock that is tested computes them
only from the counts of samples in the FIFO and the times of reading.
"""

import random

import pytest
from fltea.sources.i2c.fifo_clock import FifoClock, Span
from hypothesis import given, settings
from hypothesis import strategies as st

MS = 1_000_000
S = 1_000_000_000


class Sensor:
    """A simulated sensor that takes sample k at `begin` plus k periods.

    The test reads the sensor's FIFO now and then.
    """

    def __init__(self, ppm: float, begin_ns: int = 7 * MS, drift_per_s: float = 0.0) -> None:
        self.clock = FifoClock(100.0, 0.03)
        self.period_ns = 10 * MS / (1 + ppm * 1e-6)
        self.begin_ns = begin_ns
        self.drift = drift_per_s
        self.now_ns = begin_ns
        self.taken = 0
        self.arrivals: list[tuple[int, int]] = []
        self._random = random.Random(1)

    def time_ns(self, k: int) -> float:
        t = k * self.period_ns
        return self.begin_ns + t + self.drift * t * t / 2 / S

    def count(self, at_ns: int) -> int:
        """Return the number of samples that the sensor has taken until `at_ns`."""
        n = int((at_ns - self.begin_ns) / self.period_ns) + 3
        while self.time_ns(n - 1) > at_ns:
            n -= 1
        return n

    def look(self, ms: float = 0.0) -> bool:
        """Read all samples that wait in the FIFO. Return whether their number agrees with the clock that is
        tested.
        """
        self.now_ns += round((ms or self._random.uniform(20, 30)) * MS)
        before_ns, after_ns = self.now_ns - 350_000, self.now_ns
        waiting = self.count(self.now_ns - 150_000) - self.taken
        in_step = not self.clock.out_of_step(waiting, before_ns, after_ns)
        if waiting:
            self.arrivals += self.clock.take(waiting, waiting, after_ns, timely=True)
            self.taken += waiting
        return in_step

    def run(self, seconds: float) -> "Sensor":
        end_ns = self.now_ns + seconds * S
        while self.now_ns < end_ns:
            assert self.look()
        return self

    def lose(self, seconds: float, poll_ms: float = 1.0) -> tuple[int, int, int]:
        """Stop reading for a while and empty the FIFO, so that samples are lost.

        Return the estimated number of missing samples, the largest error that this number may have, and the
        true number.
        """
        self.now_ns += round(seconds * S)
        empty_ns, had = self.now_ns, self.count(self.now_ns)
        while (waiting := self.count(self.now_ns) - had) == 0:
            empty_ns = self.now_ns
            self.now_ns += round(poll_ms * MS)
        missing, doubt = self.clock.resume(waiting, Span(empty_ns, empty_ns), self.now_ns)
        truth = had - self.taken
        self.taken = had
        self.clock.take(waiting, waiting, self.now_ns, timely=True)
        self.taken += waiting
        return missing, doubt, truth


PPM = st.floats(-10_000, 10_000)


@given(PPM, st.floats(12, 40), st.floats(0.01, 2))
@settings(max_examples=30)
def test_a_loss_is_counted_exactly_after_some_seconds(ppm: float, seconds: float, lost_s: float) -> None:
    missing, doubt, truth = Sensor(ppm).run(seconds).lose(lost_s)
    assert (missing, doubt) == (truth, 0)


@given(PPM, st.floats(0.05, 8), st.floats(0.01, 10))
@settings(max_examples=30)
def test_before_that_the_doubt_is_honest(ppm: float, seconds: float, lost_s: float) -> None:
    missing, doubt, truth = Sensor(ppm).run(seconds).lose(lost_s)
    assert abs(missing - truth) <= doubt


@given(PPM)
@settings(max_examples=30)
def test_no_sample_arrives_before_it_was_taken(ppm: float) -> None:
    sensor = Sensor(ppm).run(4)
    sensor.look(340)
    sensor.run(1)
    assert [number for number, _ in sensor.arrivals] == list(range(sensor.taken))
    delays_ms = [(at_ns - sensor.time_ns(k)) / MS for k, at_ns in sensor.arrivals]
    assert min(delays_ms) >= 0
    assert max(delays_ms) < 20, "what a sample had waited in the FIFO is taken off"


@pytest.mark.parametrize("slipped", [1, -1, 3, -30])
def test_samples_that_vanish_or_appear_are_noticed(slipped: int) -> None:
    sensor = Sensor(3000).run(20)
    sensor.taken += slipped
    seen = [sensor.look() for _ in range(40)]
    assert not all(seen)


def test_a_sensor_that_warms_up_stays_in_step() -> None:
    """The clock of a sensor that warms up changes by 500 ppm in five minutes.

    A straight line through all counts of these minutes would be wrong by whole samples.
    """
    sensor = Sensor(0, drift_per_s=500e-6 / 300).run(300)
    missing, doubt, truth = sensor.lose(2)
    assert (missing, doubt) == (truth, 0)


def test_after_a_set_up_the_numbers_go_on_by_time() -> None:
    sensor = Sensor(0).run(12)
    sensor.clock.forget()
    missing, doubt, truth = sensor.lose(1.5)
    assert doubt == 0
    assert abs(missing - truth) <= 1
    assert sensor.clock.next == sensor.taken


def test_a_late_count_teaches_nothing() -> None:
    """A count of samples that was read half a second late does not change the clock, even if it is the only
    count in its second.
    """
    sensor = Sensor(0).run(20)
    sensor.now_ns += S // 2
    waiting = sensor.count(sensor.now_ns - S // 2 + 10 * MS) - sensor.taken
    sensor.clock.take(waiting, waiting, sensor.now_ns, timely=False)
    sensor.taken += waiting
    assert sensor.run(5).lose(2)[1:] != (1, 0)
    missing, doubt, truth = sensor.lose(1)
    assert (missing, doubt) == (truth, 0)
