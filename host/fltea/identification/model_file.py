"""Identified models as files: JSON that `fltea simulate --model` reads, and imu.yaml as Kalibr reads it."""

import math
from collections.abc import Mapping
from pathlib import Path

import msgspec

from fltea.documents.imu_yaml import AS_MEASURED, AxisNoise, Inflation, Shown, imu_yaml
from fltea.identification.allan import Allan
from fltea.identification.noise_model import AxisModel, check_stationary
from fltea.records.errors import UsageError
from fltea.records.records import ACCEL_AXES, AXES
from fltea.records.version import __version__
from fltea.records.whole_file import whole_file
from fltea.spectrum.allan_coefficients import Coefficient
from fltea.spectrum.composite import Composite
from fltea.spectrum.composite_intervals import Estimate

FORMAT = "fltea-noise-model"
VERSION = 3
READABLE = (1, 2, 3)
"""Version 1 has no composite noise, and 1 and 2 have no accelerometer; all else is the same."""


class NoiseModels(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The models of a gyroscope's axes, gyro_x first, and of an accelerometer's, and what they are from."""

    rate_hz: float
    h_s: float
    source: str
    """File or session that was identified."""
    axes: dict[str, AxisModel]
    """The axes of the gyroscope."""
    accel_axes: dict[str, AxisModel] = {}
    """The axes of the accelerometer, in m/s² wherever a name says dps."""
    fltea: str = __version__
    format: str = FORMAT
    version: int = VERSION

    def __post_init__(self) -> None:
        if not (math.isfinite(self.rate_hz) and self.rate_hz > 0):
            raise ValueError(f"rate_hz must be > 0, got {self.rate_hz}")
        if not math.isclose(self.h_s * self.rate_hz, 1, rel_tol=1e-6):
            raise ValueError(f"h_s = {self.h_s} is not 1 / rate_hz = {1 / self.rate_hz}")
        if not (self.axes or self.accel_axes) or set(self.axes) != set(AXES[: len(self.axes)]):
            raise ValueError(f"axes are {', '.join(AXES)}, one after the other, got {', '.join(self.axes)}")
        if not set(self.accel_axes) <= set(ACCEL_AXES):
            raise ValueError(f"accel_axes are {', '.join(ACCEL_AXES)}, got {', '.join(self.accel_axes)}")
        for axis, model in (self.axes | self.accel_axes).items():
            try:
                check_stationary(model, self.h_s)
            except ValueError as error:
                raise ValueError(f"{axis}: {error}") from error


class _Head(msgspec.Struct):
    """What every version of the format begins with."""

    format: str = ""
    version: int = 0


def write_models(path: Path, models: NoiseModels) -> None:
    """Write the models as JSON; the file appears whole or not at all.

    Raises:
        FlteaError: it cannot be written.
    """
    write_text(path, msgspec.json.format(msgspec.json.encode(models), indent=2).decode() + "\n")


def read_models(path: Path) -> NoiseModels:
    """Read what `write_models` wrote.

    Raises:
        UsageError: no such file, another kind or version, or models that cannot be.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise UsageError(f"{path}: cannot be read ({error.strerror or error}).") from error
    try:
        head = msgspec.json.decode(data, type=_Head)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise UsageError(f"{path}: is no noise model: {error}.") from error
    if head.format != FORMAT:
        raise UsageError(
            f'{path}: is no noise model (it lacks "format": "{FORMAT}"); `fltea identify --export-model` '
            "writes one."
        )
    if head.version not in READABLE:
        raise UsageError(
            f"{path}: is of version {head.version}; this fltea reads versions 1 to {VERSION}. "
            "Identify again, or use the fltea that wrote it."
        )
    try:
        return msgspec.structs.replace(msgspec.json.decode(data, type=NoiseModels), version=VERSION)
    except msgspec.ValidationError as error:
        raise UsageError(f"{path}: {error}.") from error


def imu_yaml_of(
    curves: Mapping[str, Allan],
    rate_hz: float,
    source: str,
    *,
    composites: Mapping[str, Composite] | None = None,
    rostopic: str = "/imu0",
    inflation: Inflation = AS_MEASURED,
) -> str:
    """Return Kalibr's imu.yaml from the Allan deviations of axes of both sensors, by name.

    composites: what is asked for N and K where the curve does not have their slope. A Gauss–Markov part is
    given for neither: it is no random walk, and Kalibr has no entry for it.
    """
    gyro: dict[str, AxisNoise] = {}
    accel: dict[str, AxisNoise] = {}
    for axis, curve in curves.items():
        model = (composites or {}).get(axis)
        (accel if axis in ACCEL_AXES else gyro)[axis] = AxisNoise(
            _shown(curve.N, model.N if model else None),
            _shown(curve.K, model.K if model else None),
        )
    return imu_yaml(gyro, rate_hz, source, accel=accel, rostopic=rostopic, inflation=inflation)


def write_text(path: Path, text: str) -> None:
    """Write a file whole, or not at all.

    Raises:
        FlteaError: it cannot be written.
    """
    with whole_file(path) as file:
        file.write(text.encode())


def _shown(c: Coefficient, modelled: Estimate | None) -> Shown:
    """Return the curve's figure, else the model's if that is bounded on both sides."""
    if c.value is None and modelled is not None and modelled.low is not None and modelled.high is not None:
        return Shown(modelled.value, origin="from the composite model; the Allan deviation does not show it")
    return Shown(c.value, c.reason)
