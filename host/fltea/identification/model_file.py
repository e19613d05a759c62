"""Store noise models that were identified in JSON files, which `fltea simulate --model` reads."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TypeVar

import msgspec

from fltea.identification.noise_model import AxisModel, check_possible
from fltea.records.errors import UsageError
from fltea.records.records import ACCEL_AXES, AXES
from fltea.records.small_file import read_small
from fltea.records.version import __version__
from fltea.records.whole_file import whole_file

FORMAT = "fltea-noise-model"
VERSION = 5
READABLE = (4, 5)
"""Versions of the format that can be read; version 4 has no random walk of the offset."""

T = TypeVar("T")


class NoiseModels(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The models of a gyroscope's axes, gyro_x first, and of an accelerometer's axes, with their source."""

    rate_hz: float
    h_s: float
    source: str
    """The file or session that was identified."""
    axes: dict[str, AxisModel]
    """The axes of the gyroscope, in deg/s."""
    accel_axes: dict[str, AxisModel] = {}
    """The axes of the accelerometer, in m/s²."""
    fltea: str = __version__
    format: str = FORMAT
    version: int = VERSION

    def __post_init__(self) -> None:
        if not (math.isfinite(self.rate_hz) and self.rate_hz > 0):
            raise ValueError(f"rate_hz must be > 0, got {self.rate_hz}")
        if not math.isclose(self.h_s * self.rate_hz, 1, rel_tol=1e-6):
            raise ValueError(f"h_s = {self.h_s} is not 1 / rate_hz = {1 / self.rate_hz}")
        if not (self.axes or self.accel_axes) or set(self.axes) != set(AXES[: len(self.axes)]):
            raise ValueError(f"axes must be the first of {', '.join(AXES)}, got {', '.join(self.axes)}")
        if not set(self.accel_axes) <= set(ACCEL_AXES):
            raise ValueError(
                f"accel_axes must be among {', '.join(ACCEL_AXES)}, got {', '.join(self.accel_axes)}"
            )
        for axis, model in (self.axes | self.accel_axes).items():
            try:
                check_possible(model, self.h_s)
            except ValueError as error:
                raise ValueError(f"{axis}: {error}") from error


def by_sensor(axes: Mapping[str, T]) -> tuple[dict[str, T], dict[str, T]]:
    """Split a mapping by axis into the gyroscope's and the accelerometer's entries."""
    accel = {name: one for name, one in axes.items() if name in ACCEL_AXES}
    return {name: one for name, one in axes.items() if name not in accel}, accel


class _Head(msgspec.Struct):
    """The fields that every version of the file format has."""

    format: str = ""
    version: int = 0


def write_json(path: Path, found: msgspec.Struct) -> None:
    """Write an object as a JSON file; it is written completely or not at all.

    Raises:
        FlteaError: the file cannot be written.
    """
    write_text(path, msgspec.json.format(msgspec.json.encode(found), indent=2).decode() + "\n")


def write_text(path: Path, text: str) -> None:
    """Write a text file; it is written completely or not at all.

    Raises:
        FlteaError: the file cannot be written.
    """
    with whole_file(path) as file:
        file.write(text.encode())


def read_models(path: Path) -> NoiseModels:
    """Read `NoiseModels` that `write_json` wrote.

    Raises:
        UsageError: there is no such file, it is of another kind or version, or its models are impossible.
    """
    data = read_small(path)
    try:
        head = msgspec.json.decode(data, type=_Head)
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{path}: is no noise model: {error}.") from error
    if head.format != FORMAT:
        raise UsageError(
            f'{path}: is no noise model (it lacks "format": "{FORMAT}"); `fltea identify --export-model` '
            "writes one."
        )
    if head.version not in READABLE:
        raise UsageError(
            f"{path}: has version {head.version}; this fltea reads versions {READABLE[0]} to {VERSION}. "
            "Identify again, or use the fltea that wrote the file."
        )
    try:
        return msgspec.json.decode(data, type=NoiseModels)
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{path}: {error}.") from error
