"""A simulated fleet that publishes to a broker: `python -m tools.fleet_load --sensors 200 --bad 3`.

It publishes the messages that the daemons of that many sensors would publish: `hello`, `status`, `fit` with
its curves, and `stats`. Each sensor has three axes, and one of two kinds of chip. The fits are real: the
daemon's own estimator fits some simulated noises of several kinds, and each axis has one of these fits,
scaled by a random factor (`fleet_fits`). Some sensors are bad: one of their figures is far from the other
sensors', and their names are printed. The program connects only to a broker on this machine, and ends by
itself. At the end it prints, as one line of JSON, how many messages the broker acknowledged.
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
"""Standard deviation of the logarithm of the sensors' noise: 0.08 means that noises differ by about 8 %."""
CHIPS = ("MPU-9250", "LSM6DSO")
SECOND = 5
"""One out of this number of sensors has the second kind of chip."""
SEQ = 123_456_789
"""Stands for each sample number (`seq`) in an encoded fit. A fit is encoded only once. Before each sending,
the true numbers replace this value.
"""
MOST_IN_FLIGHT = 5_000


class Bad(NamedTuple):
    """A bad sensor: number `place`. On one of its axes, `figure` (N, B or K) is multiplied by `times`."""

    place: int
    axis: str
    figure: str
    times: float


BAD = ((3, "gyro_y", "N", 2.5), (31, "gyro_x", "B", 5.0), (57, "gyro_z", "K", 4.0))


def bad_ones(sensors: int, count: int) -> list[Bad]:
    """Choose `count` sensors that are bad.

    The bad sensors are spread over the fleet, and have the kinds of fault in BAD, one after another.
    """
    found = []
    for number in range(count):
        place, axis, figure, times = BAD[number % len(BAD)]
        found.append(Bad((place + 61 * (number // len(BAD))) % sensors, axis, figure, times))
    return found


def _is_of_second_chip(place: int, bad: list[Bad]) -> bool:
    return place % SECOND == SECOND - 1 and all(one.place != place for one in bad)


class Sensor(NamedTuple):
    """The encoded messages of one sensor. `hello` is sent once, the other messages repeatedly."""

    device_id: str
    hello: bytes
    status: bytes
    fit: tuple[bytes, ...]
    stats: bytes


def sensor(place: int, bad: list[Bad]) -> Sensor:
    """Return the messages of sensor number `place`. The same number always gives the same messages."""
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
    """Return statistics of an axis with a random bias.

    As in real fleets, the biases of sensors differ by far more than the σ of each bias.
    """
    tracker = TrackerStats(
        model="white",
        nis=1.0,
        lag1=0.0,
        holds=True,
        moved=0,
        restarts=0,
        bias=float(rng.normal(0, 0.5)),
        bias_std=0.003,
    )
    return AxisStats(None, None, 0, {}, tracker=tracker)


class Publisher:
    """One MQTT connection for all sensors.

    `published` and `acknowledged` are the numbers of messages (QoS 1) that were published, and that the
    broker has acknowledged.
    """

    def __init__(self, host: str, port: int, prefix: str) -> None:
        self._prefix = prefix
        self.published = self.acknowledged = 0
        self._client = client = Client(CallbackAPIVersion.VERSION2, "", protocol=MQTTProtocolVersion.MQTTv5)
        client.max_inflight_messages_set(MOST_IN_FLIGHT)
        client.on_publish = self._on_publish
        client.connect(host, port)
        client.loop_start()

    def send(self, device_id: str, kind: str, payload: bytes, *, retain: bool = True) -> None:
        """Publish a message; wait while MOST_IN_FLIGHT messages are not acknowledged."""
        while self.published - self.acknowledged >= MOST_IN_FLIGHT:
            time.sleep(0.002)
        self._client.publish(f"{self._prefix}/{device_id}/{kind}", payload, qos=1, retain=retain)
        self.published += 1

    def close(self) -> None:
        """Wait for the last acknowledgements, at most 30 s, and disconnect."""
        end = time.monotonic() + 30
        while self.acknowledged < self.published and time.monotonic() < end:
            time.sleep(0.01)
        self._client.disconnect()
        self._client.loop_stop()

    def _on_publish(self, *_: object) -> None:
        self.acknowledged += 1


def due(count: int, every_s: float, rounds: int) -> Iterator[tuple[float, int, int]]:
    """Yield (time [s], sensor, number of the round) of each fit.

    The fits of a round are spread evenly over the period `every_s`.
    """
    for turn in range(rounds):
        for place in range(count):
            yield (turn + place / count) * every_s, place, turn


def main() -> int:
    """Run the command line and return the exit code."""
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
        parser.error("--host: only a broker on this machine, since such a load on another would be an attack")
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
