"""Read the configuration from defaults, a TOML file and flags. Errors name the path of the wrong setting."""

import re
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from fltea.records.errors import UsageError
from fltea.records.secret import refuse_secret
from fltea.records.sensor_kind import SENSOR_KINDS
from fltea.records.small_file import read_small
from fltea.settings.device_name import NAME, device_name, device_names
from fltea.settings.duration import Duration, in_seconds
from fltea.settings.estimator import LONGEST_GAP, AccelConfig, EstimatorConfig
from fltea.settings.how import How
from fltea.settings.ingest import IngestConfig
from fltea.settings.limits import DEFAULT_LIMITS, Limits
from fltea.settings.live import LiveConfig
from fltea.settings.outputs import Outputs
from fltea.settings.setting import Setting, Table, all_declared, joined, of_sensor, shown, tables
from fltea.settings.sources import with_small_scheme
from fltea.wire import layout as wire

MOST_BYTES = 250_000
"""Largest size of a settings file [bytes], enough for the tables of a thousand devices."""

DOT, MOST_DOTS = re.compile(r"\.[^.]"), 50
"""A line of a settings file may have at most this number of dots. Dots divide a key into parts, and the time
and memory that tomllib needs grow with the square of the number of parts.
"""

MOST_MB = 1e9
"""Largest value of a setting that limits memory [MB]. It is a thousand TB."""


class LinkConfig(Table, frozen=True):
    """Settings of the serial connection to a device."""

    baud: Annotated[
        int,
        Setting(
            "Speed of a serial port.",
            unit="baud",
            least=1,
            most=100_000_000,
            flags=("--baud",),
            metavar="N",
        ),
    ] = wire.BAUD
    latency: Annotated[
        str,
        Setting(
            "Samples of a serial port may wait this long for further samples, which saves processor time; "
            "with 0 ms, each is read at once.",
            unit="s",
            least=0,
            most=1,
            time=True,
            flags=("--latency",),
            metavar="TIME",
        ),
    ] = "20 ms"
    max_gap: Annotated[
        Duration,
        Setting(
            "Longest gap that is bridged by prediction, a number of samples or a time. A longer gap begins "
            "a new epoch.",
            unit="samples",
            least=0,
            most=LONGEST_GAP,
            time=True,
            flags=("--max-gap",),
            metavar="N|TIME",
            board=True,
        ),
    ] = 100

    @property
    def latency_s(self) -> float:
        """The setting `latency` in seconds."""
        seconds = in_seconds(self.latency)
        assert seconds is not None  # Setting.accepts has checked that the text is a time
        return seconds


def _memory(meaning: str) -> Setting:
    return Setting(meaning, unit="MB", above=0, most=MOST_MB)


class ReplayConfig(How, frozen=True):
    """Settings for reading a recording."""

    shuffle: Annotated[
        int | None,
        Setting(
            "Shuffle the samples of a recording, with this seed. The results are then those for white "
            "noise of the same power.",
            least=0,
            flags=("--shuffle",),
            metavar="SEED",
            example=1,
        ),
    ] = None
    max_chunk_mb: Annotated[
        float, _memory("Largest memory that one record of an MCAP file may take after decompression.")
    ] = DEFAULT_LIMITS.max_chunk_mb
    max_mb: Annotated[
        float, _memory("Largest memory that any other recording may take, at 8 bytes for each number.")
    ] = DEFAULT_LIMITS.max_mb

    @property
    def limits(self) -> Limits:
        """The limits of memory for reading a recording."""
        return Limits(self.max_chunk_mb, self.max_mb)

    @property
    def how(self) -> How:
        """The settings about columns, units and rate of the recording."""
        return How(**{name: getattr(self, name) for name in How.__struct_fields__})


