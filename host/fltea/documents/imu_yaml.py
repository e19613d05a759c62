"""Kalibr's imu.yaml from what the noise of the axes is made of (pure)."""

import json
import math
import re
from collections.abc import Mapping
from typing import NamedTuple

from fltea.records.fit import Level
from fltea.records.version import __version__
from fltea.records.visible import visible


class Shown(NamedTuple):
    """N or K of one axis, or None where the noise does not have it and `reason` says why."""

    value: float | None
    reason: str = ""


class AxisNoise(NamedTuple):
    """N and K of one axis, in deg/√s and (deg/s)/√s; for an accelerometer m/s² stands for deg/s."""

    N: Shown
    K: Shown


def axis_noise(level: Level) -> AxisNoise:
    """Return N and K of the sentence that stands for the noise of an axis."""
    return AxisNoise(Shown(level.N.value, level.reason), Shown(level.K.value, NO_WALK))


class Inflation(NamedTuple):
    """Factors by which what was measured is written larger, 1 or more."""

    density: float
    random_walk: float


AS_MEASURED = Inflation(1.0, 1.0)

NO_WALK = "the noise has no random walk; one shows in records of hours"
NOT_ANALYSED = "the accelerometer was not analysed"


def imu_yaml(
    gyro: Mapping[str, AxisNoise],
    rate_hz: float,
    source: str,
    *,
    accel: Mapping[str, AxisNoise] | None = None,
    rostopic: str = "/imu0",
    inflation: Inflation = AS_MEASURED,
) -> str:
    """Return the text of the file, for axes by name; source: what they were identified from.

    Kalibr has one figure for all axes: it gets that of the worst. What is not known is a comment. Of inflated
    figures the comment has what was measured.
    """
    forces = accel or {}
    without = NOT_ANALYSED if not forces else ""
    density, walk = inflation
    what = "Noise" if forces else "Gyroscope noise"
    lines = [
        f"# {what} by fltea {__version__} from {' '.join(source.split())}",
        "# (of the axes the worst). Kalibr's model is white noise and a random walk of the rate.",
        "# Kalibr wants all six entries: fill in what is not known from the data sheet, or record longer.",
        *_about(inflation),
        *_entry(
            "accelerometer_noise_density",
            {a: n.N for a, n in forces.items()},
            "m/s^2/sqrt(Hz)",
            density,
            without,
        ),
        *_entry(
            "accelerometer_random_walk", {a: n.K for a, n in forces.items()}, "m/s^3/sqrt(Hz)", walk, without
        ),
        *_entry("gyroscope_noise_density", {a: n.N for a, n in gyro.items()}, "rad/s/sqrt(Hz)", density),
        *_entry("gyroscope_random_walk", {a: n.K for a, n in gyro.items()}, "rad/s^2/sqrt(Hz)", walk),
        f"{'update_rate:':<29}{rate_hz:.6g}  # Hz",
        f"{'rostopic:':<29}{_plain(rostopic)}",
    ]
    return "\n".join(lines) + "\n"


def _about(inflation: Inflation) -> list[str]:
    """Return what the factors are for."""
    if inflation == AS_MEASURED:
        return [
            "# These are figures of a sensor at rest. In motion come errors of scale, alignment and",
            "# vibration, which Kalibr and VINS have no terms for: users write 5 to 20 times as much",
            "# (fltea identify --inflate 10).",
        ]
    return [
        f"# Inflated: noise densities {inflation.density:g} times and random walks "
        f"{inflation.random_walk:g} times what was measured at rest.",
        "# That is for errors of scale, alignment and vibration in motion, which Kalibr and VINS have no",
        "# terms for. The right factor is the least with which residuals lie within three deviations.",
    ]


def _entry(
    key: str, found: Mapping[str, Shown], unit: str, factor: float, without: str = "no axis was analysed"
) -> list[str]:
    """Return the largest figure of the axes, in rad where the unit is one of angles, and its axis."""
    known = {axis: one.value for axis, one in found.items() if one.value is not None}
    if not known:
        reasons = dict.fromkeys(one.reason for one in found.values())
        return [f"# {key}:  # {unit}; not known: {'; '.join(reasons) or without}"]
    worst = max(known, key=lambda axis: known[axis])
    unknown = [axis for axis in found if axis not in known]
    remark = f"of {worst}" + (f"; not known of {', '.join(unknown)}" if unknown else "")
    value = math.radians(known[worst]) if unit.startswith("rad") else known[worst]
    if factor != 1:
        remark += f"; {factor:g} times the measured {value:.6e}"
    return [f"{key + ':':<29}{factor * value:.6e}  # {unit}, {remark}"]


def _plain(topic: str) -> str:
    """Return a name of a topic as YAML; quoted if it is none that ROS allows."""
    return (
        topic if re.fullmatch(r"[A-Za-z0-9_/~]+", topic) else json.dumps(visible(topic), ensure_ascii=False)
    )
