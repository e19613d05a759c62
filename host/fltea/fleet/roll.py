"""The list of all sensors: their newest messages, the times of arrival, and problems; its size is limited.

All times are those of `Clock.hearing`: seconds of a steady clock that stops while the broker is away.
"""

from collections import Counter, OrderedDict, deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import chain

from fltea.fleet.figures import Figure, bias_of, figures_of, order_of
from fltea.fleet.messages import AxisStats, Bad, Error, Fit, Hello, Message, Stats, Status, Tracker, read

MOST_SENSORS = 20_000
NAMES_KEPT = 5
ERRORS_KEPT = 5
FLOOD_PER_S, FLOOD_S = 50, 10.0
"""A sender floods if it sends more than FLOOD_PER_S messages per second over FLOOD_S [s].

A daemon sends 2 or 3 messages per second.
"""

TWINS, TWINS_S = 3, 600.0
"""The numbers of one program's fits rise. If the numbers under one name decrease `TWINS` times within
`TWINS_S` [s], two programs publish under this name.
"""

SILENT_S = 90.0
"""A sensor is silent if no message came for this time [s]; a daemon publishes its status every 30 s."""

CANDIDATE_S = 120.0
"""A name is a candidate until enough messages came under it; then it is a sensor. A candidate is dropped
after this time [s].
"""

WITHOUT_FIT_S = 3600.0
"""Silence after which a sensor that never sent a fit is dropped [s]."""


@dataclass(slots=True)
class Axis:
    """The newest fit of one axis.

    `figures`: noise parameters that are compared between sensors.
    `at`: time at which the fit arrived.
    `shown`: values that are only shown and not compared.
    """

    verdict: str
    text: str
    unit: str
    samples: int
    figures: dict[str, Figure]
    at: float
    shown: dict[str, Figure] = field(default_factory=dict)

    def figure(self, name: str) -> Figure | None:
        """Return the value of a quantity; None if it is not known."""
        return self.figures.get(name) or self.shown.get(name)


@dataclass(slots=True)
class MessageRate:
    """How many messages came from one sender. `flooding`: whether more than `FLOOD_PER_S` come per second."""

    messages: int = 0
    flooding: bool = False
    _window: tuple[float, int] = (0.0, 0)
    """Messages are counted in windows of FLOOD_S: when the newest one began [s], and its messages so far."""

    def count(self, now: float) -> None:
        """Count one more message."""
        self.messages += 1
        begin, count = self._window
        if now - begin >= FLOOD_S:
            self.flooding = count > FLOOD_PER_S * FLOOD_S
            self._window = now, 1
        else:
            self._window = begin, count + 1
            self.flooding = self.flooding or count + 1 > FLOOD_PER_S * FLOOD_S


@dataclass(slots=True)
class FitNumbers:
    """The numbers of the fits that came under the name of one device.

    A fit's number is a pair: the number of its epoch, and the number of its last sample in the epoch.
    `count`: how many fits came.
    """

    count: int = 0
    _newest: tuple[int, int] = (-1, -1)
    _decreases: deque[float] = field(default_factory=lambda: deque(maxlen=TWINS))
    """Times at which a fit came with a smaller number than the fit before it."""

    def is_newest(self, number: tuple[int, int]) -> bool:
        """Return whether the newest fit has this number."""
        return number == self._newest

    def take(self, number: tuple[int, int], now: float) -> None:
        """Count a new fit. `number`: numbers of its epoch and of its last sample. `now`: when it came [s]."""
        if number < self._newest:
            self._decreases.append(now)
        self._newest = number
        self.count += 1

    def begin_again(self) -> None:
        """Do not count the next fit as a decrease of the numbers, since the device has restarted."""
        self._newest = (-1, -1)

    def has_twin(self, now: float) -> bool:
        """Return whether two programs seem to publish under the name of this device."""
        return len(self._decreases) == TWINS and now - self._decreases[0] < TWINS_S


