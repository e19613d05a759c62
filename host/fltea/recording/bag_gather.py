"""The messages of one topic of a bag, gathered in a temporary file, as a recording."""

import contextlib
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fltea.recording.bag_imu import Layout, title
from fltea.recording.bag_messages import LONGEST_MESSAGE, Batch, Topic
from fltea.recording.bag_units import (
    OVERRULE,
    Scale,
    at_rest,
    check_rates,
    measured_accel,
    scales,
)
from fltea.recording.candidates import units_table
from fltea.recording.files import AT_ONCE, Note, Recording, Stored, check_span, listed
from fltea.recording.message_stamps import Stamps, Times, even, is_arrival, is_uneven, judge
from fltea.recording.npz_arrays import NUMBER_BYTES
from fltea.recording.reading import Answer, Missing, given_options, not_stated
from fltea.recording.sample_times import SECONDS, Floats, Ints
from fltea.recording.session import LATEST_NS
from fltea.recording.spool import Spool
from fltea.recording.table import is_of_sensor
from fltea.recording.unpack import unpacked_zstd
from fltea.records.errors import UsageError
from fltea.records.units import STANDARD_GRAVITY_MS2
from fltea.records.visible import visible
from fltea.settings.extras import load
from fltea.settings.how import How
from fltea.settings.limits import Limits

COLUMNS, NUMBERS = ("gyro", "accel", "stamp", "arrival"), 8
"""What waits in a temporary file, and how many numbers of each sample that is."""

SHOWN = 8 * AT_ONCE
"""Samples by which candidates for a unit are shown."""

RATE_TOLERANCE = 0.01
"""Between the rate that is given and that of the times."""

CLOCK_TOLERANCE, FEWEST = 0.25, 10
"""Of a sensor's clock against the arrivals of its first messages, and how many tell the unit of its times."""

ZSTD = b"\x28\xb5\x2f\xfd"
"""What a message begins with that was packed by itself."""

NS = 1_000_000_000


