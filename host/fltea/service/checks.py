"""What `fltea run` refuses before it opens anything. `fltea doctor` calls the same function."""

from collections.abc import Sequence

from fltea.estimator.lane_settings import LaneSettings
from fltea.records.errors import UsageError
from fltea.settings.config import Config
from fltea.settings.ingest import broker_at, is_partitioned, nats_servers
from fltea.settings.sources import is_shared
from fltea.sources.open_source import check_shared
from fltea.sources.same_port import check_apart


def check_settings(configs: Sequence[Config]) -> None:
    """Check settings that are valid one by one, but cannot be used together.

    Raises:
        UsageError: no filter can start with the settings of a sensor, an output does not work with a source,
            or two sources read from the same port or broker.
    """
    for config in configs:
        _check_filters(config)
    check_apart(configs)
    shared = [config for config in configs if is_shared(config.source)]
    check_shared(shared)
    if len(shared) > 1:
        _check_brokers(shared)


def _check_brokers(shared: Sequence[Config]) -> None:
    """Refuse two sources at the same broker, since everything would come twice."""
    found: set[tuple[str, int]] = set()
    for config in shared:
        source = config.source or ""
        if is_partitioned(source):
            places = {(server.host, server.port) for server in nats_servers(source)}
        else:
            address = broker_at(source, config.mqtt).address()
            places = {(address.host, address.port)}
        places = {("localhost" if host in ("127.0.0.1", "::1") else host, port) for host, port in places}
        if same := min(found & places, default=None):
            host, port = same
            raise UsageError(
                f"--source: two sources name the broker at {host}, port {port}, so everything would come "
                "twice. Name it once."
            )
        found |= places


def _check_filters(config: Config) -> None:
    for name in ("estimator", "accel"):
        try:
            LaneSettings(getattr(config, name), h=1.0, R=1.0).table(1)
        except ValueError as error:
            raise UsageError(f"{name}.{error}.") from error
