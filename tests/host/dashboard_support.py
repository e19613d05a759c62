"""Records as a running pipeline gives them, for the tests of the page."""

from collections.abc import Iterable

from fltea.config import Config, EstimatorConfig
from fltea.dashboard.history import DeviceHistory
from fltea.model import AnyRecord, Break, Event, LinkStats, RawSample
from fltea.pipeline import Pipeline
from fltea.sources.synthetic import SyntheticSource
from host_support import hello

QUICK = EstimatorConfig(startup=50, window=200)


class Events:
    """A source of given events."""

    live = prompt = False
    unix_offset_ns = 0

    def __init__(self, events: Iterable[Event]) -> None:
        self._events = events

    def events(self) -> Iterable[Event]:
        return iter(self._events)

    def link_stats(self) -> LinkStats:
        return LinkStats()

    def close(self) -> None:
        pass


def records(query: str, config: EstimatorConfig = QUICK) -> list[AnyRecord]:
    """What the pipeline makes of synthetic noise."""
    key = (query, repr(config))
    if key not in _made:
        _made[key] = _records(query, config)
    return list(_made[key])


_made: dict[tuple[str, str], list[AnyRecord]] = {}


def _records(query: str, config: EstimatorConfig) -> list[AnyRecord]:
    source = SyntheticSource(query, realtime=False)
    pipeline = Pipeline(source, Config(name="due", estimator=config))
    found = [record for event in source.events() for record in pipeline.feed(event)]
    return [*found, pipeline.stats()]


def with_breaks(
    lengths: list[int], reason: str = "restart", config: EstimatorConfig = QUICK, accel: bool = False
) -> list[AnyRecord]:
    """Stretches of samples, each an epoch of its own; the noise is a counter's last bits, with an offset."""
    events: list[Event] = [hello()]
    k = 0
    for length in lengths:
        for _ in range(length):
            raw = tuple(20 + (k * factor) % 7 for factor in (3, 5, 8))
            force = (16384 + k % 5, k % 3, -k % 4) if accel else None
            events.append(RawSample(k % 65536, k * 10_000 % 2**32, k * 10_000_000, raw, force, 0.0))
            k += 1
        events.append(Break(reason, k * 10_000_000))  # type: ignore[arg-type]
    channels = ["gyro_x", "accel_x", "accel_y"] if accel else None
    pipeline = Pipeline(Events(events), Config(name="due", estimator=config, channels=channels))  # type: ignore[arg-type]
    found = [record for event in events for record in pipeline.feed(event)]
    return [*found, pipeline.stats()]


def told(*groups: list[AnyRecord], config: EstimatorConfig = QUICK) -> DeviceHistory:
    """A history that has heard them all."""
    history = DeviceHistory("due", config)
    for group in groups:
        for record in group:
            history.write(record)
    return history