class Gathered:
    """Messages of one topic. how: what the user says of them."""

    def __init__(self, path: Path, topic: Topic, layout: Layout, how: How, limits: Limits) -> None:
        self._path, self._how, self._limits = path, how, limits
        self._where = f"{path}: topic {visible(topic.name)}"
        self._topic, self._layout = topic, layout
        self._rate, self._accel, self._notes = scales(self._where, layout, how)
        self._time_s = _given_clock(self._where, layout, how)
        self._clock_by = "" if self._time_s is None else f", in {how.time_unit} as --time-unit says"
        self._is_whole = True
        self._unread: list[Answer] = []
        self._spool = Spool()
        self._waiting: list[tuple[int, bytes]] = []
        self._last: NDArray[np.int64] | None = None
        self._unusable = self._not_numbers = self._twice = 0
        self._moves = self._accel_moves = False
        self._bad_accel = 0
        self._measured = self._measured_accel = False

    def add(self, batch: Batch, layout: Layout) -> None:
        """Take the next messages; they are looked at many at a time. layout: of these."""
        if (layout.rate, layout.accel_unit) != (self._layout.rate, self._layout.accel_unit):
            self._unusable += batch.count
            return
        if batch.topic != self._topic:
            self._look()
            self._topic, self._layout = batch.topic, layout
        self._waiting.extend(zip(batch.arrival_ns, batch.data, strict=True))
        if len(self._waiting) >= AT_ONCE:
            self._look()

    @np.errstate(over="ignore", invalid="ignore")
    def _look(self) -> None:
        if not self._waiting:
            return
        arrivals, data = zip(*self._waiting, strict=True)
        self._waiting.clear()
        messages = list(map(_unpacked, data))
        imu = self._topic.read(messages, self._layout)
        arrival_ns = np.array(arrivals, np.int64)[imu.row]
        if self._time_s is None:
            self._time_s = self._layout.time_s
            if not self._time_s and (found := _measured_clock(imu.time, arrival_ns)):
                self._time_s, self._clock_by = found, ", whose unit the times of arrival tell"
        stamp_ns = _stamp_ns(imu.time, self._time_s)
        factor = 1.0 if self._rate is None else self._rate.factor
        self._unusable += len(messages) - len(np.unique(imu.row))
        numbers = is_of_sensor(imu.gyro * factor)
        self._not_numbers += len(numbers) - int(np.count_nonzero(numbers))
        self._measured |= bool(imu.measured.any())
        self._measured_accel |= bool(imu.measured_accel.any())
        again = self._repeated(np.column_stack([imu.gyro, imu.accel, stamp_ns.view(np.float64)])) & numbers
        self._twice += int(np.count_nonzero(again))
        keep = numbers & ~again
        gyro, accel = imu.gyro[keep], imu.accel[keep]
        self._is_whole &= bool((gyro == np.rint(gyro)).all())
        self._moves |= bool(gyro.any())
        self._accel_moves |= bool(accel.any())
        self._bad_accel += int(np.count_nonzero(~is_of_sensor(accel)))
        size = (self._spool.length("gyro") + len(gyro)) * NUMBERS * NUMBER_BYTES
        if size > self._limits.whole_bytes:
            raise self._limits.whole_too_large(str(self._path), size)
        if len(gyro):
            self._append(gyro, accel, stamp_ns[keep], arrival_ns[keep])

    def _repeated(self, rows: Floats) -> NDArray[np.bool_]:
        """Which are the same as the one before, their stamp included; one that has none is not."""
        if not len(rows):
            return np.zeros(0, bool)
        bits = np.ascontiguousarray(rows).view(np.int64)
        before = bits[:1] if self._last is None else self._last
        same: NDArray[np.bool_] = (bits == np.concatenate([before, bits[:-1]])).all(axis=1) & (
            bits[:, -1] != 0
        )
        same[0] &= self._last is not None
        self._last = bits[-1:]
        return same

    def stored(self, others: list[str], notes: list[Note]) -> Stored:
        """Return all of them as a recording. others: more topics of this kind. notes: on the bag.

        Raises:
            UsageError: they hold no rates, or contradict what is said of them; a unit or the rate is missing.
        """
        self._look()
        self._clean_accel()
        n = self._spool.length("gyro")
        self._check(n, others)
        notes += [*self._notes, *self._of_messages()]
        stamps, times_are_arrivals, clock, problems = self._judged()
        notes += problems
        rate_hz = 1e9 / stamps.period_ns
        last = int(stamps.sequence(n - 1, n)[0])
        check_span(self._path, rate_hz, n, last / rate_hz)
        if not (self._accel_moves and self._measured_accel):
            self._spool.drop("accel")
        rate, accel = self._units(rate_hz)
        arrival_ns: Times = self._spool.whole("arrival")
        start_ns = int(arrival_ns[0])
        sane = bool((arrival_ns > 0).all() and (arrival_ns <= LATEST_NS).all())
        is_arrivals = is_arrival(arrival_ns, stamps.sequence(0, n), stamps.period_ns)
        if times_are_arrivals or not sane or not is_arrivals:
            self._spool.drop("arrival")
        lsb = rate.lsb if self._is_whole else None
        factors = (
            rate.factor / (rate.lsb or 1.0) if lsb is None else 1.0,
            1.0 if accel is None else accel.factor,
        )
        blocks = partial(_blocks, self._spool, stamps, rate_hz, start_ns, factors)
        reading = self._answers(rate, accel, clock)
        return Stored(n, rate_hz, lsb, None, blocks, tuple(notes), start_ns if sane else 0, reading=reading)

    def _units(self, rate_hz: float) -> tuple[Scale, Scale | None]:
        """The units of both sensors, against what the numbers show at rest."""
        there = ["gyro", *(["accel"] if "accel" in self._spool else [])]
        table = partial(units_table, next(iter(self._spool.blocks(["gyro"], SHOWN)))[0], rate_hz)
        options = given_options(self._how)
        if self._rate is None:
            missing = Missing(f"the unit of {title(self._layout.gyro)}", "--units ?")
            raise not_stated(self._where, [missing], options, table())
        accel = self._accel
        g = STANDARD_GRAVITY_MS2 / (1.0 if accel is None else accel.factor)
        rest = at_rest(self._spool.blocks(there, AT_ONCE), rate_hz, g)
        if rest is not None:
            found = measured_accel(self._layout, accel, rest, self._how)
            check_rates(self._where, self._layout, self._rate, rest, found, table, options)
            if found.problem:
                raise UsageError(f"{self._where}: {found.problem}")
            accel = found.scale
        if accel is None and "accel" in self._spool:
            self._spool.drop("accel")
            why = f"nothing says the unit of {title(self._layout.accel)}; --accel-units says it"
            self._unread = [Answer("accelerometer", "not read", "missing", why)]
        return self._rate, accel

    def _answers(self, rate: Scale, accel: Scale | None, clock: Answer) -> tuple[Answer, ...]:
        by, layout = self._layout.by, self._layout
        answers = [
            Answer("columns", title(layout.gyro), by.evidence, by.why),
            Answer("unit", rate.said.unit, rate.said.evidence, rate.said.why),
            clock,
        ]
        if accel is not None and "accel" in self._spool:
            value = f"{title(layout.accel)} in {accel.said.unit}"
            answers.append(Answer("accelerometer", value, accel.said.evidence, accel.said.why))
        return (*answers, *self._unread)

    def _clean_accel(self) -> None:
        """Leave out messages whose acceleration is none; if most are so, leave out the acceleration."""
        if self._bad_accel > self._spool.length("gyro") // 2:
            self._spool.drop("accel")
        elif self._bad_accel:
            before, self._spool = self._spool, Spool()
            for values in before.blocks(COLUMNS, AT_ONCE):
                keep = is_of_sensor(values[1])
                self._append(*(column[keep] for column in values))
            before.close()
            self._not_numbers += self._bad_accel

    def _append(self, *values: NDArray[Any]) -> None:
        for name, column in zip(COLUMNS, values, strict=True):
            self._spool.append(name, column)

    def _check(self, n: int, others: list[str]) -> None:
        instead = f" Other Imu topics of this bag: {', '.join(map(visible, others))}." if others else ""
        if not n:
            kind = visible(self._topic.type) or "its first message"
            raise UsageError(
                f"{self._where}: none of its messages can be used ({self._unusable} are not of the layout of "
                f"{kind}, {self._not_numbers} hold no rates, or larger ones than any gyroscope has).{instead}"
            )
        if not self._moves:
            said = "" if self._measured else ", and the messages say that it was not measured"
            raise UsageError(f"{self._where}: the angular velocity is 0 in all {n} messages{said}.{instead}")
        if n < 2:
            raise UsageError(f"{self._where}: one message alone tells no rate.")

    def _of_messages(self) -> list[Note]:
        found = [
            (self._unusable, f"do not have the layout of {visible(self._topic.type)} and are left out"),
            (
                self._not_numbers,
                "hold a value that is not a number, or that no sensor gives, and count as missing",
            ),
            (self._twice, "are repeated and taken once"),
        ]
        problems = [f"{count} messages {what}" for count, what in found if count]
        if self._layout.unread:
            problems.append(
                f"of two sensors in a message the first is read, and not {listed(self._layout.unread)}"
            )
        if self._bad_accel and "accel" not in self._spool:
            problems.append(
                "the acceleration is left out, since most of its values are not numbers, or no "
                "sensor gives them"
            )
        return [Note("bag_messages", f"{self._where}: {'; '.join(problems)}.")] if problems else []

    def _judged(self) -> tuple[Stamps, bool, Answer, list[Note]]:
        """The stamps or else the arrivals, whether it is these, the rate, and what has to be said of them."""
        stamp_ns: Times = self._spool.whole("stamp")
        arrival_ns: Times = self._spool.whole("arrival")
        given_hz = self._how.rate_hz
        known = bool((np.abs(arrival_ns) <= LATEST_NS).all() and np.ptp(arrival_ns) > 0)
        no_stamps = not np.ptp(stamp_ns)
        source = "times of arrival" if no_stamps else f"stamps of the messages{self._clock_by}"
        problems = [self._without_stamps(stamp_ns)] if no_stamps else []
        try:
            if no_stamps and not known:
                raise ValueError("the stamps do not advance")
            times = arrival_ns if no_stamps else stamp_ns
            stamps = judge(times, arrival_ns if known and not no_stamps else None)
        except ValueError as error:
            if given_hz is None:
                missing = Missing(
                    f"the rate: neither header stamps nor arrivals tell it ({error})", "--rate ?"
                )
                raise not_stated(self._where, [missing], given_options(self._how)) from error
            clock = Answer("clock", f"{given_hz:g} Hz", "given", "--rate")
            return even(1e9 / given_hz), True, clock, []
        problems += _of_stamps(stamps, len(stamp_ns))
        rate_hz = 1e9 / stamps.period_ns
        clock = Answer("clock", f"{rate_hz:.6g} Hz", "measured", f"the {source}")
        if given_hz is not None and abs(rate_hz / given_hz - 1) > RATE_TOLERANCE:
            if not self._how.overrule:
                raise UsageError(
                    f"{self._where}: the {source} are those of {rate_hz:.6g} Hz, and --rate {given_hz:g} "
                    f"says otherwise. Leave --rate out. {OVERRULE}"
                )
            clock = Answer("clock", f"{given_hz:g} Hz", "given", "--rate")
            stamps = stamps._replace(period_ns=1e9 / given_hz)
        text = "; ".join(problems)
        return stamps, no_stamps, clock, [Note("bag_stamps", f"{self._where}: {text}.")] if problems else []

    def _without_stamps(self, stamp_ns: Times) -> str:
        value = "0" if not stamp_ns[0] else "the same"
        what = f"the stamps of all message headers are {value}"
        if self._layout.time and not self._time_s:
            what = f"nothing says the unit of {self._layout.time[0]} (--time-unit ?)"
        return f"{what}, so the times of arrival are taken; gaps and rate are only as good as these"


