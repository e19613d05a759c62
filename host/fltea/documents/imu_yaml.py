"""Write Kalibr's imu.yaml from the noise of the axes."""

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from textwrap import wrap
from typing import NamedTuple

from fltea.records.version import __version__
from fltea.records.visible import visible


class Shown(NamedTuple):
    """N or K of one axis. `value` is None if it is not known, and `remark` then says why."""

    value: float | None
    remark: str = ""
    """Explanation of the value, or the reason why it is not known."""
    at_most: float | None = None
    """Upper bound, with 95 % probability, of a value that is not known."""
    slower: tuple[tuple[float, float], ...] = ()
    """For N: slower noise for which Kalibr has no term. It is described by Gauss-Markov states.

    Each entry is a pair: the correlation time of a state [s], and the noise density for averaging times of
    that length and longer.
    """


class AxisNoise(NamedTuple):
    """N and K of one axis, in deg/√s and (deg/s)/√s; for an accelerometer with m/s² in place of deg/s."""

    N: Shown
    K: Shown


class Inflation(NamedTuple):
    """Factors of at least 1 by which the measured figures are multiplied in files for other programs."""

    density: float
    random_walk: float
    of_axes: Mapping[str, float] = {}
    """Axes with a factor of their own, which multiplies N as well as K in place of the two factors above."""
    reasons: Sequence[str] = ()
    """Sentences that explain the factors for single axes."""

    def densities(self, axes: Iterable[str]) -> dict[str, float]:
        """Return the factor by which the noise density N of each axis is multiplied in the file."""
        return {axis: self.of_axes.get(axis, self.density) for axis in axes}

    def walks(self, axes: Iterable[str]) -> dict[str, float]:
        """Return the factor by which the random walk K of each axis is multiplied in the file."""
        return {axis: self.of_axes.get(axis, self.random_walk) for axis in axes}


AS_MEASURED = Inflation(1.0, 1.0)

WIDTH = 100
"""Largest number of characters in a line of a comment."""

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
    """Return the text of the file, for axes by name. `source`: the recording that was identified.

    Kalibr has one figure for all axes, so the figure of the axis with the largest one is written. For a
    figure that is not known, there is only a comment. For a figure that was multiplied by a factor, the
    comment states the measured value.
    """
    forces = accel or {}
    without = NOT_ANALYSED if not forces else ""
    what = "Noise" if forces else "Gyroscope noise"
    lines = [
        f"# {what} by fltea {__version__} from {' '.join(source.split())}",
        "# (the worst axis). Kalibr's model is white noise and a random walk of the rate.",
        "# Kalibr wants all six entries: fill in what is not known from the data sheet, or record longer.",
        *_about(inflation),
        *_entry(
            "accelerometer_noise_density",
            {a: n.N for a, n in forces.items()},
            "m/s^2/sqrt(Hz)",
            inflation.densities(forces),
            without,
        ),
        *_entry(
            "accelerometer_random_walk",
            {a: n.K for a, n in forces.items()},
            "m/s^3/sqrt(Hz)",
            inflation.walks(forces),
            without,
        ),
        *_entry(
            "gyroscope_noise_density",
            {a: n.N for a, n in gyro.items()},
            "rad/s/sqrt(Hz)",
            inflation.densities(gyro),
        ),
        *_entry(
            "gyroscope_random_walk",
            {a: n.K for a, n in gyro.items()},
            "rad/s^2/sqrt(Hz)",
            inflation.walks(gyro),
        ),
        f"{'update_rate:':<29}{rate_hz:.6g}  # Hz",
        f"{'rostopic:':<29}{_plain(rostopic)}",
    ]
    return "\n".join(lines) + "\n"


def _about(inflation: Inflation) -> list[str]:
    """Return comments that explain the factors."""
    if inflation == AS_MEASURED:
        return [
            "# These are figures of a sensor at rest. In motion come errors of scale, alignment and",
            "# vibration. Kalibr and VINS have no terms for these errors, so users write 5 to 20 times as",
            "# much (fltea identify --inflate 10).",
        ]
    if inflation.reasons:
        return [f"# {line}" for said in inflation.reasons for line in wrap(f"Inflated: {said}", WIDTH)]
    return [
        f"# Inflated: noise densities {inflation.density:g} times and random walks "
        f"{inflation.random_walk:g} times what was measured at rest.",
        "# These factors allow for errors of scale, alignment and vibration in motion, for which Kalibr",
        "# and VINS have no terms. The right factor is the smallest with which the residuals lie within",
        "# three standard deviations.",
    ]


def _entry(
    key: str,
    found: Mapping[str, Shown],
    unit: str,
    factors: Mapping[str, float],
    without: str = "no axis was analysed",
) -> list[str]:
    """Return the lines for one figure: its largest value of all axes, after each is multiplied by its factor.

    `unit`: unit in the file. If it begins with "rad", `found` is in degrees.
    """
    scale = math.radians(1.0) if unit.startswith("rad") else 1.0
    known = {axis: one.value for axis, one in found.items() if one.value is not None}
    if not known:
        reasons = [*dict.fromkeys(one.remark for one in found.values()), *_at_most(found, scale)]
        return [f"# {key}:  # {unit}; not known: {'; '.join(filter(None, reasons)) or without}"]
    worst = max(known, key=lambda axis: factors[axis] * known[axis])
    factor = factors[worst]
    unknown = [axis for axis in found if axis not in known]
    remarks = [f"of {worst}", f"not known for {', '.join(unknown)}" if unknown else "", found[worst].remark]
    value = scale * known[worst]
    if factor != 1:
        remarks.append(f"{factor:g} times the measured {value:.6e}")
    return [
        f"{key + ':':<29}{factor * value:.6e}  # {unit}, {'; '.join(filter(None, remarks))}",
        *_slower(found, scale),
    ]


def _at_most(found: Mapping[str, Shown], scale: float) -> Iterator[str]:
    """Yield the largest upper bound of all axes, for a figure that is not known on any axis."""
    bounds = [one.at_most for one in found.values() if one.at_most is not None]
    if bounds:
        yield f"at most {scale * max(bounds):.2e}, with 95 % probability"


def _slower(found: Mapping[str, Shown], scale: float) -> Iterator[str]:
    """Yield a comment on the slow noise that N leaves out, for the axis where that noise is largest."""
    worst = max(found, key=lambda axis: max((density for _, density in found[axis].slower), default=0.0))
    if slower := found[worst].slower:
        densities = ", ".join(f"{scale * density:.2e} at {tau_s:.2g} s" for tau_s, density in slower)
        yield f"#   {worst} also has slower noise, for which Kalibr has no term: the density is {densities}"
        yield "#   and longer. --gauss-markov writes all this noise for a filter of your own."


def _plain(topic: str) -> str:
    """Return a topic's name as YAML; it is quoted if ROS does not allow such a name."""
    return (
        topic if re.fullmatch(r"[A-Za-z0-9_/~]+", topic) else json.dumps(visible(topic), ensure_ascii=False)
    )
