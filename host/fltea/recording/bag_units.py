"""Finds the units of a bag's numbers. Stated units are compared with the values that the sensor has at rest.

Some drivers break ROS's conventions and write deg/s instead of rad/s, or g instead of m/s². At rest, the
length of gravity shows the accelerometer's unit. The noise of MEMS gyroscopes is in a known range, so it
shows the gyroscope's unit: rad/s and deg/s differ by a factor of 57.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from fltea.recording.bag_names import Layout, Said, title
from fltea.recording.candidates import MOST_MEAN_DPS, MOST_N, gravity_units
from fltea.recording.files import Note
from fltea.recording.reading import Missing, given_options, not_stated, says_otherwise
from fltea.recording.sample_times import Floats
from fltea.recording.units import parse_accel_unit, parse_units
from fltea.records.errors import UsageError
from fltea.records.units import SQRT_HOUR
from fltea.settings.how import How

CLUSTER_S, CLUSTERS, FEWEST = 0.1, 16, 8
"""CLUSTER_S is the time over which means are taken [s]. A stretch of time has at most CLUSTERS and at least
FEWEST such means.

Means over 0.1 s show the noise density N even if a low-pass filter removes the noise of single samples.
"""

QUIET = 0.1
"""This fraction of all stretches of time, those with the least noise, is taken as rest."""

MOVING = 0.05
"""The sensor counts as at rest if σ of the accelerations is at most this proportion of gravity."""


class Scale(NamedTuple):
    """A unit with its evidence, and its factor to deg/s or m/s².

    `lsb`: for counts, the number of counts in 1 deg/s or 1 g, else None.
    """

    said: Said
    factor: float
    lsb: float | None


class Scales(NamedTuple):
    """Units of gyroscope and accelerometer, None if unknown, and notes for the user about them."""

    rate: Scale | None
    accel: Scale | None
    notes: list[Note]


Parse = Callable[[str], tuple[float, float | None]]


def scales(where: str, layout: Layout, how: How) -> Scales:
    """Return the units of gyroscope and accelerometer.

    Raises:
        UsageError: the user's unit contradicts what the file states, or is unknown.
    """
    notes: list[Note] = []

    def accepted(
        names: Sequence[str], said: Said | None, given: str | None, option: str, parse: Parse
    ) -> Scale | None:
        if said is not None and said.against and not (how.overrule and given):
            raise UsageError(
                f"{where}: {title(names)} are in {said.unit} by {said.why}, and in {said.against}. Say which "
                f"is right: {option} ? --overrule"
            )
        if given is None:
            return None if said is None else Scale(said, *parse(said.unit))
        found = Scale(Said(given, "given", option), *parse(given))
        if said is not None and parse(said.unit) != found[1:]:
            if said.evidence == "stated" and not how.overrule:
                fact = f"{title(names)} are in {said.unit} by {said.why}"
                raise says_otherwise(where, fact, option, given)
            text = (
                f"{title(names)} are read in {given}, as {option} says; by {said.why} they are in {said.unit}"
            )
            notes.append(Note("reading", f"{where}: {text}."))
        return found

    changed = "" if how.overrule else layout.changed
    if changed and how.units is None:
        what = f"the unit of {title(layout.gyro)}, to which {changed} may still have to be applied"
        raise not_stated(where, [Missing(what, "--units ? --overrule")], given_options(how))
    if changed and how.units is not None and parse_units(how.units)[1] is None:
        raise UsageError(
            f"{where}: {title(layout.gyro)} may have to be changed by {changed}, and --units {how.units} "
            f"does not say whether that was done. If they are in {how.units} as they stand, add --overrule."
        )
    rate = accepted(layout.gyro, layout.rate, how.units, "--units", parse_units)
    if how.accel_units is not None and not layout.accel:
        raise UsageError(f"{where}: --accel-units is given, and its messages have no accelerometer.")
    accel = accepted(layout.accel, layout.accel_unit, how.accel_units, "--accel-units", parse_accel_unit)
    return Scales(rate, accel, notes)


class Rest(NamedTuple):
    """Values at rest, in the file's units.

    `mean`: mean rates (3,). `noise`: σ that the white noise of the rates has in means over 1 s (3,).
    `gravity`: mean accelerations of each stretch of time (n, 3). `moves`: whether the sensor moves even in
    the quietest stretches.
    """

    mean: Floats
    noise: Floats
    gravity: Floats
    moves: bool


def at_rest(blocks: Iterable[Sequence[Floats]], rate_hz: float, g: float) -> Rest | None:
    """Return the values in the stretches of time with the least motion; None if there are too few samples.

    `blocks`: rates (n, 3), and accelerations (n, 3) or nothing. `g`: gravity in the unit of the
    accelerations.
    """
    noise, means, gravity, shakes = [], [], [], []
    for gyro, *accel in blocks:
        size = max(1, min(round(rate_hz * CLUSTER_S), len(gyro) // FEWEST))
        count = len(gyro) // size
        clusters = min(CLUSTERS, count)
        if clusters < FEWEST:
            continue
        whole = count // clusters
        rows = whole * clusters * size
        groups = gyro[:rows].reshape(whole, clusters, size, 3).mean(axis=2)
        noise.append(np.sqrt((np.diff(groups, axis=1) ** 2).mean(axis=1) / 2 * size / rate_hz))
        means.append(groups.mean(axis=1))
        for one in accel:
            parts = one[:rows].reshape(whole, clusters * size, 3)
            length, spread = (
                np.linalg.norm(parts.mean(axis=1), axis=1),
                np.linalg.norm(parts.std(axis=1), axis=1),
            )
            shakes.append(spread > MOVING * np.where(length > spread, length, g))
            gravity.append(parts.mean(axis=1))
    if not noise:
        return None
    noises = np.concatenate(noise)
    order = np.argsort(np.median(noises, axis=1))
    quiet = order[: math.ceil(QUIET * len(order))]
    moves = bool(np.concatenate(shakes)[quiet].mean() > 1 / 2) if shakes else False
    mean = np.median(np.concatenate(means)[quiet], axis=0)
    of_gravity = np.concatenate(gravity) if gravity else np.empty((0, 3))
    return Rest(mean, np.median(noises[quiet], axis=0), of_gravity, moves)


class AtRest(NamedTuple):
    """Result of the comparison of an accelerometer with gravity.

    `scale`: the accelerometer's unit, None if unknown. `problem`: text about a contradiction, if there is
    one. `option`: command-line option that resolves the contradiction.
    """

    scale: Scale | None
    problem: str = ""
    option: str = ""


def measured_accel(layout: Layout, accel: Scale | None, rest: Rest, how: How) -> AtRest:
    """Compare the accelerometer's unit with the length of gravity, or derive an unknown unit from it."""
    units = gravity_units(rest.gravity) if len(rest.gravity) else []
    if not units or not layout.accel:
        return AtRest(accel)
    measured = [
        Scale(Said(unit, "measured", "gravity has this length"), *parse_accel_unit(unit)) for unit in units
    ]
    if accel is None:
        return AtRest(measured[0] if len(measured) == 1 else None)
    if how.overrule or any(math.isclose(accel.factor, one.factor, rel_tol=0.2) for one in measured):
        return AtRest(accel)
    length = float(np.median(np.linalg.norm(rest.gravity, axis=1)))
    said = accel.said
    unit, which = " or ".join(units), units[0] if len(units) == 1 else "?"
    option = f"--accel-units {which}{' --overrule' if said.evidence == 'stated' else ''}"
    problem = (
        f"{title(layout.accel)} have the length {length:.4g} at rest, which is gravity in {unit}; in "
        f"{said.unit}, as {said.why} has it, that is {length * accel.factor:.3g} m/s². If they hold gravity, "
        f"add {option}; else add --accel-units {said.unit} --overrule."
    )
    return AtRest(accel, problem, option)


def check_rates(
    where: str,
    layout: Layout,
    rate: Scale,
    rest: Rest,
    accel: AtRest,
    table: Callable[[], str],
    options: Sequence[str],
) -> None:
    """Check that the rates' noise and mean at rest are a gyroscope's, if only a convention gives their unit.

    `accel`: result of the comparison of the accelerometer with gravity, for the error message. `table`:
    function that returns the table of candidate units for this message. `options`: the user's options.

    Raises:
        NotStated: no gyroscope has such a noise or such a mean in this unit.
    """
    if rate.said.evidence != "convention" or rest.moves:
        return
    N = float(np.median(rest.noise)) * SQRT_HOUR * rate.factor
    mean_dps = float(np.abs(rest.mean).max()) * rate.factor
    if N > MOST_N or mean_dps > MOST_MEAN_DPS:
        what = (
            f"the unit of {title(layout.gyro)}: it would be {rate.said.unit} by {rate.said.why}, but at rest "
            f"N would be {N:.3g} deg/√h and the mean {mean_dps:.3g} deg/s, and drivers break this convention"
        )
        missing = Missing(what, f"--units ? {accel.option}".rstrip())
        raise not_stated(where, [missing], options, "\n".join(filter(None, [table(), accel.problem])))