@dataclass(slots=True)
class Sensor:
    """One device. `first`, `heard`: times at which its first and its newest message arrived."""

    device_id: str
    first: float
    heard: float
    status: Status | None = None
    hello: Hello | None = None
    axes: dict[str, Axis] = field(default_factory=dict)
    delivered: int = 0
    lost: int = 0
    errors: deque[tuple[float, str, str]] = field(default_factory=lambda: deque(maxlen=ERRORS_KEPT))
    rate: MessageRate = field(default_factory=MessageRate)
    fits: FitNumbers = field(default_factory=FitNumbers)
    kinds: set[str] = field(default_factory=set)

    @property
    def kind(self) -> str:
        """Kind of sensor: chip and sampling rate. A sensor is compared with the others of the same kind."""
        if self.hello is None:
            return "?"
        return f"{(self.hello.sensor or '?')[:40]}, {self.hello.rate_hz:.4g} Hz"

    def state(self, now: float, silent_s: float = SILENT_S) -> str:
        """Return `online`, `stalled`, `offline`, `silent` (no message for `silent_s`) or `unknown`."""
        if self.status is not None and self.status.status == "offline":
            return "offline"
        if now - self.heard > silent_s:
            return "silent"
        if self.status is None:
            return "unknown"
        return self.status.status if self.status.status in ("online", "stalled") else "unknown"

    @property
    def is_known(self) -> bool:
        """Whether the device counts as a sensor.

        It counts as a sensor once it has sent two fits, or two kinds of messages including a HELLO or a fit.
        """
        return self.fits.count > 1 or (
            len(self.kinds) > 1 and (self.hello is not None or self.fits.count > 0)
        )

    def count(self, now: float) -> None:
        """Count one more message of the sensor."""
        self.heard = now
        self.rate.count(now)

    def take_fit(self, fit: Fit, now: float) -> bool:
        """Store the newest fit.

        Return False if it was stored already, since MQTT may deliver a message twice.
        """
        number = fit.epoch, fit.seq
        if self.fits.is_newest(number) and self.axes:
            return False
        self.fits.take(number, now)
        rate_hz = None if self.hello is None else self.hello.rate_hz
        before = self.axes
        self.axes = {
            name: Axis(
                axis_fit.verdict,
                axis_fit.text,
                axis_fit.unit,
                fit.samples,
                figures_of(axis_fit, rate_hz, before[name].figures if name in before else {}),
                now,
                order_of(axis_fit),
            )
            for name, axis_fit in fit.axes.items()
        }
        for name, axis in self.axes.items():
            if name in before and "bias" in before[name].shown:
                axis.shown["bias"] = before[name].shown["bias"]
        return True

    def take_stats(self, stats: Stats) -> None:
        """Store the counts of samples, and the bias of the axes that have a fit."""
        self.delivered, self.lost = stats.sample_counts.delivered, stats.sample_counts.lost
        for name, axis in self.axes.items():
            bias = bias_of(stats.axes.get(name, AxisStats()).tracker or Tracker())
            axis.shown.pop("bias", None)
            if bias is not None:
                axis.shown["bias"] = bias

    def take_hello(self, hello: Hello) -> None:
        """Store the HELLO message; after a new boot of the device, the numbers of fits may start again."""
        if self.hello is None or hello.boot_id != self.hello.boot_id:
            self.fits.begin_again()
        self.hello = hello


