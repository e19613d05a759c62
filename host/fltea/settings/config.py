"""Configuration: defaults, then a TOML file, then flags; every mistake is named with its path."""

import math
import re
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

import msgspec

from fltea.records.errors import UsageError
from fltea.records.records import ACCEL_AXES, AXES
from fltea.settings import duration, filters
from fltea.settings.device_name import NAME, device_name, device_names
from fltea.settings.duration import Duration
from fltea.settings.estimator import AccelConfig, EstimatorConfig
from fltea.settings.how import How, TimeUnit
from fltea.settings.ingest import IngestConfig
from fltea.settings.limits import DEFAULT_LIMITS, Limits
from fltea.settings.live import LiveConfig
from fltea.settings.outputs import (
    DashboardConfig,
    MetricsConfig,
    MqttConfig,
    OutputConfig,
    RecordConfig,
    StateConfig,
)
from fltea.wire import layout as wire

MOST_MB = 1e9
"""A thousand TB; beyond it a limit is none."""


class LinkConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Serial link.

    baud: speed of a serial port. max_gap: longest gap that is bridged, in samples or as a time ("1 s"); a
    longer one begins a new epoch.
    """

    baud: int = wire.BAUD
    max_gap: Duration = filters.MAX_GAP

    def __post_init__(self) -> None:
        duration.check("max_gap", self.max_gap, 0)


class ReplayConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How to read a recording.

    columns: of a text, those of the axes x, y, z. units: of a text; deg/s, °/s, dps, mdps, rad/s or lsb:N.
    rate_hz: samples per second, where the recording does not say. time_column: of a text, that of the times.
    time_unit: what these are counted in. topic: of a bag, the Imu topic. shuffle: seed of a random order of
    the samples; None: their own order. max_chunk_mb, max_mb: how much memory one may take
    (`fltea.settings.limits`).
    """

    columns: list[str] | None = None
    units: str | None = None
    rate_hz: float | None = None
    time_column: str | None = None
    time_unit: TimeUnit | None = None
    topic: str | None = None
    shuffle: int | None = None
    max_chunk_mb: float = DEFAULT_LIMITS.max_chunk_mb
    max_mb: float = DEFAULT_LIMITS.max_mb

    @property
    def limits(self) -> Limits:
        """How much memory a recording may take."""
        return Limits(self.max_chunk_mb, self.max_mb)

    @property
    def how(self) -> How:
        """What is said of the recording."""
        return How(
            columns=self.columns,
            units=self.units,
            rate_hz=self.rate_hz,
            time_column=self.time_column,
            time_unit=self.time_unit,
            topic=self.topic,
        )

    def __post_init__(self) -> None:
        for name in ("max_chunk_mb", "max_mb"):
            if not 0 < getattr(self, name) <= MOST_MB:
                raise ValueError(f"{name} must be a positive number of MB, of at most {MOST_MB:g}")
        if self.rate_hz is not None and not (math.isfinite(self.rate_hz) and self.rate_hz > 0):
            raise ValueError("rate_hz must be a positive number of samples per second")
        if self.shuffle is not None and self.shuffle < 0:
            raise ValueError("shuffle is a seed and must be 0 or more")


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All that `fltea run` can be told; the tables of its TOML file have the same names.

    source: where samples come from, as --source says it. name: of the device, in all outputs; None: made from
    its address. channels: axes to estimate; None for all of the gyroscope's. format: of the standard output.
    pace: of a recording and of made-up noise. once: end with the recording, and fail where a device is
    missing. samples: write the samples too. device: what is said of each device by its name, in
    tables `[device.NAME]`; it wins over what is said of all.
    """

    source: str | None = None
    name: str | None = None
    channels: list[str] | None = None
    format: Literal["auto", "ndjson", "table", "none"] = "auto"
    pace: Literal["auto", "real", "fast"] = "auto"
    once: bool = False
    samples: bool = False
    link: LinkConfig = LinkConfig()
    ingest: IngestConfig = IngestConfig()
    replay: ReplayConfig = ReplayConfig()
    estimator: EstimatorConfig = EstimatorConfig()
    accel: AccelConfig = AccelConfig()
    live: LiveConfig = LiveConfig()
    output: OutputConfig = OutputConfig()
    record: RecordConfig = RecordConfig()
    mqtt: MqttConfig = MqttConfig()
    dashboard: DashboardConfig = DashboardConfig()
    metrics: MetricsConfig = MetricsConfig()
    state: StateConfig = StateConfig()
    device: dict[str, dict[str, Any]] = {}

    def __post_init__(self) -> None:
        known = AXES + ACCEL_AXES
        for channel in self.channels or ():
            if channel not in known:
                raise ValueError(f"channels: there is no {channel}; there are {', '.join(known)}")
        if self.channels is not None and len(set(self.channels)) != len(self.channels or "x"):
            raise ValueError("channels must name at least one axis, and each once")
        if self.name is not None and not NAME.fullmatch(self.name):
            raise ValueError(f"name {self.name!r}: letters, digits, '_', '.' and '-' make a device's name")


OF_A_DEVICE = ("source", "channels", "pace", "link", "replay", "estimator", "accel")
"""What a table [device.NAME] may say; the rest is said once for the whole program."""


def load_config(file: Path | None, overrides: Mapping[str, Any]) -> Config:
    """The configuration of the one device that there is; see `load_configs`."""
    (config,) = load_configs(file, overrides)
    return config


def load_configs(
    file: Path | None, overrides: Mapping[str, Any], sources: Iterable[str] = ()
) -> list[Config]:
    """Merge defaults, a TOML file, its tables of devices, and flags; one `Config` a device.

    overrides: dotted path to value, such as {"estimator.window": 1500}. sources: URLs given as flags, which
    replace the file's devices.

    Raises:
        UsageError: names file or flag, the path of the key, and what is wrong.
    """
    tree: dict[str, Any] = {}
    if file is not None:
        tree = _read_toml(file)
        _convert(tree, str(file))
    urls = list(sources)
    if "" in urls:
        raise UsageError('command line: --source: say where it is, for instance "serial:/dev/ttyACM0".')
    devices: dict[str | None, Mapping[str, Any]] = {**tree.pop("device", {})}
    if urls:
        names = device_names(urls) if len(urls) > 1 else [None]  # one alone may be named by `name`
        devices = dict(zip(names, ({"source": url} for url in urls), strict=True))
    configs = []
    for name, table in (devices or {None: {}}).items():
        of_program = [key for key in table if key not in OF_A_DEVICE]
        if of_program:
            raise UsageError(
                f"{file}: device.{name}.{of_program[0]}: not a setting of a device. Known here: "
                f"{', '.join(OF_A_DEVICE)}."
            )
        merged = _merged(tree, table)
        if devices and not merged.get("source"):
            raise UsageError(f'{file}: device.{name}: say where it is: source = "serial:/dev/ttyACM0".')
        if name is not None:
            _convert(merged, f"{file}: device.{name}")
        for path, value in overrides.items():
            _put(merged, path, value)
        config = _convert(merged, "command line")
        if config.device:
            raise UsageError(
                "command line: devices are set up in the file of --config, or by several --source."
            )
        name = name or config.name or device_name(config.source)
        configs.append(_convert({**merged, "name": name}, f"{file}"))
    return configs


def _merged(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """A copy of base in which the values of over win, table by table."""
    result = {key: _merged(value, {}) if isinstance(value, dict) else value for key, value in base.items()}
    for key, value in over.items():
        known = result.get(key)
        if isinstance(value, Mapping):
            result[key] = _merged(known if isinstance(known, dict) else {}, value)
        else:
            result[key] = value
    return result


def parse_setting(text: str) -> tuple[str, Any]:
    """Split `path=value` of a --set flag; the value is TOML, or else plain text.

    Raises:
        UsageError: no path or no value.
    """
    path, sign, value = text.partition("=")
    path, value = path.strip(), value.strip()
    if not sign or not path or not value:
        raise UsageError(f"--set {text}: give PATH=VALUE, for instance --set estimator.order.Q0=0.05.")
    try:
        return path, tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return path, value


def _read_toml(file: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"{file}: cannot be read ({error}).") from error
    except tomllib.TOMLDecodeError as error:
        raise UsageError(f"{file}: is not TOML: {error}.") from error


def _put(tree: dict[str, Any], path: str, value: Any) -> None:
    *parents, key = path.split(".")
    for name in parents:
        branch = tree.setdefault(name, {})
        if not isinstance(branch, dict):
            raise UsageError(f"--set {path}: '{name}' is a value, not a table.")
        tree = branch
    tree[key] = value


def _convert(tree: Mapping[str, Any], origin: str) -> Config:
    try:
        return msgspec.convert(tree, Config)
    except msgspec.ValidationError as error:
        raise UsageError(f"{origin}: {_explain(str(error))}") from error


def _explain(message: str) -> str:
    """Put msgspec's `reason - at `$.a.b`` into `a.b: reason`."""
    reason, _, place = message.partition(" - at ")
    path = place.strip("`").removeprefix("$").lstrip(".")
    unknown = re.fullmatch(r"Object contains unknown field `(.*)`", reason)
    if unknown:
        key = f"{path}.{unknown[1]}" if path else unknown[1]
        return f"{key}: there is no such setting. {_known(path)}"
    invalid = re.fullmatch(r"Invalid enum value (.*)", reason)
    if invalid:
        return f"{path}: {invalid[1]} is not one of the words that it takes: {', '.join(_words(path))}."
    if reason[1:2].islower():  # a word; names such as R and P0 keep their capital
        reason = reason[0].lower() + reason[1:]
    return f"{path}: {reason}." if path else f"{reason}."


def _table(path: list[str]) -> Any:
    """The settings at a path, with their defaults."""
    struct: Any = Config()
    for name in path:
        struct = getattr(struct, name)
    return struct


def _known(path: str) -> str:
    return f"Known here: {', '.join(_table(path.split('.') if path else []).__struct_fields__)}."


def _words(path: str) -> list[str]:
    *parents, key = path.split(".")
    hint = get_type_hints(type(_table(parents)))[key]
    options = [hint, *get_args(hint)]
    return [word for option in options if get_origin(option) is Literal for word in get_args(option)]
