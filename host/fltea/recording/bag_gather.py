"""Collects the messages of one topic of a bag in a temporary file, and makes a recording from them."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from fltea.recording.bag_clock import Judged, Ticks, given_ticks, judged, measured_ticks, stamps_of
from fltea.recording.bag_messages import Batch, Topic, Undecoded
from fltea.recording.bag_names import Layout, title
from fltea.recording.bag_sensors import ALL_ARE_ONE, PUBLISHER, Sensors
from fltea.recording.bag_twice import held_twice
from fltea.recording.bag_units import AtRest, Scale, at_rest, check_rates, measured_accel, scales
from fltea.recording.candidates import units_table
from fltea.recording.columns import Chosen
from fltea.recording.files import AT_ONCE, Note, Recording, Stored, check_span, listed
from fltea.recording.message_stamps import Stamps, Times, is_arrival
from fltea.recording.plausible import is_of_sensor
from fltea.recording.quota import Quota
from fltea.recording.reading import Answer, Missing, NotStated, asked_with, given_options, not_stated
from fltea.recording.sample_store import SampleStore
from fltea.recording.sample_times import Floats, Marks
from fltea.recording.session import LATEST_NS
from fltea.recording.spool import Spool
from fltea.recording.which_unit import Unit
from fltea.records.errors import UsageError
from fltea.records.units import STANDARD_GRAVITY_MS2
from fltea.records.visible import visible
from fltea.settings.how import How

COLUMNS, NUMBERS = ("gyro", "accel", "stamp", "arrival"), 8
"""COLUMNS: columns of the temporary file. NUMBERS: how many numbers these columns together hold for each
sample.
"""

SHOWN = 8 * AT_ONCE
"""A table shows the user what each unit would mean. It is computed from at most this number of samples."""


@dataclass
class MessageCounts:
    """Counts of the messages that gave no sample, and what the messages measured.

    `unusable`: messages that do not have the layout found for the topic. `not_numbers`: messages with a value
    that no sensor gives. `twice`: messages equal to the message before. `in_two_files`: messages that another
    file of the bag holds too. `measured`: contains `gyro` if at least one message says that it measured
    rates, and `accel` likewise.
    """

    unusable: int = 0
    not_numbers: int = 0
    twice: int = 0
    in_two_files: int = 0
    measured: set[str] = field(default_factory=set)

    def problems(self, kind: str) -> list[str]:
        """Return texts that say which messages were left out, and why.

        `kind`: type of the messages; empty if they have none.
        """
        found = [
            (self.unusable, f"do not have the layout of {kind or 'the other messages'} and are left out"),
            (
                self.not_numbers,
                "hold a value that is not a number, or that no sensor gives, and count as missing",
            ),
            (self.twice, "repeat the message before them, and are used once"),
            (
                self.in_two_files,
                "stand in the bag twice, with the same times and numbers (is a file of it copied or linked "
                "under another number, or do files overlap?), and are used once",
            ),
        ]
        return [f"{count} messages {what}" for count, what in found if count]


class Neighbours:
    """Marks rows of numbers that equal the row before them."""

    def __init__(self) -> None:
        self._last: NDArray[np.int64] | None = None

    def repeated(self, rows: Floats) -> Marks:
        """Mark those of the next rows that equal the row before them in all columns.

        The last column holds the stamps.

        Rows without stamps are never marked.
        """
        if not len(rows):
            return np.zeros(0, bool)
        bits = np.ascontiguousarray(rows).view(np.int64)
        before = bits[:1] if self._last is None else self._last
        same: Marks = (bits == np.concatenate([before, bits[:-1]])).all(axis=1) & (bits[:, -1] != 0)
        same[0] &= self._last is not None
        self._last = bits[-1:]
        return same


class Gathered:
    """Collects the messages of one topic of a bag, to make a recording from them.

    `how`: the user's options. `sensor`: the gyroscope to read if a message holds several.
    `quota`: limits of time and memory for decoding the messages.
    """

    def __init__(
        self, path: Path, topic: Topic, layout: Layout, sensor: str | None, how: How, quota: Quota
    ) -> None:
        self._path, self._how = path, how
        self._where = f"{path}: topic {visible(topic.name)}"
        self._topic, self._layout = topic, layout
        self._units = scales(self._where, layout, how)
        self._ticks: Ticks | None = given_ticks(self._where, layout, how)
        rate = self._units.rate
        unit, lsb = ("", None) if rate is None else (rate.said.unit, rate.lsb)
        chosen = Chosen(list(layout.gyro), (0, 1, 2), Unit(unit, 1.0, lsb))
        self._samples = SampleStore(chosen, NUMBERS, quota.limits)
        is_told = layout.by.evidence == "given"
        self._sensors = Sensors(
            self._where, [PUBLISHER, *layout.tell], None if is_told else sensor, layout.others
        )
        self._counts, self._neighbours = MessageCounts(), Neighbours()
        self._undecoded = Undecoded(quota)

    def add(self, batch: Batch, layout: Layout) -> None:
        """Add a batch of messages that have the given layout.

        Messages are kept first, and decoded many at a time.
        """
        if (layout.rate, layout.accel_unit) != (self._layout.rate, self._layout.accel_unit):
            self._counts.unusable += batch.count
            return
        if batch.topic != self._topic:
            self._read_waiting()
            self._topic, self._layout = batch.topic, layout
        self._undecoded.add(batch)
        if len(self._undecoded) >= AT_ONCE:
            self._read_waiting()

    @np.errstate(over="ignore", invalid="ignore")
    def _read_waiting(self) -> None:
        if not len(self._undecoded):
            return
        imu, arrival_ns, by = self._undecoded.decode(self._topic, self._layout)
        counts = self._counts
        counts.unusable += len(by) - len(np.unique(imu.row))
        publishers = self._sensors.publishers(by, arrival_ns)[imu.row]
        imu = imu.rows(self._sensors.keep([publishers, *imu.tell], imu.gyro))
        arrival_ns = arrival_ns[imu.row]
        if self._ticks is None:
            self._ticks = measured_ticks(self._layout, imu.time, arrival_ns)
        stamp_ns = stamps_of(imu.time, self._ticks.seconds)
        factor = 1.0 if self._units.rate is None else self._units.rate.factor
        numbers = is_of_sensor(imu.gyro * factor)
        counts.not_numbers += len(numbers) - int(np.count_nonzero(numbers))
        for name, measured in (("gyro", imu.measured), ("accel", imu.measured_accel)):
            if measured.any():
                counts.measured.add(name)
        rows = np.column_stack([imu.gyro, imu.accel, stamp_ns.view(np.float64)])
        again = self._neighbours.repeated(rows) & numbers
        counts.twice += int(np.count_nonzero(again))
        keep = numbers & ~again
        if keep.any():
            others = {"stamp": stamp_ns[keep], "arrival": arrival_ns[keep]}
            self._samples.add(imu.gyro[keep], imu.accel[keep], others, lambda _: str(self._path), factor)

    def lacks(self) -> str:
        """Return a text on the sensors that the topic has, if the sensor that the user names is missing.

        Return "" if the sensor is present, or if the user names none.
        """
        self._read_waiting()
        return self._sensors.lacks()

    def stored(self, others: list[str], notes: list[Note]) -> Stored:
        """Return the messages as a recording. `others`: other Imu topics. `notes`: warnings about the bag.

        Raises:
            NotStated: there are several sensors and the user names none, or a unit or the rate is missing.
            UsageError: the messages hold no angular rates, or contradict the user's options.
        """
        self._read_waiting()
        several = self._layout.several
        which = (
            Missing(f"which gyroscope is meant of {listed(several)}", "") if several else self._sensors.which
        )
        if which is None:
            return self._stored(others, notes)
        topic = self._how.topic
        what = (
            f"{which.what}{'' if several else f'; {ALL_ARE_ONE} says that all messages are from one sensor'}"
        )
        ask = Missing(what, "--sensor ?" if topic is None else f"--sensor {self._topic.name}:?")
        options = given_options(replace(self._how, topic=None))
        raise asked_with(self._where, ask, options, lambda: self._stored(others, notes))

    def _stored(self, others: list[str], notes: list[Note]) -> Stored:
        self._drop_repeated()
        self._clean_accel()
        n, spool = len(self._samples), self._samples.spool
        self._check(n, others)
        notes += [*self._units.notes, *self._of_messages()]
        clock = self._judged()
        stamps = clock.stamps
        if clock.problems:
            notes.append(Note("bag_stamps", f"{self._where}: {'; '.join(clock.problems)}."))
        rate_hz = 1e9 / stamps.period_ns
        last = int(stamps.sequence(n - 1, n)[0])
        check_span(self._path, rate_hz, n, last / rate_hz)
        if "accel" not in self._samples.moving & self._counts.measured:
            spool.drop("accel")
        rate, accel = self._checked_units(rate_hz)
        reading = self._answers(rate, accel, clock.answer)
        if accel is None:
            spool.drop("accel")
        arrival_ns: Times = spool.whole("arrival")
        start_ns = int(arrival_ns[0])
        sane = bool((arrival_ns > 0).all() and (arrival_ns <= LATEST_NS).all())
        is_arrivals = is_arrival(arrival_ns, stamps.sequence(0, n), stamps.period_ns)
        if clock.by_arrivals or not sane or not is_arrivals:
            spool.drop("arrival")
        lsb = rate.lsb if self._samples.is_whole else None
        factors = (
            rate.factor / (rate.lsb or 1.0) if lsb is None else 1.0,
            1.0 if accel is None else accel.factor,
        )
        blocks = partial(_blocks, spool, stamps, rate_hz, start_ns, factors)
        return Stored(n, rate_hz, lsb, None, blocks, tuple(notes), start_ns if sane else 0, reading=reading)

    def _judged(self) -> Judged:
        columns = (self._samples.spool.whole(name) for name in ("stamp", "arrival"))
        try:
            return judged(self._where, self._layout, self._how, self._ticks, *columns)
        except NotStated as error:
            if self._units.rate is not None:
                raise
            missing = [self._no_unit(), *error.missing]
            raise not_stated(self._where, missing, given_options(self._how), self._table(None)) from error

    def _no_unit(self) -> Missing:
        return Missing(f"the unit of {title(self._layout.gyro)}", "--units ?")

    def _table(self, rate_hz: float | None) -> str:
        return units_table(next(iter(self._samples.spool.blocks(["gyro"], SHOWN)))[0], rate_hz)

    def _checked_units(self, rate_hz: float) -> tuple[Scale, Scale | None]:
        """Return the units of gyroscope and accelerometer, after a check against the values at rest."""
        spool, (rate, accel) = self._samples.spool, self._units[:2]
        there = ["gyro", *(["accel"] if "accel" in spool else [])]
        options = given_options(self._how)
        if rate is None:
            raise not_stated(self._where, [self._no_unit()], options, self._table(rate_hz))
        g = STANDARD_GRAVITY_MS2 / (1.0 if accel is None else accel.factor)
        rest = at_rest(spool.blocks(there, AT_ONCE), rate_hz, g)
        found = AtRest(accel)
        if rest is not None:
            found = measured_accel(self._layout, accel, rest, self._how)
            table = partial(self._table, rate_hz)
            check_rates(self._where, self._layout, rate, rest, found, table, options)
        self._samples.plausible.check(self._where)
        if found.problem:
            raise UsageError(f"{self._where}: {found.problem}")
        return rate, found.scale

    def _answers(self, rate: Scale, accel: Scale | None, clock: Answer) -> tuple[Answer, ...]:
        by, layout = self._layout.by, self._layout
        answers = [
            Answer("columns", title(layout.gyro), by.evidence, by.why),
            Answer("unit", rate.said.unit, rate.said.evidence, rate.said.why),
            clock,
        ]
        if "accel" in self._samples.spool:
            if accel is not None:
                value = f"{title(layout.accel)} in {accel.said.unit}"
                answers.append(Answer("accelerometer", value, accel.said.evidence, accel.said.why))
            else:
                why = f"nothing says the unit of {title(layout.accel)}; --accel-units says it"
                answers.append(Answer("accelerometer", "not read", "missing", why))
        return tuple(answers)

    def _clean_accel(self) -> None:
        """Drop messages with invalid accelerations.

        If most accelerations are invalid, drop all accelerations and no message.
        """
        bad = self._samples.bad_accel.count
        if bad > len(self._samples) // 2:
            self._samples.spool.drop("accel")
        elif bad:
            blocks = self._samples.spool.blocks(["accel"], AT_ONCE)
            self._samples.keep(COLUMNS, (is_of_sensor(accel) for (accel,) in blocks))
            self._counts.not_numbers += bad

    def _drop_repeated(self) -> None:
        """Of messages that the bag holds twice, for instance in two of its files, drop the later one."""
        twice = held_twice(self._samples.spool)
        if twice is not None and twice.any():
            self._counts.in_two_files = int(np.count_nonzero(twice))
            self._samples.bad_accel.count -= self._bad_among(twice)
            self._samples.keep(COLUMNS, (~twice[at : at + AT_ONCE] for at in range(0, len(twice), AT_ONCE)))

    def _bad_among(self, marked: Marks) -> int:
        bad = (~is_of_sensor(accel) for (accel,) in self._samples.spool.blocks(["accel"], AT_ONCE))
        return int(np.count_nonzero(np.concatenate([*bad]) & marked))

    def _check(self, n: int, others: list[str]) -> None:
        instead = f" Other Imu topics of this bag: {', '.join(map(visible, others))}." if others else ""
        if not n:
            kind, counts = visible(self._topic.type) or "its first message", self._counts
            raise UsageError(
                f"{self._where}: none of its messages can be used ({counts.unusable} are not of the layout "
                f"of {kind}, {counts.not_numbers} hold no rates, or larger ones than any gyroscope has)."
                f"{instead}"
            )
        if "gyro" not in self._samples.moving:
            said = (
                "" if "gyro" in self._counts.measured else ", and the messages say that it was not measured"
            )
            raise UsageError(f"{self._where}: the angular velocity is 0 in all {n} messages{said}.{instead}")
        if n < 2:
            raise UsageError(f"{self._where}: one message alone does not show a rate.")

    def _of_messages(self) -> list[Note]:
        problems = self._counts.problems(visible(self._topic.type))
        if self._layout.unread:
            problems.append(f"other fields of a sensor are not read: {listed(self._layout.unread)}")
        if self._samples.bad_accel.count and "accel" not in self._samples.spool:
            problems.append(
                "the acceleration is left out, since most of its values are not numbers, or are "
                "values that no sensor gives"
            )
        return [Note("bag_messages", f"{self._where}: {'; '.join(problems)}.")] if problems else []


def _blocks(
    spool: Spool, stamps: Stamps, rate_hz: float, start_ns: int, factors: tuple[float, float]
) -> Iterator[Recording]:
    """Yield the samples in blocks.

    `factors`: factor that converts the file's rates to deg/s (or counts), and factor that converts its
    accelerations to m/s².
    """
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
