"""Identified models as files: JSON that `fltea simulate --model` reads."""

import math
from pathlib import Path
from typing import Any

import msgspec

from fltea.identification.noise_model import AxisModel, Lorentzian, check_possible
from fltea.noise.parts import Alternating, AnyPart, Order, Quantisation, Relaxation, Walk, White
from fltea.records.errors import UsageError
from fltea.records.records import ACCEL_AXES, AXES
from fltea.records.version import __version__
from fltea.records.whole_file import whole_file

FORMAT = "fltea-noise-model"
VERSION = 4
FIRST_OF_PARTS = 4
"""Versions before have one of six kinds of noise in place of parts (`_upgraded`)."""


class NoiseModels(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The models of a gyroscope's axes, gyro_x first, and of an accelerometer's, and what they are from."""

    rate_hz: float
    h_s: float
    source: str
    """File or session that was identified."""
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
            raise ValueError(f"axes are {', '.join(AXES)}, one after the other, got {', '.join(self.axes)}")
        if not set(self.accel_axes) <= set(ACCEL_AXES):
            raise ValueError(f"accel_axes are {', '.join(ACCEL_AXES)}, got {', '.join(self.accel_axes)}")
        for axis, model in (self.axes | self.accel_axes).items():
            try:
                check_possible(model, self.h_s)
            except ValueError as error:
                raise ValueError(f"{axis}: {error}") from error


class _Head(msgspec.Struct):
    """What every version of the format begins with."""

    format: str = ""
    version: int = 0


def write_json(path: Path, found: msgspec.Struct) -> None:
    """Write a file as JSON; it appears whole or not at all.

    Raises:
        FlteaError: it cannot be written.
    """
    write_text(path, msgspec.json.format(msgspec.json.encode(found), indent=2).decode() + "\n")


def write_text(path: Path, text: str) -> None:
    """Write a file whole, or not at all.

    Raises:
        FlteaError: it cannot be written.
    """
    with whole_file(path) as file:
        file.write(text.encode())


def read_models(path: Path) -> NoiseModels:
    """Read what `write_json` wrote of `NoiseModels`, or an earlier fltea.

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
    if not 1 <= head.version <= VERSION:
        raise UsageError(
            f"{path}: is of version {head.version}; this fltea reads versions 1 to {VERSION}. "
            "Identify again, or use the fltea that wrote it."
        )
    try:
        if head.version >= FIRST_OF_PARTS:
            return msgspec.json.decode(data, type=NoiseModels)
        return _upgraded(msgspec.json.decode(data))
    except (KeyError, TypeError, AttributeError) as error:
        raise UsageError(f"{path}: is no noise model of version {head.version}: {error!r}.") from error
    except ValueError as error:
        raise UsageError(f"{path}: {error}.") from error


def _upgraded(old: dict[str, Any]) -> NoiseModels:
    """Return a file of version 1, 2 or 3 in parts."""
    h = float(old["h_s"])
    new = dict(old) | {"version": VERSION}
    for key in ("axes", "accel_axes"):
        new[key] = {
            axis: AxisModel(
                _parts_of(model["noise"], h),
                tuple(
                    Lorentzian(one["frequency_hz"], one["width_hz"], one["variance_dps2"])
                    for one in model.get("resonances", ())
                ),
            )
            for axis, model in old.get(key, {}).items()
        }
    return msgspec.convert(msgspec.to_builtins(new), NoiseModels)


def _parts_of(noise: dict[str, Any], h: float) -> tuple[AnyPart, ...]:
    """Return the parts of one of the kinds of noise of versions 1 to 3."""
    white = White(noise["R_dps2"])
    match noise["kind"]:
        case "white":
            return (white,)
        case "ar1":
            return white, _relaxation(noise["phi"], noise["s2_dps2"], h)
        case "two_ar1":
            slow = _relaxation(noise["phi_slow"], noise["s2_slow_dps2"], h)
            return white, slow, _relaxation(noise["phi_fast"], noise["s2_fast_dps2"], h)
        case "fractional":
            return white, Order(noise["alpha"], noise["f"], noise["Q"])
        case "composite":
            parts: list[AnyPart] = [
                white,
                *(Relaxation(one["sigma_dps"], one["tau_s"]) for one in noise.get("gauss_markov", ())),
            ]
            if K := noise.get("K_dps_per_sqrt_s"):
                parts.append(Walk(K))
            if Q := noise.get("Q_deg"):
                parts.append(Quantisation(Q))
            return tuple(parts)
        case kind:
            raise ValueError(f"noise of the kind {kind!r} cannot be read any more: identify again")


def _relaxation(phi: float, s2: float, h: float) -> AnyPart:
    """Return AR(1) of this coefficient and variance of its steps."""
    if not abs(phi) < 1:
        raise ValueError(f"phi must be between -1 and 1, got {phi}")
    if phi == 0:
        return White(s2)
    kind = Relaxation if phi > 0 else Alternating
    return kind(math.sqrt(s2 / (1 - phi * phi)), -h / math.log(abs(phi)))
