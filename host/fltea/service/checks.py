"""What `fltea run` refuses before it opens anything. `fltea doctor` calls the same function."""

from collections.abc import Sequence

from fltea.estimator.lane_settings import LaneSettings
from fltea.records.errors import UsageError
from fltea.settings.config import Config
from fltea.settings.sources import is_shared
from fltea.sources.open_source import check_shared
from fltea.sources.same_port import check_apart


def check_settings(configs: Sequence[Config]) -> None:
    """Check settings that are valid one by one, but cannot be used together.

    Raises:
        UsageError: no filter can start with the settings of a sensor, an output does not work with a source,
            or two sources read from the same port.
    """
    for config in configs:
        _check_filters(config)
    check_apart(configs)
    check_shared([config for config in configs if is_shared(config.source)])


def _check_filters(config: Config) -> None:
    for name in ("estimator", "accel"):
        try:
            LaneSettings(getattr(config, name), h=1.0, R=1.0).table(1)
        except ValueError as error:
            raise UsageError(f"{name}.{error}.") from error
