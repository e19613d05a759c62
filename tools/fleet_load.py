"""A made-up fleet on a broker: `python -m tools.fleet_load --sensors 200 --bad 3`.

It publishes what as many daemons would: `hello`, `status`, `fit` with its curves and `stats` of sensors with
three axes, of two chips. The fits are real: the daemon's own estimator makes some of simulated noise of
several kinds, and each axis has one of these times a factor of its own (`fleet_fits`). So verdicts, curves
and intervals are such as a daemon sends. Some sensors are bad: one figure of theirs is far from the others',
and it prints whose. It speaks to this machine only, and ends by itself; then it prints how many messages the
broker has acknowledged, as one line of JSON.
"""

import argparse
import json
import sys
import time
from collections.abc import Iterator
from typing import NamedTuple

import msgspec
import numpy as np
from fltea.records.records import AXES, Fit, Hello, Stats
from fltea.records.stats import AxisStats, LinkStats, SampleStats, TrackerStats
from fltea.settings.outputs import is_loopback
from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion

from tools.fleet_fits import RATE_HZ, Changed, axis_fit

SPREAD = 0.08
"""By how much sensors of a kind differ, as a ratio less one."""
CHIPS = ("MPU-9250", "LSM6DSO")
SECOND = 5
"""One sensor in so many is of the second chip."""
SEQ = 123_456_789
"""Stands for the number of the sample, and of all samples, in a fit that is made once and sent often."""
MOST_IN_FLIGHT = 5_000


class Bad(NamedTuple):
    """Sensor `place` has `times` as much of a figure on one axis."""

    place: int
    axis: str
    figure: str
    times: float


BAD = ((3, "gyro_y", "N", 2.5), (31, "gyro_x", "B", 5.0), (57, "gyro_z", "K", 4.0))


