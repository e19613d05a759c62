"""Check whether the data of a recording can be samples of sensors in the stated units.

The check precedes all figures. A file may hold something else: alternating rows of two sensors, old values in
place of new ones, bytes that are no measurement, or another unit. Each check has a threshold that clean
noise, white or coloured, hardly ever exceeds.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from fltea.identification.data_checks import DataCheck
from fltea.identification.gaps import Gaps, cut, no_gaps
from fltea.identification.repeated import repeats
from fltea.identification.resolution import LONG, step, thin
from fltea.identification.values import HIDE, value_data_checks
from fltea.recording.candidates import MOST_MEAN_DPS, MOST_N, USUAL
from fltea.recording.reading import Answer
from fltea.records.arrays import Array, median
from fltea.records.records import ACCEL_AXES, AXES
from fltea.records.sensor_kind import SENSOR_KINDS, kind_of
from fltea.records.units import STANDARD_GRAVITY_MS2
from fltea.spectrum.median_filter import find_median_filter

TURNS, TURN = 32, 12
"""TURNS: number of parts into which a record is divided. The length of each part is a multiple of TURN
samples.

If the rows of 2, 3 or 4 sensors alternate, a pattern recurs every 2, 3 or 4 samples. The error of the
pattern's size is computed from the scatter of the sizes in the parts. TURN is 12, since 12 samples hold each
of these patterns a whole number of times.
"""
ALTERNATES = {2: 50.0, 3: 25.0, 4: 25.0}
"""A pattern is reported only if (size / standard error of the size)² exceeds this threshold. The keys are the
numbers of samples after which the pattern recurs, which are the numbers of alternating sensors.

Chance exceeds the threshold once in ten million cases.
"""
ALTERNATES_SHARE, SCATTER_SHARE = 0.01, 0.1
"""An alternating pattern that is smaller than these proportions of the noise does little harm.

For a pattern in the level of the samples, ALTERNATES_SHARE is a proportion of the noise's power. For a
pattern in the scatter, SCATTER_SHARE is a proportion of the noise's mean size.
"""
GLITCH, GLITCHES = 4.5, 0.05
"""A sample whose size exceeds GLITCH times the median size is an outlier. Outliers count as glitches if they
are at most the fraction GLITCHES of all samples.

In Gaussian noise, GLITCH times the median size is three standard deviations.
"""
ALTERNATES_S = 20.0
"""Alternating sensors are searched for only in a record of at least this length [s].

In a shorter record, mains hum near half the sample rate looks like two alternating sensors.
"""
GROUP_SHARE, GROUP_WIDTH = 0.005, 0.2
"""A gap divides values into two groups if each group has at least the fraction GROUP_SHARE of the samples,
and if the gap is at least the fraction GROUP_WIDTH of the range of the values.
"""
SELDOM = 0.1
"""Values jump between two groups only if the number of jumps is at least this fraction of the number in a
random order of the same values.

With fewer jumps, each group is one position of a sensor that was turned.
"""
FAR_COUNTS, FAR_STEPS = 32.0, 8.0
"""Values that jump between two distant groups are broken reads. The groups must be FAR_COUNTS counts apart.

If the size of a count is not known, FAR_STEPS times the smallest difference of two values is enough. Coarse
rounding leaves smaller gaps between values.
"""
FAR = {"deg/s": 20.0, "m/s²": 5.0}
"""Distance between two groups of values from which on they are broken reads even if the size of a count is
not known.

No sensor has counts that large.
"""
HELD_SHARE = 0.05
"""Largest proportion of samples that may repeat the sample before, in addition to those that repeat it by
chance.

Above it, the true sampling rate is lower than stated, and N is wrong.
"""
GRAVITY = 0.1
"""The gravity that an accelerometer at rest shows may be wrong by at most this relative error."""
QUIET, SHAKES = 8, 0.05
"""A record is divided into QUIET parts, and the part with the least noise counts as rest.

If an accelerometer's noise in that part exceeds SHAKES times gravity, the sensor was not at rest. No
accelerometer at rest has so much noise.
"""
ROOT_HOUR = 60.0
LEAST_MS2 = 0.5
"""Gravity is checked only if its magnitude is at least this [m/s²]: some loggers subtract gravity or write
zeros.
"""
UNITS_OF_GRAVITY = (
    ("That is 1 g.", STANDARD_GRAVITY_MS2, "--accel-units g"),
    ("That is 1 g in mg.", STANDARD_GRAVITY_MS2 / 1000, "--accel-units mg"),
    ("That is 9.81 m/s² read as g.", 1 / STANDARD_GRAVITY_MS2, "--accel-units m/s^2"),
    ("That is 9.81 m/s² in mm/s², or 1 g in mg.", 1 / 1000, "--accel-units mm/s^2, or mg"),
)
"""Wrong units that explain a wrong magnitude of gravity.