# Why more than 12 attributes: each is one setting, or one table of settings, of the TOML file.
class Config(Outputs, frozen=True):
    """All settings of `fltea run`; the tables of its TOML file have the same names."""

    source: Annotated[
        str | None,
        Setting("Address of the source of samples, as for `--source`.", example="serial:/dev/ttyACM0"),
    ] = None
    name: Annotated[
        str | None,
        Setting(
            "Name of the device in all outputs. Unset: a name is made from the device's address.",
            example="arm",
        ),
    ] = None
    channels: Annotated[
        list[str] | None,
        Setting(
            "Axes to estimate: gyro_x, gyro_y, gyro_z, accel_x, accel_y, accel_z. Unset: those of the "
            "gyroscope.",
            flags=("--channels",),
            metavar="A,B,…",
            example=["gyro_z", "accel_x"],
        ),
    ] = None
    format: Annotated[
        Literal["auto", "ndjson", "table", "none"],
        Setting(
            "Standard output: `ndjson`, `table`, `none`, or `auto`: a table on a terminal, else NDJSON.",
            flags=("--format",),
        ),
    ] = "auto"
    pace: Annotated[
        Literal["auto", "real", "fast"],
        Setting(
            "Speed of recordings and synthetic noise: `real`, `fast`, or `auto`: recordings fast, noise "
            "real.",
            flags=("--pace",),
        ),
    ] = "auto"
    once: Annotated[
        bool,
        Setting(
            "End when the recording ends. With a device: if it fails, end instead of waiting for it.",
            flags=("--once",),
        ),
    ] = False
    samples: Annotated[
        bool,
        Setting("Write the samples too, so that the output can be replayed.", flags=("--samples",)),
    ] = False
    link: LinkConfig = LinkConfig()
    ingest: IngestConfig = IngestConfig()
    replay: ReplayConfig = ReplayConfig()
    estimator: EstimatorConfig = EstimatorConfig()
    accel: AccelConfig = AccelConfig()
    live: LiveConfig = LiveConfig()
    device: dict[str, dict[str, Any]] = msgspec.field(default_factory=dict)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.source is not None:
            refuse_secret("source", self.source)
            msgspec.structs.force_setattr(self, "source", with_small_scheme(self.source))
        known = [axis for kind in SENSOR_KINDS for axis in kind.axes]
        for channel in self.channels or ():
            if channel not in known:
                raise ValueError(f"channels: there is no {channel}; there are {', '.join(known)}")
        if self.channels is not None and len(set(self.channels)) != len(self.channels or "x"):
            raise ValueError("channels must name at least one axis, and each once")
        if self.name is not None and not NAME.fullmatch(self.name):
            raise ValueError(f"name {self.name!r}: letters, digits, '_', '.' and '-' make a device's name")


TABLES = tables(Config())
"""All tables of settings by their paths, such as `estimator`. The path of the top table is ""."""

SETTINGS = all_declared(Config())
"""All settings by their paths, such as `estimator.window`."""

OF_A_DEVICE = ("source", "channels", "pace", "link", "replay", "estimator", "accel")
"""The settings and tables that a table [device.NAME] of the TOML file may hold. All other settings apply to
the whole program.
"""


def load_config(file: Path | None, overrides: Mapping[str, Any]) -> Config:
    """Return the configuration of a program with one device. The arguments are those of `load_configs`."""
    (config,) = load_configs(file, overrides)
    return config


