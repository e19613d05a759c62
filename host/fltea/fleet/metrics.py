"""The fleet's metrics for Prometheus."""

from collections.abc import Iterator
from types import SimpleNamespace

from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import Metric

from fltea.fleet.program import Fleet
from fltea.sinks.metrics.tables import counter, families, gauge

METRICS = (
    gauge("sensors", "sensors by state", "states", key="state"),
    gauge("axes", "axes by the verdict of their newest fit", key="verdict"),
    gauge("alerts", "alerts that are raised", "alerts_by_kind", key="kind"),
    gauge("odd_figures", "figures unlike the others'", "odd_count"),
    gauge("connected", "1: the broker is there"),
    counter("messages", "messages that came"),
    counter("bytes", "bytes of their payloads"),
    counter("fits", "fits that came"),
    counter("refused", "messages of names that are no sensors"),
    counter("outages", "connections to the broker lost"),
    counter("alerts_dropped", "alerts dropped since there were too many"),
    counter("history_lost", "rows of history that could not be written", lambda found: found.history["lost"]),
    counter("bad_messages", "messages that fltea does not send", key="reason"),
)
"""Metrics that are computed from a summary.

All are counts over the whole fleet, so a larger fleet does not need more time series.
"""


class _Collector:
    def __init__(self, fleet: Fleet) -> None:
        self._fleet = fleet

    def collect(self) -> Iterator[Metric]:
        """Yield all metric families; all are computed from the same summary."""
        yield from families("fleet_", (), METRICS, [((), SimpleNamespace(**self._fleet.summary()))])


def metrics_text(fleet: Fleet) -> bytes:
    """Return the answer to a request for /metrics."""
    registry = CollectorRegistry(auto_describe=False)
    registry.register(_Collector(fleet))
    return bytes(generate_latest(registry))
