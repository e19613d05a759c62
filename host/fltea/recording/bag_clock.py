"""Chooses the clock of a ROS bag (header stamps or arrival times), and finds its unit and sampling rate."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fltea.recording.bag_names import Layout
from fltea.recording.message_stamps import AROUND, Stamps, Times, even, is_uneven, judge
from fltea.recording.reading import OVERRULE, Answer, Missing, given_options, not_stated, says_otherwise
from fltea.recording.sample_times import SECONDS, Floats, Ints
from fltea.recording.session import LATEST_NS
from fltea.recording.split_times import are_parts
from fltea.recording.timing import POSSIBLE_HZ, check_given
from fltea.records.errors import UsageError
from fltea.settings.how import How

RATE_TOLERANCE = 0.01
"""The rate that the user gives may differ from the rate that the times show by at most this proportion."""

CLOCK_TOLERANCE, FEWEST = 0.25, 10
"""Arrival times show the stamps' unit if there are at least FEWEST messages. In the right unit, the stamps
span the same time as the arrivals, to within the proportion CLOCK_TOLERANCE.
"""

OTHER_UNITS = 1e-9, 1e-6, 1e-3, 1e3, 1e6, 1e9
"""Factors by which a sampling rate is wrong if the times are read in a wrong unit."""

NS = 1_000_000_000


class Ticks(NamedTuple):
    """Unit of the time stamps in the messages.

    `seconds`: unit of each number that a stamp consists of [s], such as 1 and 1e-9; empty if unknown.

    `by`: text for the user that says where the unit comes from.
    """

    seconds: tuple[float, ...]
    by: str = ""


def given_ticks(where: str, layout: Layout, how: How) -> Ticks | None:
    """Return the unit of the time stamps if the user gives it; None if it has to be found from the messages.

    Raises:
        UsageError: the messages contradict the user's unit, or have no time stamps.
    """
    if how.time_unit is None:
        return None
    given = (SECONDS[how.time_unit],)
    if len(layout.time) != 1:
        why = f"are seconds and parts of them by their type: {', '.join(layout.time)}"
        raise UsageError(
            f"{where}: --time-unit is given, and the times {why if layout.time else 'are not there'}."
        )
    if layout.time_s and layout.time_s != given and not how.overrule:
        fact = f"one in {layout.time[0]} is {layout.time_s[0]:g} s by its name, type or schema"
        raise says_otherwise(where, fact, "--time-unit", how.time_unit)
    return Ticks(given, f", in {how.time_unit} as --time-unit says")


def measured_ticks(layout: Layout, time: Floats, arrival_ns: Ints) -> Ticks:
    """Return the unit of the time stamps that the file states, or else the unit that arrival times show.

    The second of two numbers may be another complete time instead of a part of the first. Then it is not
    used.
    """
    if len(layout.time_s) == 2 and not are_parts(time[:, 0], time[:, 1] * layout.time_s[1]):
        return Ticks(layout.time_s[:1])
    if layout.time_s or time.shape[1] != 1 or len(time) < FEWEST:
        return Ticks(layout.time_s)
    span, arrival_s = np.ptp(time[:, 0]), np.ptp(arrival_ns) * 1e-9
    found = [s for s in SECONDS.values() if abs(span * s - arrival_s) < CLOCK_TOLERANCE * arrival_s]
    return Ticks((found[0],), ", whose unit the times of arrival tell") if len(found) == 1 else Ticks(())


def stamps_of(time: Floats, time_s: Sequence[float]) -> Ints:
    """Return the stamps in nanoseconds, computed exactly. `time_s`: unit of each column of `time` [s].

    A stamp is 0 if the time is missing or impossible.
    """
    stamp_ns = np.zeros(len(time), np.int64)
    for part, unit_s in zip(time.T, time_s, strict=False):
        one_ns = round(unit_s * NS)
        sane = np.abs(np.where(np.isnan(part), np.inf, part)) < LATEST_NS / one_ns
        whole = np.where(sane, np.trunc(part), 0.0)
        rest = np.where(sane, part, 0.0) - whole
        stamp_ns += whole.astype(np.int64) * one_ns + np.rint(rest * one_ns).astype(np.int64)
    return stamp_ns


class Judged(NamedTuple):
    """The clock that was chosen for a topic, and warnings about it.

    `by_arrivals`: whether arrival times are used instead of stamps. `problems`: warnings for the user.
    """

    stamps: Stamps
    by_arrivals: bool
    answer: Answer
    problems: list[str]


def judged(
    where: str, layout: Layout, how: How, ticks: Ticks | None, stamp_ns: Times, arrival_ns: Times
) -> Judged:
    """Choose the header stamps or, if they are unusable, the arrival times as the clock of the samples.

    The user's options about rate and unit must agree with the chosen clock.

    Raises:
        NotStated: neither stamps nor arrival times show the sampling rate.
        UsageError: the stamps contradict the user's rate or the arrival times, or show a sampling rate that
            no gyroscope has.
    """
    given_hz = how.rate_hz
    known = bool((np.abs(arrival_ns) <= LATEST_NS).all() and np.ptp(arrival_ns) > 0)
    alike = _alike(stamp_ns)
    no_stamps = not np.ptp(stamp_ns) or alike > AROUND
    problems = [_without_stamps(layout, ticks, stamp_ns, alike)] if no_stamps else []
    if given_hz is not None:
        check_given(where, given_hz, overrule=how.overrule)
    try:
        if no_stamps and not known:
            raise ValueError("the stamps do not advance")
        times = arrival_ns if no_stamps else stamp_ns
        stamps = judge(times, arrival_ns if known and not no_stamps else None)
        if no_stamps and not _is_possible(stamps):
            raise ValueError(f"the arrivals are {stamps.period_ns / NS:.3g} s apart")
    except ValueError as error:
        if given_hz is None:
            missing = Missing(f"the rate: neither header stamps nor arrivals tell it ({error})", "--rate ?")
            raise not_stated(where, [missing], given_options(how)) from error
        return Judged(even(NS / given_hz), True, Answer("clock", f"{given_hz:g} Hz", "given", "--rate"), [])
    if not (no_stamps or how.overrule):
        _check_stamps(where, layout, how, ticks, stamps, arrival_ns if known else None)
    problems += _of_stamps(stamps, len(stamp_ns))
    rate_hz = NS / stamps.period_ns
    source = "times of arrival" if no_stamps else f"stamps of the messages{ticks.by if ticks else ''}"
    answer = Answer("clock", f"{rate_hz:.6g} Hz", "measured", f"the {source}")
    if given_hz is not None and abs(rate_hz / given_hz - 1) > RATE_TOLERANCE:
        if not how.overrule:
            fact = f"the {source} are those of {rate_hz:.6g} Hz"
            raise says_otherwise(where, fact, "--rate", f"{given_hz:g}")
        answer = Answer("clock", f"{given_hz:g} Hz", "given", "--rate")
        stamps = stamps._replace(period_ns=NS / given_hz)
    return Judged(stamps, no_stamps, answer, problems)


def _is_possible(stamps: Stamps) -> bool:
    return POSSIBLE_HZ[0] <= NS / stamps.period_ns <= POSSIBLE_HZ[1]


def _check_stamps(
    where: str, layout: Layout, how: How, ticks: Ticks | None, stamps: Stamps, arrival_ns: Times | None
) -> None:
    """Raise UsageError if no gyroscope has the stamps' sampling rate, or if arrivals show another unit."""
    why = ""
    if arrival_ns is not None and len(arrival_ns) >= FEWEST:
        last = float(stamps.sequence(len(arrival_ns) - 1, len(arrival_ns))[0])
        ratio = stamps.period_ns * last / float(np.ptp(arrival_ns))
        if any(abs(ratio * off - 1) < CLOCK_TOLERANCE for off in OTHER_UNITS):
            why = f"by the times of arrival it is {ratio * NS / stamps.period_ns:.6g} Hz"
    if not why and not _is_possible(stamps):
        why = "no gyroscope has that"
    if why:
        is_given = ticks is not None and how.time_unit is not None
        remedy = "Leave --time-unit out." if is_given else "Say which is right:"
        if not is_given:
            option = "--time-unit ?" if len(layout.time) == 1 else "--rate ?"
            remedy = f"{remedy} {option} --overrule"
        raise UsageError(
            f"{where}: by the stamps of the messages{ticks.by if ticks else ''} the rate is "
            f"{NS / stamps.period_ns:.6g} Hz, and {why}. {remedy}{f' {OVERRULE}' if is_given else ''}"
        )