def load_configs(
    file: Path | None, overrides: Mapping[str, Any], sources: Iterable[str] = ()
) -> list[Config]:
    """Merge defaults, a TOML file, its tables of devices, and flags. Return one `Config` for each device.

    `file`: the TOML file, or None for no file.
    `overrides`: values that flags set. The keys are the dotted paths of the settings: {"estimator.window":
    1500}.
    `sources`: URLs given as flags, which replace the file's devices.

    Raises:
        UsageError: a setting is wrong; the text names the file or flag, and the path of the setting.
    """
    tree: dict[str, Any] = {}
    if file is not None:
        tree = _read_toml(file)
        _convert(tree, str(file))
    urls = [with_small_scheme(url) for url in sources]
    if "" in urls:
        raise UsageError('command line: --source: say where it is, for instance "serial:/dev/ttyACM0".')
    devices: dict[str | None, Mapping[str, Any]] = {**tree.pop("device", {})}
    if urls:
        # a single device gets its name from the setting `name`
        names = device_names(urls) if len(urls) > 1 else [None]
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
    """Return a copy of `base` in which the values of `over` replace those of `base`, table by table."""
    result = {key: _merged(value, {}) if isinstance(value, dict) else value for key, value in base.items()}
    for key, value in over.items():
        known = result.get(key)
        if isinstance(value, Mapping):
            result[key] = _merged(known if isinstance(known, dict) else {}, value)
        else:
            result[key] = value
    return result


def parse_setting(text: str) -> tuple[str, Any]:
    """Split the text `path=value` of a --set flag.

    The value is read as TOML. A value that is no TOML, such as a word without quotes, is read like the text
    after the setting's own flag.

    Raises:
        UsageError: the path or the value is missing.
    """
    path, sign, value = text.partition("=")
    path, value = path.strip(), value.strip()
    if not sign or not path or not value:
        raise UsageError(f"--set {text}: give PATH=VALUE, for instance --set estimator.order.Q0=0.05.")
    try:
        return path, _parsed(f"value = {value}")["value"]
    except (ValueError, RecursionError):
        return path, SETTINGS[path].read(value) if path in SETTINGS else value


def of_flags(flags: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of flags. The key of each value is the path of the setting that the flag sets.

    Texts are converted to the type of the setting. A flag with the value None was not given, and is left out.
    """
    return {
        path: SETTINGS[path].read(value) if isinstance(value, str) else value
        for path, value in flags.items()
        if value is not None
    }


def _read_toml(file: Path) -> dict[str, Any]:
    try:
        return _parsed(read_small(file, most_bytes=MOST_BYTES).decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{file}: is not TOML: {error}.") from error


def _parsed(text: str) -> dict[str, Any]:
    """Return the contents of a TOML text as nested dictionaries; raise ValueError if the text is no TOML."""
    for number, line in enumerate(text.split("\n"), 1):
        if sum(1 for _ in DOT.finditer(line)) > MOST_DOTS:
            raise ValueError(f"line {number} has more than {MOST_DOTS} dots, which no setting has")
    return tomllib.loads(text)


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
        raise UsageError(f"{origin}: {_explain(str(error), tree)}") from error
    except UnicodeEncodeError as error:
        raise UsageError(f"{origin}: {shown(error.object)} is not UTF-8.") from error


def _explain(message: str, tree: Mapping[str, Any]) -> str:
    """Convert msgspec's message `reason - at `$.a.b`` to a sentence that begins with the setting's path."""
    reason, _, place = message.partition(" - at ")
    path = place.strip("`").removeprefix("$").lstrip(".")
    unknown = re.fullmatch(r"Object contains unknown field `(.*)`", reason)
    if unknown:
        key = joined(path, unknown[1])
        return f"{key}: there is no such setting. Known here: {', '.join(TABLES[path].__struct_fields__)}."
    setting = SETTINGS.get(re.sub(r"\[.*", "", path))
    # All other messages about a setting mean that its value has a wrong type, or is not an allowed word.
    if setting is not None:
        return f"{setting.wrong(_value(tree, setting.path))}."
    if path in TABLES and reason.partition(" ")[0].rstrip(":") in TABLES[path].__struct_fields__:
        # If a table's own check has failed, the message begins with the setting's name without the path,
        # since a table does not know its path.
        return f"{of_sensor(path + '.', joined(path, reason))}."
    return f"{path}: {reason[:1].lower()}{reason[1:]}."


def _value(tree: Any, path: str) -> Any:
    for name in path.split("."):
        tree = tree[name]
    return tree
