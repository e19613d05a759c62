"""Simulate a device by a list of acts. Each act is an incident, such as a gap or a reset, and the samples
that follow it.

The simulation yields the events that the source of the device's samples would yield.
"""

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import msgspec
import numpy as np
from fltea.records.events import Break, Event, LinkDown, RawSample, Tick, Trouble, block_of
from fltea.records.records import Hello
from fltea.records.stats import DeviceStatus
from hypothesis import strategies as st

from tests.rig.blocks import in_blocks
from tests.rig.device_stream_support import Source
from tests.rig.host_support import hello

SECOND_NS = 10**9


class Act(NamedTuple):
    """One incident, followed by samples.

    `amount`: size of the incident, from 0 to 1. `cuts`: sample indices at which the block of samples is
    split.
    """

    what: str = "goes on"
    amount: float = 0.0
    samples: int = 1
    cuts: tuple[int, ...] = ()


SAID = (
    "boot",
    "sensor",
    "other device",
    "link down",
    "link down, HELLO",
    "break",
    "date",
    "scale",
    "rate",
    "HELLO",
    "tick",
    "status",
    "trouble",
    "no accelerometer",
)
"""Incidents that end the current block of samples. Most of them produce an event of their own."""
ACTS = (
    *SAID,
    "goes on",
    "gap",
    # "longest gap" loses the most samples after which an epoch goes on (`link.max_gap` in
    # `device_stream_support.SMALL`), or one more.
    "longest gap",
    "odd gap",  # a gap in which the device's clock drifts, sometimes by more than the program accepts
    "long gap",  # a gap so long that the sequence number wraps at least once
    "twice",
    "reset",  # the board resets, and the HELLO of its new boot is lost
    "jump",  # device time jumps
    "late",  # all later samples arrive up to 100 s earlier or 400 s later
    "silence",  # nothing arrives for about half an hour
    "knock",
    "step",  # the bias steps
    "turn",  # the whole sensor begins to rotate, or stops if it rotates already
    "still",  # the sensor's counts never change, or hardly ever
)


class Birth(NamedTuple):
    """How the device starts.

    The fields are the number and the time of the first sample, the seed of the noise, and whether a HELLO
    precedes the samples.
    """

    sequence: int
    device_us: int
    seed: int = 0
    greets: bool = True


