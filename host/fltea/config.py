"""Configuration: defaults, then a TOML file, then flags; every mistake is named with its path."""

import math
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

import msgspec

from fltea import wire
from fltea.errors import UsageError
from fltea.estimator.settings import GyroscopeSettings, JointSettings


class LinkConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Serial link. max_gap: longest gap in samples that is bridged; a longer one begins a new epoch."""

    baud: int = wire.BAUD
    max_gap: int = 100

    def __post_init__(self) -> None:
        if self.max_gap < 0:
            raise ValueError("max_gap must be 0 samples or more")


class ReplayConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How to read a recording (host/README.md, Recordings)."""

    columns: list[str] | None = None
    units: str | None = None
    rate_hz: float | None = None
    shuffle: int | None = None

    def __post_init__(self) -> None:
        if self.rate_hz is not None and not (math.isfinite(self.rate_hz) and self.rate_hz > 0):
            raise ValueError("rate_hz must be a positive number of samples per second")
        if self.shuffle is not None and self.shuffle < 0:
            raise ValueError("shuffle is a seed and must be 0 or more")


def _given(value: str | float | list[float]) -> list[float]:
    """The numbers in a setting that may also be a word."""
    if isinstance(value, str):
        return []
    return value if isinstance(value, list) else [value]


class EstimatorConfig(GyroscopeSettings, frozen=True, forbid_unknown_fields=True):
    """The estimator, its start-up window (samples), bias (deg/s) and R ((deg/s)²).

    engine: "compressed" (native, at a cost that does not depend on the window), "direct" (native, exact)
    or "reference" (numpy; the printed algorithm only). variant: "triple" (the paper's) or "joint" (one filter
    on α and h^α f). guard: "off" (printed), "faithful" or "consistent" (host/README.md says what they do).
    """

    startup: int = 500
    bias: Literal["startup", "none"] | float | list[float] = "startup"
    R: Literal["auto"] | float | list[float] = "auto"
    engine: Literal["compressed", "direct", "reference"] = "compressed"
    variant: Literal["triple", "joint"] = "joint"
    guard: Literal["off", "faithful", "consistent"] = "consistent"
    joint: JointSettings = JointSettings()

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.engine == "reference" and (self.variant, self.guard) != ("triple", "off"):
            raise ValueError(
                "engine reference is the printed algorithm: it needs variant triple and guard off"
            )
        if self.startup < 2:
            raise ValueError("startup must be at least 2 samples: a variance needs two")
        if any(not math.isfinite(r) or r <= 0 for r in _given(self.R)):
            raise ValueError("R is a variance and must be a positive number of (deg/s)²")
        if not all(math.isfinite(b) for b in _given(self.bias)):
            raise ValueError("bias must be finite numbers of deg/s")

    @property
    def startup_needed(self) -> int:
        """Samples that the start-up window takes: none if neither bias nor R is drawn from it."""
        return self.startup if self.bias == "startup" or self.R == "auto" else 0


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All that `fltea run` can be told; the tables of its TOML file have the same names."""

    source: str | None = None
    format: Literal["auto", "ndjson", "table"] = "auto"
    pace: Literal["auto", "real", "fast"] = "auto"
    once: bool = False
    samples: bool = False
    link: LinkConfig = LinkConfig()
    replay: ReplayConfig = ReplayConfig()
    estimator: EstimatorConfig = EstimatorConfig()


def load_config(file: Path | None, overrides: Mapping[str, Any]) -> Config:
    """Merge defaults, a TOML file and flags.

    overrides: dotted path to value, such as {"estimator.window": 1500}.

    Raises:
        UsageError: names file or flag, the path of the key, and what is wrong.
    """
    tree: dict[str, Any] = {}
    if file is not None:
        tree = _read_toml(file)
        _convert(tree, str(file))
    for path, value in overrides.items():
        _put(tree, path, value)
    return _convert(tree, "command line")


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