def bad_ones(sensors: int, count: int) -> list[Bad]:
    """Which sensors are bad: spread over the fleet, each in another way."""
    found = []
    for number in range(count):
        place, axis, figure, times = BAD[number % len(BAD)]
        found.append(Bad((place + 61 * (number // len(BAD))) % sensors, axis, figure, times))
    return found


def _is_of_second_chip(place: int, bad: list[Bad]) -> bool:
    return place % SECOND == SECOND - 1 and all(one.place != place for one in bad)


class Sensor(NamedTuple):
    """What one sensor publishes: retained once, and again and again."""

    device_id: str
    hello: bytes
    status: bytes
    fit: tuple[bytes, ...]
    stats: bytes


def sensor(place: int, bad: list[Bad]) -> Sensor:
    """One sensor; the same for the same number."""
    rng = np.random.default_rng((18, place))
    encode, device_id = msgspec.json.encode, f"{place:032x}"
    axes, second = {}, _is_of_second_chip(place, bad)
    for axis in AXES:
        factor = float(np.exp(rng.normal(0, SPREAD)))
        changed = [Changed(one.figure, one.times) for one in bad if (one.place, one.axis) == (place, axis)]
        axes[axis] = axis_fit(rng, factor, second=second, changed=changed[0] if changed else None)
    fit = encode(Fit(seq=SEQ, epoch=1, device_us=0, host_ns=0, samples=SEQ, axes=axes, device="load"))
    parts = tuple(fit.split(str(SEQ).encode()))
    hello = Hello(
        source="load", host_ns=0, rate_hz=RATE_HZ, sampling_mode="fifo", device_id=device_id, boot_id=1,
        sensor=CHIPS[second], gyro_range_dps=2000.0, gyro_lsb_per_dps=16.4, device="load",
    )  # fmt: skip
    status = {"status": "online", "since_ns": 0, "source": "load", "device_id": device_id, "device": "load"}
    stats = Stats(
        epoch=1, host_ns=0, rate_hz=RATE_HZ, clock_ppm=0.0, startup_remaining=0, link=LinkStats(),
        sample_counts=SampleStats(360_000, 0, 0, 0, 0), axes={axis: _axis_stats(rng) for axis in AXES},
        board=None, device="load",
    )  # fmt: skip
    return Sensor(device_id, encode(hello), encode(status), parts, encode(stats))


def _axis_stats(rng: np.random.Generator) -> AxisStats:
    """Offsets differ from sensor to sensor, by far more than they are known to."""
    tracker = TrackerStats("white", 1.0, 0.0, True, 0, 0, bias=float(rng.normal(0, 0.5)), bias_std=0.003)
    return AxisStats(None, None, 0, {}, tracker=tracker)


class Publisher:
    """One connection for all. published, acknowledged: messages of QoS 1."""

    def __init__(self, host: str, port: int, prefix: str) -> None:
        self._prefix = prefix
        self.published = self.acknowledged = 0
        self._client = client = Client(CallbackAPIVersion.VERSION2, "", protocol=MQTTProtocolVersion.MQTTv5)
        client.max_inflight_messages_set(MOST_IN_FLIGHT)
        client.on_publish = self._on_publish
        client.connect(host, port)
        client.loop_start()

    def send(self, device_id: str, kind: str, payload: bytes, *, retain: bool = True) -> None:
        """Publish; waits while too many are under way."""
        while self.published - self.acknowledged >= MOST_IN_FLIGHT:
            time.sleep(0.002)
        self._client.publish(f"{self._prefix}/{device_id}/{kind}", payload, qos=1, retain=retain)
        self.published += 1

    def close(self) -> None:
        """Wait for the last acknowledgements."""
        end = time.monotonic() + 30
        while self.acknowledged < self.published and time.monotonic() < end:
            time.sleep(0.01)
        self._client.disconnect()
        self._client.loop_stop()

    def _on_publish(self, *_: object) -> None:
        self.acknowledged += 1


def due(count: int, every_s: float, rounds: int) -> Iterator[tuple[float, int, int]]:
    """When which sensor publishes its fit number `turn`: spread evenly over the period."""
    for turn in range(rounds):
        for place in range(count):
            yield (turn + place / count) * every_s, place, turn


def main() -> int:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--host", default="127.0.0.1", help="the broker, on this machine")
    parser.add_argument("--port", type=int, default=1883)
    parser.add_argument("--prefix", default="fltea")
    parser.add_argument("--sensors", type=int, default=200)
    parser.add_argument("--bad", type=int, default=3)
    parser.add_argument("--every", type=float, default=10.0, help="seconds from fit to fit of a sensor")
    parser.add_argument("--rounds", type=int, default=60, help="fits of each sensor")
    given = parser.parse_args()
    if not is_loopback(given.host):
        parser.error("--host: only this machine; it would be an attack on anybody else's broker")
    if not (1 <= given.sensors <= 100_000 and 0 <= given.bad <= given.sensors and given.every >= 0):
        parser.error("1 to 100,000 sensors, no more bad ones than there are, and no negative time")
    bad = bad_ones(given.sensors, given.bad)
    fleet = [sensor(place, bad) for place in range(given.sensors)]
    for odd in bad:
        name = fleet[odd.place].device_id
        print(f"bad: {name} {odd.axis}: {odd.times:g} times the usual {odd.figure}", file=sys.stderr)
    publisher = Publisher(given.host, given.port, given.prefix)
    begin = time.monotonic()
    for one in fleet:
        publisher.send(one.device_id, "hello", one.hello)
        publisher.send(one.device_id, "status", one.status)
    late_s, fits, first = 0.0, 0, time.monotonic()
    for at_s, place, turn in due(given.sensors, given.every, given.rounds):
        wait_s = first + at_s - time.monotonic()
        if wait_s > 0:
            time.sleep(wait_s)
        late_s = max(late_s, -wait_s)
        one = fleet[place]
        publisher.send(one.device_id, "fit", str(360_000 + turn).encode().join(one.fit))
        publisher.send(one.device_id, "stats", one.stats, retain=False)
        if turn % 3 == 2:
            publisher.send(one.device_id, "status", one.status)
        fits += 1
    publisher.close()
    done = {"sensors": given.sensors, "fits": fits, "published": publisher.published}
    done |= {"acknowledged": publisher.acknowledged, "late_s": round(late_s, 3)}
    print(json.dumps(done | {"seconds": round(time.monotonic() - begin, 1)}))
    return 0 if publisher.acknowledged == publisher.published else 1


if __name__ == "__main__":
    sys.exit(main())
