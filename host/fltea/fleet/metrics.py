"""The fleet for Prometheus: counts only, so that the number of series does not grow with the fleet."""

from collections.abc import Iterator
from typing import Any

from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric

from fltea.fleet.program import Fleet


class _Collector:
    def __init__(self, fleet: Fleet) -> None:
        self._fleet = fleet

    def collect(self) -> Iterator[Metric]:
        """All families, from one summary."""
        found = self._fleet.summary()
        for name, text, label, values in (
            ("fltea_fleet_sensors", "sensors by state", "state", found["states"]),
            ("fltea_fleet_axes", "axes by the verdict of their newest fit", "verdict", found["axes"]),
            ("fltea_fleet_alerts", "alerts that are raised", "kind", found["alerts_by_kind"]),
        ):
            gauge = GaugeMetricFamily(name, text, labels=[label])
            for value, count in values.items():
                gauge.add_metric([value], count)
            yield gauge
        yield GaugeMetricFamily("fltea_fleet_odd_figures", "figures unlike the others'", found["odd_count"])
        yield GaugeMetricFamily("fltea_fleet_connected", "1: the broker is there", float(found["connected"]))
        yield from _counters(found)


def _counters(found: dict[str, Any]) -> Iterator[Metric]:
    yield CounterMetricFamily("fltea_fleet_messages", "messages that came", found["messages"])
    yield CounterMetricFamily("fltea_fleet_bytes", "bytes of their payloads", found["bytes"])
    yield CounterMetricFamily("fltea_fleet_fits", "fits that came", found["fits"])
    yield CounterMetricFamily(
        "fltea_fleet_refused", "messages of names that are no sensors", found["refused"]
    )
    yield CounterMetricFamily("fltea_fleet_outages", "connections to the broker lost", found["outages"])
    dropped = found["alerts_dropped"]
    yield CounterMetricFamily("fltea_fleet_alerts_dropped", "alerts that were one too many", dropped)
    lost = found["history"]["lost"]
    yield CounterMetricFamily("fltea_fleet_history_lost", "rows of history that could not be written", lost)
    bad = CounterMetricFamily("fltea_fleet_bad_messages", "messages that no daemon sends", labels=["reason"])
    for reason, count in found["bad_messages"].items():
        bad.add_metric([reason], count)
    yield bad


def text_of(fleet: Fleet) -> bytes:
    """Return what /metrics answers."""
    registry = CollectorRegistry(auto_describe=False)
    registry.register(_Collector(fleet))
    return bytes(generate_latest(registry))