def _of_stamps(stamps: Stamps, n: int) -> list[str]:
    """What has to be said of stamps."""
    problems = []
    if is_uneven(stamps, n):
        problems.append(
            f"{stamps.uneven} of {n - 1} steps between stamps are more than a fifth off the period of "
            f"{stamps.period_ns * 1e-6:.4g} ms (by {stamps.spread_ns * 1e-6:.3g} ms, root mean square); "
            "the samples are taken as even"
        )
    if stamps.alike:
        problems.append(f"{stamps.alike} stamps are the same as the one before, with other values")
    if stamps.backward:
        problems.append(f"{stamps.backward} stamps run backwards")
    if len(stamps.epoch_row):
        problems.append(f"the clock was set {len(stamps.epoch_row)} times; a new stretch begins at each")
    return problems


def _given_clock(where: str, layout: Layout, how: How) -> tuple[float, ...] | None:
    """Seconds in one of the times, if the user says it; None: the messages have to tell.

    Raises:
        UsageError: the messages say otherwise, or have no times.
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
        raise UsageError(
            f"{where}: one in {layout.time[0]} is {layout.time_s[0]:g} s by its name, type or schema, and "
            f"--time-unit {how.time_unit} says otherwise. Leave --time-unit out. {OVERRULE}"
        )
    return given


def _measured_clock(time: Floats, arrival_ns: Ints) -> tuple[float, ...]:
    """Seconds in one of the times, by the arrivals of the same messages; empty: they do not tell it."""
    if time.shape[1] != 1 or len(time) < FEWEST:
        return ()
    span, arrival_s = np.ptp(time[:, 0]), np.ptp(arrival_ns) * 1e-9
    found = [s for s in SECONDS.values() if abs(span * s - arrival_s) < CLOCK_TOLERANCE * arrival_s]
    return (found[0],) if len(found) == 1 else ()


def _stamp_ns(time: Floats, time_s: Sequence[float]) -> Ints:
    """Nanoseconds, whole ones of each part; 0 where there are no times, or none that can be."""
    stamp_ns = np.zeros(len(time), np.int64)
    for part, unit_s in zip(time.T, time_s, strict=False):
        one_ns = round(unit_s * NS)
        sane = np.abs(np.where(np.isnan(part), np.inf, part)) < LATEST_NS / one_ns
        whole = np.where(sane, np.trunc(part), 0.0)
        rest = np.where(sane, part, 0.0) - whole
        stamp_ns += whole.astype(np.int64) * one_ns + np.rint(rest * one_ns).astype(np.int64)
    return stamp_ns


def _unpacked(message: bytes) -> bytes:
    if not message.startswith(ZSTD):
        return message
    zstandard = load("zstandard", "zstandard", "ros", "Bags that are packed in zstd need")
    with contextlib.suppress(zstandard.ZstdError):
        return unpacked_zstd(message, LONGEST_MESSAGE)
    return b""


def _blocks(
    spool: Spool, stamps: Stamps, rate_hz: float, start_ns: int, factors: tuple[float, float]
) -> Iterator[Recording]:
    """The samples, a block at a time. factors: from the file's numbers to deg/s or counts, and to m/s²."""
    names = [name for name in ("gyro", "accel", "arrival") if name in spool]
    row = 0
    for values in spool.blocks(names, AT_ONCE):
        found = dict(zip(names, values, strict=True))
        end = row + len(found["gyro"])
        seq = stamps.sequence(row, end)
        yield Recording(
            found["gyro"] * factors[0],
            rate_hz,
            seq / rate_hz,
            host_s=(found["arrival"] - start_ns) * 1e-9 if "arrival" in found else None,
            accel_ms2=found["accel"] * factors[1] if "accel" in found else None,
            seq=seq,
            epoch=stamps.epoch(row, end),
        )
        row = end
