"""The roll of all sensors: what each said last, when, and what is wrong with it. Bounded."""

from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass, field

from fltea.fleet.figures import Figure, figures_of
from fltea.fleet.messages import Bad, Error, Fit, Hello, Message, Stats, Status, read

MOST_SENSORS = 20_000
NAMES_KEPT = 5
ERRORS_KEPT = 5
FLOOD_PER_S, FLOOD_S = 50, 10.0
"""More messages a second than this, over so long, are no daemon's: it sends two or three."""

TWINS, TWINS_S = 3, 600.0
"""So often within so long fits run back before two programs under one name are told."""

SILENT_S = 90.0
"""A daemon says its status every 30 s."""


@dataclass(slots=True)
class Axis:
    """The newest fit of one axis. at: when it came, on the fleet's clock in s."""

    verdict: str
    text: str
    unit: str
    samples: int
    figures: dict[str, Figure]
    at: float


@dataclass(slots=True)
class Sensor:
    """One device. heard: when anything of it came, on the fleet's clock; first: the first time."""

    device_id: str
    first: float
    heard: float
    status: Status | None = None
    hello: Hello | None = None
    axes: dict[str, Axis] = field(default_factory=dict)
    delivered: int = 0
    lost: int = 0
    messages: int = 0
    errors: deque[tuple[float, str, str]] = field(default_factory=lambda: deque(maxlen=ERRORS_KEPT))
    flooding: bool = False
    twins: deque[float] = field(default_factory=lambda: deque(maxlen=TWINS))
    _seq: tuple[int, int] = (-1, -1)
    _window: tuple[float, int] = (0.0, 0)

    @property
    def kind(self) -> str:
        """With which others it is compared: the same chip at the same rate."""
        if self.hello is None:
            return "?"
        return f"{(self.hello.sensor or '?')[:40]}, {self.hello.rate_hz:.4g} Hz"

    def state(self, now: float, silent_s: float = SILENT_S) -> str:
        """`online`, `stalled`, `offline`, `silent` (nothing was heard for long) or `unknown`."""
        if self.status is not None and self.status.status == "offline":
            return "offline"
        if now - self.heard > silent_s:
            return "silent"
        if self.status is None:
            return "unknown"
        return self.status.status if self.status.status in ("online", "stalled") else "unknown"

    def has_twin(self, now: float) -> bool:
        """Whether two programs seem to publish under its name."""
        return len(self.twins) == TWINS and now - self.twins[0] < TWINS_S

    def count(self, now: float) -> None:
        """One more message of it."""
        self.heard = now
        self.messages += 1
        begin, count = self._window
        if now - begin >= FLOOD_S:
            self.flooding = count > FLOOD_PER_S * FLOOD_S
            self._window = now, 1
        else:
            self._window = begin, count + 1
            self.flooding = self.flooding or count + 1 > FLOOD_PER_S * FLOOD_S

    def take_fit(self, fit: Fit, now: float) -> bool:
        """Its newest fit; False if it is the one that was there, which MQTT may bring twice."""
        place = fit.epoch, fit.seq
        if place == self._seq and self.axes:
            return False
        if place < self._seq:
            self.twins.append(now)
        self._seq = place
        rate_hz = None if self.hello is None else self.hello.rate_hz
        self.axes = {
            name: Axis(
                one.verdict,
                one.text,
                one.unit,
                fit.samples,
                figures_of(one, rate_hz, self.axes[name].figures if name in self.axes else {}),
                now,
            )
            for name, one in fit.axes.items()
        }
        return True

    def take_hello(self, hello: Hello) -> None:
        """A program that begins may count from the beginning."""
        if self.hello is None or hello.boot_id != self.hello.boot_id:
            self._seq = (-1, -1)
        self.hello = hello


class Roll:
    """All sensors that were heard of.

    most: so many at most; refused counts messages of further ones, and `refused_names` are some of them.
    bad: messages that no daemon sends, by reason. fits: that were new; repeated: that came twice.
    """

    def __init__(self, prefix: str = "fltea", most: int = MOST_SENSORS) -> None:
        self.prefix, self.most = prefix, most
        self.sensors: dict[str, Sensor] = {}
        self.messages = self.bytes = self.refused = self.fits = self.repeated = 0
        self.refused_names: deque[str] = deque(maxlen=NAMES_KEPT)
        self.bad: Counter[str] = Counter()

    def take(self, topic: str, payload: bytes, now: float) -> Sensor | None:
        """Take one message; whose it was, or None if it was nobody's."""
        self.messages += 1
        self.bytes += len(payload)
        try:
            message = read(topic, payload, self.prefix)
        except Bad as bad:
            self.bad[str(bad)] += 1
            return None
        sensor = self.sensors.get(message.device_id)
        if message.content is None:
            return sensor
        if sensor is None:
            if len(self.sensors) >= self.most:
                self.refused += 1
                if message.device_id not in self.refused_names:
                    self.refused_names.append(message.device_id)
                return None
            sensor = self.sensors[message.device_id] = Sensor(message.device_id, now, now)
        sensor.count(now)
        self._take(sensor, message, now)
        return sensor

    def forget(self, before: float) -> list[str]:
        """Drop sensors that have been offline or silent since then; their names."""
        gone = [name for name, sensor in self.sensors.items() if sensor.heard < before]
        for name in gone:
            del self.sensors[name]
        return gone

    def axes(self) -> Iterator[tuple[Sensor, str, Axis]]:
        """All axes of all sensors."""
        for sensor in self.sensors.values():
            for name, axis in sensor.axes.items():
                yield sensor, name, axis

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
            case Stats(samples):
                sensor.delivered, sensor.lost = samples.delivered, samples.lost
            case Error(kind, text):
                sensor.errors.append((now, kind[:40], text[:500]))