class Roll:
    """The list of all sensors from which messages came.

    A device is a candidate until two kinds of messages, or two fits, came under its name. Then it becomes a
    sensor. A candidate never replaces a sensor. There are at most `most` sensors and `most` candidates.

    `refused`: number of messages of candidates that were dropped; `refused_names`: some names of these
    candidates.
    `bad`: number of messages that no daemon sends, by the reason for their refusal.
    `fits`: number of new fits. `repeated`: number of fits that arrived a second time.
    """

    def __init__(self, prefix: str = "fltea", most: int = MOST_SENSORS) -> None:
        self.prefix, self.most = prefix, most
        self.sensors: dict[str, Sensor] = {}
        self.candidates: OrderedDict[str, Sensor] = OrderedDict()
        self.messages = self.bytes = self.refused = self.fits = self.repeated = 0
        self.refused_names: deque[str] = deque(maxlen=NAMES_KEPT)
        self.bad: Counter[str] = Counter()

    def take(self, topic: str, payload: bytes, now: float) -> Sensor | None:
        """Process one message; return its sensor, or None if it is not from a sensor."""
        self.messages += 1
        self.bytes += len(payload)
        try:
            message = read(topic, payload, self.prefix)
        except Bad as bad:
            self.bad[str(bad)] += 1
            return None
        name = message.device_id
        if message.content is None:
            return self.sensors.get(name)
        sensor = self.sensors.get(name) or self.candidates.get(name)
        if sensor is None:
            sensor = self.candidates[name] = Sensor(name, now, now)
            if len(self.candidates) > self.most:
                self._refuse(next(iter(self.candidates.values())))
        sensor.count(now)
        sensor.kinds.add(type(message.content).__name__)
        self._take(sensor, message, now)
        if name in self.candidates:
            return self._admit(sensor)
        return sensor

    def forget(self, now: float, keep_s: float) -> list[str]:
        """Drop sensors that have been silent for `keep_s` [s], and old candidates; return their names.

        If there is no room for new sensors, the sensors that have been silent longest are dropped too.
        """
        gone = [
            name
            for name, sensor in self.sensors.items()
            if sensor.heard < now - (keep_s if sensor.fits.count else min(keep_s, WITHOUT_FIT_S))
        ]
        if not gone and len(self.sensors) >= self.most:
            silent = [sensor for sensor in self.sensors.values() if sensor.heard < now - WITHOUT_FIT_S]
            silent.sort(key=lambda sensor: sensor.heard)
            gone = [sensor.device_id for sensor in silent[: 1 + self.most // 100]]
        for name in gone:
            del self.sensors[name]
        candidates = [one for one in self.candidates.values() if one.first < now - CANDIDATE_S]
        for candidate in candidates:
            self._refuse(candidate)
        return gone + [candidate.device_id for candidate in candidates]

    def axes(self) -> Iterator[tuple[Sensor, str, Axis]]:
        """Yield all axes of all sensors."""
        for sensor in self.sensors.values():
            for name, axis in sensor.axes.items():
                yield sensor, name, axis

    def everybody(self) -> Iterator[Sensor]:
        """Yield all sensors, and then all candidates (names that are not yet sensors)."""
        return chain(self.sensors.values(), self.candidates.values())

    def flooding(self) -> list[str]:
        """Return the names of sensors and candidates that send more messages than any daemon does."""
        return [sensor.device_id for sensor in self.everybody() if sensor.rate.flooding]

    def _admit(self, candidate: Sensor) -> Sensor | None:
        """Make a candidate a sensor if it has sent enough messages and there is room.

        Return the new sensor.
        """
        if not candidate.is_known:
            return None
        if len(self.sensors) >= self.most:
            self._refuse(candidate)
            return None
        self.sensors[candidate.device_id] = self.candidates.pop(candidate.device_id)
        return candidate

    def _refuse(self, candidate: Sensor) -> None:
        del self.candidates[candidate.device_id]
        self.refused += candidate.rate.messages
        if candidate.device_id not in self.refused_names:
            self.refused_names.append(candidate.device_id)

    def _take(self, sensor: Sensor, message: Message, now: float) -> None:
        match message.content:
            case Status():
                sensor.status = message.content
            case Hello():
                sensor.take_hello(message.content)
            case Fit():
                new = sensor.take_fit(message.content, now)
                self.fits += new
                self.repeated += not new
            case Stats():
                sensor.take_stats(message.content)
            case Error(kind, text):
                sensor.errors.append((now, kind, text))