Each row has a sentence for the user, the factor that converts the samples to m/s², and the option with the
right unit.
"""
ORDINALS = {2: "second", 3: "third", 4: "fourth"}
BROKEN_REMEDY = (
    "The reads are broken: look at the bus, the wires and the order of bytes, or at whether these columns "
    "are rates at all."
)


class Turns(NamedTuple):
    """A pattern that recurs every `sensors` samples, as if that many sensors delivered samples in turn."""

    sensors: int
    severe: bool
    """Whether the pattern is so large that the figures of the noise are wrong."""
    what: str


class Axis(NamedTuple):
    """Facts on the samples of one axis that the checks use."""

    samples: int
    mean: float
    noise: float
    """Standard deviation of the fast noise."""
    turns: Turns | None
    broken: str
    rest: tuple[float, float]
    """Mean of the samples, and standard deviation of the fast noise, in the part of the record with the least
    noise.
    """


def judge(
    read: Callable[[str], Array],
    lsb: Mapping[str, float | None],
    h: float,
    gaps: Gaps,
    reading: Sequence[Answer] = (),
) -> Iterator[DataCheck]:
    """Yield the data checks for all axes of a recording.

    Args:
        read: function that returns the samples (n,) of an axis, so that only one axis at a time is in memory.
        lsb: one count of each axis in its unit; None if not known.
        h: sampling period [s].
        gaps: where samples are missing.
        reading: how the file was read, as far as that is known.
    """
    seen = {name: _look(read(name), one, kind_of(name).text_unit, gaps) for name, one in lsb.items()}
    kept = [data_check for kind in SENSOR_KINDS for data_check in _held(read, lsb, h, kind.axes)]
    yield from kept
    # If each value is delivered two, three or four times, that also makes a pattern, which looks like
    # alternating sensors. So the check for alternating sensors is skipped.
    by_turns = [] if any(data_check.severity == "bad" for data_check in kept) else list(_alternating(seen, h))
    yield from by_turns
    for name, axis in seen.items():
        if axis.broken and not by_turns:
            yield DataCheck("broken reads", "bad", axis.broken, BROKEN_REMEDY, (name,))
    if not any(one.question == "accelerometer" and one.evidence == "given" for one in reading):
        yield from _gravity([seen[name].mean for name in ACCEL_AXES if name in seen])
    unit = next((one for one in reading if one.question == "unit" and one.evidence == "convention"), None)
    if unit is not None:
        yield from _like_mems(seen, h, unit)


def judge_one(y: Array, unit: str, lsb: float | None, h: float) -> Iterator[DataCheck]:
    """Yield the data checks for the samples (n,) of one axis that was not read from a recording."""
    seen = _look(y, lsb, unit, no_gaps())
    if not any(data_check.kind in HIDE for data_check in value_data_checks(y, unit)):
        yield from held([y], [lsb], h)
    yield from _alternating({"it": seen}, h)
    if seen.broken:
        yield DataCheck("broken reads", "bad", seen.broken, BROKEN_REMEDY)


def _held(
    read: Callable[[str], Array], lsb: Mapping[str, float | None], h: float, names: Sequence[str]
) -> tuple[DataCheck, ...]:
    its = tuple(name for name in names if name in lsb)
    return held(map(read, its), [lsb[name] for name in its], h, its)


def held(
    y: Iterable[Array], lsb: Sequence[float | None], h: float, names: tuple[str, ...] = ()
) -> tuple[DataCheck, ...]:
    """Check whether samples of a sensor repeat the sample before on all axes more often than by chance.

    Args:
        y: the samples of each axis, (n,).
        lsb: one count of each axis, if known.
        h: sampling period [s].
        names: names of the axes, for the result.
    """
    filtered = []

    def each() -> Iterator[tuple[Array, float | None]]:
        for axis, one in zip(y, lsb, strict=True):
            filtered.append(find_median_filter(axis) is not None)
            yield axis, one or step(axis)

    seen = repeats(each())
    if seen is None or not seen.found or all(filtered):  # a median filter explains the repeated values
        return ()
    share = (seen.same - seen.expected) / seen.pairs
    every = seen.change_every if share > HELD_SHARE else None
    return (
        DataCheck(
            "repeated",
            "bad" if share > HELD_SHARE else "warning",
            f"{seen.same} samples ({seen.same / seen.pairs:.2%}) equal the sample before on every "
            f"axis; chance gives {seen.expected:.0f}."
            + (f" The values change {1 / h / every:.4g} times a second, not {1 / h:.4g}." if every else ""),
            "The sensor is read faster than it measures, or reads fail and the old value is kept: set its "
            "sample-rate divider to the rate of reading, or wait for its data-ready signal.",
            names,
        ),
    )


def _look(y: Array, lsb: float | None, unit: str, gaps: Gaps) -> Axis:
    begin, end, _ = max(cut(len(y), gaps, 0), key=lambda one: one[1] - one[0])
    run = np.ascontiguousarray(y[begin : min(end, begin + LONG)], dtype=np.float64)
    if len(run) < 2 * TURNS or not np.ptp(run) > 0:
        return Axis(len(y), float(y.mean()), 0.0, None, "", (float(y.mean()), 0.0))
    against = run[1:-1] - (run[:-2] + run[2:]) / 2  # without offset and drift
    noise = float(against.std()) / math.sqrt(1.5)
    parts = against[: len(against) // QUIET * QUIET].reshape(QUIET, -1).std(axis=1)
    begin = int(parts.argmin()) * (len(against) // QUIET)
    rest = float(run[begin : begin + len(against) // QUIET].mean()), float(parts.min()) / math.sqrt(1.5)
    return Axis(len(y), float(y.mean()), noise, _turns(against, noise, unit), _broken(run, lsb, unit), rest)


def _turns(against: Array, noise: float, unit: str) -> Turns | None:
    """Return the pattern that recurs every 2, 3 or 4 samples; None if there is none.

    Either the mean of the samples or the size of their noise may follow the pattern.

    `against`: each sample minus the mean of its two neighbours, (n,). `noise`: standard deviation of the fast
    noise.
    """
    size = len(against) // TURNS // TURN
    if not size:
        return None
    against = _without_glitches(against)
    for values, share, most in (
        (against, ALTERNATES_SHARE, noise**2),
        (np.abs(against), SCATTER_SHARE**2, float(np.abs(against).mean()) ** 2),
    ):
        parts = values[: TURNS * TURN * size].reshape(TURNS, size, TURN).mean(axis=1)
        for sensors in sorted(ALTERNATES, reverse=True):
            wave = np.exp(2j * np.pi / sensors * np.arange(TURN)) / TURN
            found = parts @ wave
            mean = found.mean()
            error = float((np.abs(found - mean) ** 2).sum()) / (TURNS - 1) / TURNS
            power = float(abs(mean)) ** 2 * (1 if sensors == 2 else 2)
            # Samples minus the mean of their neighbours show the pattern larger than it is. The division
            # gives its true power.
            if values is against:
                power /= (1 - math.cos(2 * math.pi / sensors)) ** 2
            if abs(mean) ** 2 <= ALTERNATES[sensors] * error or power < most * share / 10:
                continue
            what = (
                f"levels that are {2 * math.sqrt(power):.2g} {unit} apart"
                if values is against
                else "ways to scatter"
            )
            return Turns(sensors, power > most * share, what)
    return None


def _without_glitches(against: Array) -> Array:
    """Replace a few outliers and their neighbours by 0.

    Glitches that come once per second could look like a pattern: if the rate is a multiple of the pattern's
    length, each glitch falls on the same place in the pattern. If many samples are outliers, they may be
    those of one of several alternating sensors. Then no sample is replaced.
    """
    size = np.abs(against)
    far = size > GLITCH * median(size)
    if not 0 < far.mean() < GLITCHES:
        return against
    near = far.copy()
    near[1:] |= far[:-1]
    near[:-1] |= far[1:]
    return np.where(near, 0.0, against)


def _alternating(seen: Mapping[str, Axis], h: float) -> Iterator[DataCheck]:
    """Yield the data check on a file in which the rows of several sensors alternate.

    One data check names all axes, since a row holds the samples of all axes.
    """
    found = {name: axis.turns for name, axis in seen.items() if axis.turns is not None}
    if not found:
        return
    name = max(found, key=lambda one: (found[one].severe, found[one].sensors))
    worst, long = found[name], seen[name].samples * h >= ALTERNATES_S
    yield DataCheck(
        "alternates",
        "bad" if worst.severe and long else "warning",
        f"The rows alternate: every {ORDINALS[worst.sensors]} sample is of another kind, since "
        f"{', '.join(found)} alternate between {worst.what}.",
        f"Do these rows hold {worst.sensors} sensors by turns, or are some rows computed from others? Choose "
        f"one sensor (--sensor 1/{worst.sensors} takes the first of {worst.sensors} by turns). If neither is "
        f"so, there is a disturbance at exactly {1 / h / worst.sensors:.4g} Hz.",
    )


def _broken(y: Array, lsb: float | None, unit: str) -> str:
    """Return a sentence if samples jump between groups of values that are far from each other; else ""."""
    some = thin(y)
    ordered = np.sort(some)
    edge = max(int(GROUP_SHARE * len(ordered)), 5)
    steps = np.diff(ordered)
    inner = steps[edge:-edge]
    if not len(inner):
        return ""
    at = edge + int(inner.argmax())
    width, finest = float(steps[at]), float(steps[steps > 0].min())
    if width < GROUP_WIDTH * (ordered[-1] - ordered[0]):
        return ""
    above = y > ordered[at]
    share = float(above.mean())
    jumps = np.count_nonzero(above[1:] != above[:-1]) / (2 * share * (1 - share) * len(y))
    if lsb is not None:
        far = width >= FAR_COUNTS * lsb
    else:
        far = width >= FAR_STEPS * finest or width >= FAR.get(unit, math.inf)
    if jumps < SELDOM or not far:
        return ""
    values = np.unique(some)
    what = (
        f"There are only {len(values)} values, from"
        if len(values) <= 16
        else "The values lie in groups, from"
    )
    return (
        f"{what} {ordered[0]:.4g} to {ordered[-1]:.4g} {unit}, {width:.3g} {unit} apart with nothing "
        "between: no noise of a sensor is like that."
    )


def _gravity(means: Sequence[float]) -> Iterator[DataCheck]:
    """Yield the data check on the magnitude of gravity.

    `means`: means of all axes of an accelerometer [m/s²].
    """
    length = math.hypot(*means)
    if len(means) < len(ACCEL_AXES) or length < LEAST_MS2 or _is_gravity(length):
        return
    shown = f"The accelerometer at rest shows {length:.4g} m/s²; gravity is 9.81."
    for what, factor, flag in UNITS_OF_GRAVITY:
        if _is_gravity(length * factor):
            yield DataCheck("gravity", "bad", f"{shown} {what}", f"Say its unit: {flag}.", ACCEL_AXES)
            return
    yield DataCheck(
        "gravity",
        "warning",
        f"{shown} No usual unit explains this.",
        "Check its scale (--accel-units lsb:N says that N counts are 1 g). Or was the sensor moved?",
        ACCEL_AXES,
    )


def _is_gravity(length: float) -> bool:
    return abs(length / STANDARD_GRAVITY_MS2 - 1) < GRAVITY


def _like_mems(seen: Mapping[str, Axis], h: float, unit: Answer) -> Iterator[DataCheck]:
    """Yield a data check if the assumed unit would make noise or mean at rest too large for a MEMS gyroscope.

    The file does not state this unit; it is only the usual one in files of this kind.
    """
    gyro, accel = ([seen[name] for name in kind.axes if name in seen] for kind in SENSOR_KINDS)
    shakes = math.hypot(*(axis.rest[1] for axis in accel)) > SHAKES * math.hypot(
        *(axis.rest[0] for axis in accel)
    )
    if not gyro or shakes:
        return
    N = float(np.median([axis.rest[1] for axis in gyro])) * math.sqrt(h) * ROOT_HOUR
    mean = max((axis.rest[0] for axis in gyro), key=abs)
    if N > MOST_N or abs(mean) > MOST_MEAN_DPS:
        yield DataCheck(
            "unit",
            "bad",
            f"N is {N:.3g} deg/√h and the mean {mean:.3g} deg/s if the rates are in {unit.value}, as the "
            f"convention of {unit.why} has it; the file does not say so. {USUAL}",
            "Say the unit: --units deg/s, or whichever it is. If the unit that was assumed is right, and the "
            f"sensor was not at rest: --units {unit.value}.",
            tuple(name for name in AXES if name in seen),
        )