def _alike(stamp_ns: Times) -> int:
    """Return how many stamps in a row are usually the same."""
    ends = np.flatnonzero(np.diff(stamp_ns))
    return int(np.median(np.diff([-1, *ends, len(stamp_ns) - 1])))


def _without_stamps(layout: Layout, ticks: Ticks | None, stamp_ns: Times, alike: int) -> str:
    value = "0" if not stamp_ns[0] else "the same"
    what = f"the stamps of all message headers are {value}"
    if alike < len(stamp_ns):
        what = f"some {alike} stamps in a row are the same"
    if not layout.time:
        what = "no field of the messages is known as their time"
    elif not (ticks and ticks.seconds):
        what = f"nothing says the unit of {layout.time[0]} (--time-unit ?)"
    return f"{what}, so the times of arrival are used; gaps and rate are only as good as these times"


def _of_stamps(stamps: Stamps, n: int) -> list[str]:
    """Return what is wrong with the stamps of `n` messages, as warnings for the user."""
    problems = []
    if is_uneven(stamps, n):
        problems.append(
            f"{stamps.uneven} of {n - 1} steps between stamps differ from the period of "
            f"{stamps.period_ns * 1e-6:.4g} ms by more than a fifth (root mean square of all differences: "
            f"{stamps.spread_ns * 1e-6:.3g} ms); the samples are taken as even"
        )
    if stamps.alike:
        problems.append(f"{stamps.alike} stamps are the same as the one before, with other values")
    if stamps.backward:
        problems.append(f"{stamps.backward} stamps run backwards")
    if len(stamps.epoch_row):
        problems.append(
            f"the clock was set {len(stamps.epoch_row)} times; a new stretch of samples begins each time"
        )
    return problems