class Device:
    """A simulated device that yields the events of the source that would read it.

    `news`: fields in which the device's HELLO differs from the HELLO of `host_support`.
    """

    def __init__(self, source: Source, birth: Birth, **news: Any) -> None:
        self._source, self._greets, self._rng = source, birth.greets, np.random.default_rng(birth.seed)
        self._sequence, self._device_us, self._host_ns = (
            birth.sequence,
            birth.device_us,
            SECOND_NS + birth.seed,
        )
        self.hello = hello(**news)
        self._noise, self._accel = 8.0, True
        self._offset, self._turns = [3.0, -40.0, 0.0], 0.0
        # ratio of the true sampling period to the nominal period
        self._pace = 1.0001 if birth.seed % 2 else 0.9999

    def does(self, acts: Iterable[Act]) -> Iterator[Event]:
        """Play the acts (each is an incident and the samples after it), and yield the events.

        All samples up to the next incident of `SAID` form one block, unless the `cuts` of an act split it.
        """
        if self._greets:
            yield self._says()
        waiting: list[RawSample] = []
        cuts: list[int] = []
        for act in acts:
            if act.what in SAID and waiting:
                yield from in_blocks(block_of(waiting), cuts)
                waiting, cuts = [], []
            yield from self._happens(act)
            cuts += [len(waiting) + cut for cut in act.cuts]
            waiting += [self._sample() for _ in range(act.samples)]
            if act.what == "twice":
                waiting.append(waiting[-1]._replace(host_ns=waiting[-1].host_ns + 100))
        yield from in_blocks(block_of(waiting), cuts)

    def _says(self, **news: Any) -> Hello:
        self.hello = msgspec.structs.replace(self.hello, host_ns=self._host_ns, **news)
        return self.hello

    def _happens(self, act: Act) -> Iterator[Event]:
        """Let the incident of an act happen, and yield the events that the source produces.

        Depending on its kind, the incident loses samples, changes a clock or the motion of the sensor, or
        causes an event.
        """
        self._lose(act)
        self._change(act)
        yield from self._announced(act)

    def _lose(self, act: Act) -> None:
        """If the incident of the act is a gap, lose samples. `act.amount` determines how many."""
        amount = act.amount
        match act.what:
            case "gap":
                self._pass(round(1 + 120 * amount))
            case "longest gap":
                self._pass(round(60 + amount))
            case "odd gap":
                self._pass(40)
                self._device_us += round(3.2 * amount * 1e6 / self.hello.rate_hz)
            case "long gap":
                self._pass(round(60_000 + 140_000 * amount))
            case "silence":
                self._pass(round(179_990 + 20 * amount))

    def _change(self, act: Act) -> None:
        """Change the clocks or the motion of the sensor. Only later samples show this change."""
        amount = act.amount
        match act.what:
            case "date":
                self._source.unix_offset_ns += round(7200 * SECOND_NS * (amount - 0.5))
            case "jump":
                self._device_us += round(40_000 * (amount - 0.5)) if amount < 0.8 else 2**31
            case "late":
                self._host_ns += round(500 * SECOND_NS * (amount - 0.2))
            case "no accelerometer":
                self._accel = not self._accel
            case "knock":
                self._noise = 8.0 if self._noise != 8.0 else 2000 * amount
            case "step":
                self._offset[round(2 * amount)] += 40 * (amount - 0.5)
            case "turn":
                self._turns = 0.0 if self._turns else 1.0 + amount
            case "still":
                self._noise = 8.0 if self._noise < 1 else 0.25 * (amount > 0.5)

    def _announced(self, act: Act) -> Iterator[Event]:
        """If the incident of the act is one that a source may report, such as a new boot, let it happen.
        Yield the source's event, if there is one.
        """
        known, amount = self.hello, act.amount
        match act.what:
            case "boot" | "reset":
                self._sequence, self._device_us = round(3 * amount), round(1e4 * amount)
                if act.what == "boot":
                    yield self._says(boot_id=(known.boot_id or 0) + 1)
                else:
                    self.hello = msgspec.structs.replace(known, boot_id=(known.boot_id or 0) + 1)
            case "sensor":
                self._pass(round(50 * amount))
                yield self._says(sensor_starts=(known.sensor_starts or 0) + 1)
            case "other device":
                yield self._says(device_id=f"b{round(9 * amount)}")
            case "link down" | "link down, HELLO":
                yield LinkDown(self._host_ns)
                self._pass(round(100 * amount))
                if act.what == "link down, HELLO":
                    yield self._says()
            case "break":
                yield Break("gap" if amount > 0.5 else "discontinuity", self._host_ns)
            case "scale":
                lsb, per_g = (
                    (None, None) if amount > 0.9 else (131.0 * amount + 1, 0.0 if amount < 0.1 else 2048.0)
                )
                yield self._says(gyro_lsb_per_dps=lsb, accel_lsb_per_g=per_g)
            case "rate":
                yield self._says(rate_hz=round(25 + 175 * amount, 1))
            case "HELLO":
                yield self._says()
            case "tick":
                self._host_ns += round(3 * SECOND_NS * amount)
                yield Tick(self._host_ns)
            case "status":
                yield DeviceStatus(round(9 * amount), 0, 0, 0, 0, "watchdog")
            case "trouble":
                yield Trouble("device_fault", f"{amount}", self._host_ns, fatal=False)

    def _pass(self, samples: int) -> None:
        """Let time pass without any sample being sent."""
        period_us = 1e6 / self.hello.rate_hz
        self._sequence += samples
        self._device_us += round(samples * period_us * self._pace)
        self._host_ns += round(samples * period_us * 1000)

    def _sample(self) -> RawSample:
        self._pass(1)
        rate = np.add(self._offset, 800 * self._turns)
        gyro = tuple(np.rint(rate + self._noise * self._rng.standard_normal(3)).tolist())
        late_ns = int(self._rng.exponential(2e6))
        place = self._sequence % 2**16, self._device_us % 2**32, self._host_ns + late_ns
        tilted = [3000 * self._turns, 0, 16384]
        accel = tuple(np.rint(tilted + 20 * self._rng.standard_normal(3)).tolist())
        return RawSample(*place, gyro, accel if self._accel else None, 300.0, int(late_ns % 4))


def acts(most: int, samples: int) -> st.SearchStrategy[list[Act]]:
    one = st.builds(
        Act,
        st.sampled_from(ACTS),
        st.floats(0, 1),
        st.integers(1, samples),
        st.lists(st.integers(0, samples), max_size=4).map(tuple),
    )
    return st.lists(one, min_size=most // 4, max_size=most)


births = st.builds(
    Birth,
    st.integers(0, 65535) | st.integers(65_400, 65535),
    st.integers(0, 2**32 - 1) | st.integers(2**32 - 2 * 10**6, 2**32 - 1),
    st.integers(0, 999),
    st.sampled_from([True, True, True, False]),
)
