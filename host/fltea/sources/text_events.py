"""Turns text that arrives live into events: samples with sequence numbers, and warnings for the user."""

import os
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise

import numpy as np

from fltea.recording.columns import Chosen
from fltea.recording.plausible import ENOUGH_ROWS, Plausible, is_of_sensor
from fltea.recording.sample_times import Floats
from fltea.recording.table import Rows, Samples, samples_of
from fltea.recording.text_numbers import REASONS
from fltea.recording.text_rows import TextReader
from fltea.recording.timing import check_given
from fltea.recording.units import parse_units
from fltea.records.errors import Implausible, UsageError
from fltea.records.events import (
    SEQUENCE_WRAP,
    TIME_WRAP_US,
    Event,
    Failed,
    LinkDown,
    RawBlock,
    Tick,
    Trouble,
)
from fltea.records.records import Hello
from fltea.records.repeat import OnceAMinute
from fltea.records.stats import LinkStats
from fltea.settings.how import How
from fltea.sources.arrival_watch import ArrivalWatch
from fltea.sources.numbering import Arrived, ByOrder, ByTime, Numbered
from fltea.sources.silence import PATIENCE_NS, Silence

LONGEST_BLOCK_US = TIME_WRAP_US // 4
"""Longest duration of a block of samples [µs]. Within a block the device time must not wrap around, but at a
low sampling rate, one read may contain samples of several hours.
"""

FEW_LINES = 20
"""The user is warned if the input begins with this many lines that are neither a sample nor a header. A
sender may write a few such lines first.
"""


class Counts:
    """Numbers of samples, bytes, connections and reported notes on the text since the beginning."""

    def __init__(self) -> None:
        self.samples = self.bytes = self.connections = self.notes = 0


class LeftOut:
    """The rows of numbers that are no sample and were left out.

    `counts`: their number, by reason. `newest`: text about the last one. `told`: how many lines without a
    sample there were in total when such lines were last reported.
    """

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.newest = ""
        self.told = 0

    def add(self, found: Mapping[str, tuple[int, int]]) -> None:
        """Count rows that are no sample. `found`: for each reason, the first such row and their number."""
        for reason, (line, count) in found.items():
            self.counts[reason] += count
            self.newest = f"line {line} {REASONS[reason]}"


class Introduction:
    """Knows when a HELLO is due, and the boot that it names. `is_due`: whether it is due before a sample."""

    def __init__(self) -> None:
        self.boot_id = int.from_bytes(os.urandom(4), "big")
        self.is_due = False

    def reboot(self) -> None:
        """Let the next HELLO name another boot, since the sender restarted or its samples have other axes."""
        self.boot_id = (self.boot_id + 1) % (1 << 32)
        self.is_due = True


class Reports:
    """Reports troubles of the input, each kind once a minute. `fatal`: whether they are fatal."""

    def __init__(self, *, fatal: bool) -> None:
        self._fatal = fatal
        self._reported = OnceAMinute()
        self._has_uneven = False

    def is_due(self, kind: str, now_ns: int) -> bool:
        """Return whether troubles of a kind may be reported now. If so, they then wait for a minute."""
        return self._reported.is_due(kind, now_ns)

    def report(self, kind: str, text: str | Callable[[], str], now_ns: int) -> Iterator[Trouble]:
        """Report a trouble. `text`: may be a function, which is called only if the report is due."""
        if self.is_due(kind, now_ns):
            yield Trouble(kind, text if isinstance(text, str) else text(), now_ns, self._fatal)

    def uneven(self, text: str, now_ns: int) -> Iterator[Trouble]:
        """Report once that the times of the samples are uneven."""
        if not self._has_uneven:
            self._has_uneven = True
            yield Trouble("row_times", text, now_ns, fatal=False)


class TextEvents:
    """Turns text that arrives live into events.

    `url`: name of the source for messages. `how`: what the user states about columns and times. `fatal`:
    whether a loss of the input, silence or a lack of samples is a fatal trouble.

    Raises:
        UsageError: the settings are wrong.
    """

    def __init__(self, url: str, how: How, *, fatal: bool) -> None:
        self.url = url
        parse_units(how.units or "deg/s")
        if how.rate_hz is not None:
            check_given(self._where, how.rate_hz, overrule=how.overrule)
        self.reader = TextReader(self._where, how)
        self._numbers: ByOrder | ByTime | None = None
        self._watch: ArrivalWatch | None = None
        self._plausible: Plausible | None = None
        self._left_out = LeftOut()
        self._reports = Reports(fatal=fatal)
        self._introduction = Introduction()
        self._counts = Counts()
        self._silence: Silence | None = None
        self._begins = False
        self._has_accel = True

    @property
    def _where(self) -> str:
        """Name of the source in messages about its text."""
        return self.url.removesuffix(":")

    @property
    def has_clock(self) -> bool:
        """Whether the samples are numbered by their times; False until the columns are known."""
        return self._numbers is not None and self._numbers.has_clock

    def open(self, now_ns: int, *, within_line: bool) -> None:
        """Note that the input was opened. `within_line`: whether its first bytes may be the end of a line."""
        self._counts.connections += 1
        self._introduction.is_due = True
        self._silence = Silence(now_ns)
        self.reader.resume(within_line=within_line)
        if self._numbers is not None:
            self._numbers.begin()

    def lost(self, failed: Failed) -> Iterator[Event]:
        """Yield the events that report that the input was lost or cannot be opened."""
        self._silence = None
        yield LinkDown(failed.host_ns)
        yield from self._reports.report(failed.kind, failed.message, failed.host_ns)

    def feed(self, data: bytes, now_ns: int) -> Iterator[Event]:
        """Yield the events of the bytes that came next.

        Raises:
            UsageError: the text has named columns, but it is unclear which of them are the rates, or in which
            units.
        """
        self._counts.bytes += len(data)
        if self._silence is not None:
            self._silence.heard(now_ns)
        yield from self._take(self.reader.feed(data), now_ns)
        yield from self._report_lines(now_ns)

    def tick(self, now_ns: int) -> Iterator[Event]:
        """Yield the events that are due although no bytes came."""
        yield Tick(now_ns)
        if self._silence is not None and self._silence.lasts(now_ns):
            text = f"{self.url}: nothing came for {PATIENCE_NS // 10**9} s; does the sender run?"
            yield from self._reports.report("silent", text, now_ns)

    def close(self, now_ns: int) -> Iterator[Event]:
        """Yield the events of samples that wait until their rate is known. No further text is read."""
        if self._numbers is not None:
            yield from self._blocks(self._numbers, self._numbers.finish(), now_ns)

    def finish(self, now_ns: int) -> Iterator[Event]:
        """Yield the events that are still due at the end of the input.

        Raises:
            UsageError: the input contained no sample.
        """
        yield from self._take(self.reader.finish(), now_ns)
        yield from self.close(now_ns)
        if not self._counts.samples:
            why = self._why_none()
            raise UsageError(f"{self._where}: the input has ended, and no sample was in it. {why}")
        yield from self._report_lines(now_ns)
        if self.reader.cut is not None:
            yield Trouble(*self.reader.cut, now_ns, fatal=False)

    def link_stats(self, overflow_bytes: int = 0) -> LinkStats:
        """Return the counts. Lines with a sample count as frames, and lines without a sample as bad ones."""
        bad = dict(self.reader.bad.counts + self._left_out.counts)
        if self.reader.partial:
            bad["partial"] = self.reader.partial
        if self._numbers is not None and self._numbers.duplicates:
            bad["duplicate_time"] = self._numbers.duplicates
        if self._numbers is not None and self._numbers.unrated:
            bad["no_rate"] = self._numbers.unrated
        return LinkStats(
            bytes=self._counts.bytes,
            frames=self._counts.samples,
            bad_frames=bad,
            overflow_bytes=overflow_bytes,
            reconnects=max(0, self._counts.connections - 1),
        )

    def _take(self, found: list[Rows], now_ns: int) -> Iterator[Event]:
        chosen = self.reader.chosen
        if chosen is None or not found:
            return
        if self._numbers is None:
            yield from self._set_up(chosen, now_ns)
        yield from self._tell_notes(now_ns)
        assert self._numbers is not None
        for rows in found:
            samples = samples_of(rows, chosen)
            self._begins |= rows.begins
            self._left_out.add(samples.left_out)
            if not len(samples.gyro):
                continue
            values = samples.gyro
            if self._plausible is not None:
                self._judge_gyro(self._plausible, values)
            if samples.accel is not None:
                yield from self._judge_accel(samples, now_ns)
                values = np.hstack([values, samples.accel])
            arrived = Arrived(values, samples.time, samples.ordinal, self._begins)
            self._begins = False
            yield from self._blocks(self._numbers, self._numbers.add(arrived, now_ns), now_ns)

    def _set_up(self, chosen: Chosen, now_ns: int) -> Iterator[Event]:
        """Choose how samples are numbered, now that the columns of the text are known."""
        if chosen.time is None:
            # `choose` has refused the columns if there are neither times nor a rate
            assert chosen.rate.hz is not None
            self._numbers = ByOrder(chosen.rate.hz)
            self._watch = ArrivalWatch(self.url, chosen.rate.hz)
        else:
            self._numbers = ByTime(self._where, chosen.times)
        self._plausible = Plausible(chosen)
        yield from self._tell_notes(now_ns)
        for note in chosen.notes:
            yield Trouble(note.kind, note.text, now_ns, fatal=False)

    def _tell_notes(self, now_ns: int) -> Iterator[Event]:
        """Yield each note on the text that was not reported yet. Later lines may add some."""
        notes = self.reader.notes[self._counts.notes :]
        self._counts.notes += len(notes)
        for note in notes:
            yield Trouble(note.kind, note.text, now_ns, fatal=False)

    def _judge_gyro(self, plausible: Plausible, gyro: Floats) -> None:
        """Check the first samples. Their values may show that a column or unit is wrong.

        Raises:
            Implausible: no gyroscope gives numbers like those of the samples.
        """
        plausible.add(gyro)
        try:
            plausible.check(self._where)
        except Implausible as error:
            raise self.reader.with_columns(error) from None
        if plausible.rows >= ENOUGH_ROWS:
            self._plausible = None

    def _judge_accel(self, samples: Samples, now_ns: int) -> Iterator[Event]:
        """Leave the accelerometer out, from the first sample without acceleration on. Yield a warning."""
        assert samples.accel is not None
        if not self._has_accel or is_of_sensor(samples.accel).all():
            return
        self._has_accel = False
        self._introduction.reboot()
        text = f"{self.url}: a line holds no acceleration, so the accelerometer is left out from now on."
        yield Trouble("missing_numbers", text, now_ns, fatal=False)

    def _blocks(self, numbers: ByOrder | ByTime, pieces: Iterator[Numbered], now_ns: int) -> Iterator[Event]:
        for piece in pieces:
            if piece.begins:
                self._introduction.reboot()
            if self._introduction.is_due:
                self._introduction.is_due = False
                yield self._hello(numbers, now_ns)
                if self._watch is not None:
                    self._watch.begin()
            yield from self._of_piece(piece)
            found = self._watch.add(int(piece.device_us[-1]), now_ns) if self._watch is not None else None
            if found is not None:
                yield found
        if numbers.unrated and numbers.rate_hz is None and isinstance(numbers, ByTime):
            text = f"{numbers.why_no_rate} {numbers.unrated} samples are left out so far."
            yield from self._reports.report("no_rate", text, now_ns)
        elif numbers.uneven:
            yield from self._reports.uneven(numbers.uneven, now_ns)

    def _of_piece(self, piece: Numbered) -> Iterator[RawBlock]:
        assert self.reader.chosen is not None
        axes = len(self.reader.chosen.gyro)
        self._counts.samples += len(piece.sequence)
        accel = piece.values[:, axes:] if self._has_accel and piece.values.shape[1] > axes else None
        sequence, device_us = piece.sequence % SEQUENCE_WRAP, piece.device_us % TIME_WRAP_US
        raw = RawBlock(sequence, device_us, piece.host_ns, piece.values[:, :axes], accel)
        if piece.device_us[0] // LONGEST_BLOCK_US == piece.device_us[-1] // LONGEST_BLOCK_US:
            yield raw
            return
        parts = np.flatnonzero(np.diff(piece.device_us // LONGEST_BLOCK_US)) + 1
        for begin, end in pairwise([0, *parts.tolist(), len(sequence)]):
            yield raw.rows(begin, end)

    def _hello(self, numbers: ByOrder | ByTime, now_ns: int) -> Hello:
        assert numbers.rate_hz is not None
        assert self.reader.chosen is not None
        return Hello(
            source=self.url,
            host_ns=now_ns,
            rate_hz=numbers.rate_hz,
            sampling_mode="text",
            boot_id=self._introduction.boot_id,
            gyro_lsb_per_dps=self.reader.chosen.unit.lsb,
        )

    def _report_lines(self, now_ns: int) -> Iterator[Trouble]:
        """Report lines of text that contain no sample.

        Lines at the beginning of the input, before the columns are known, are reported only if there are at
        least FEW_LINES of them and none is a sample.
        """
        early = self.reader.bad.counts["before_header"]
        total = self.reader.left_out + self._left_out.counts.total()
        if total > self._left_out.told and self._reports.is_due("lines", now_ns):
            self._left_out.told = total
            newest = self.reader.bad.newest
            what = self._left_out.newest if newest is None else f"line {newest.line}: {newest.why}"
            text = f"{self.url}: {total} lines hold no sample and are left out; the newest is {what}"
            yield Trouble("bad_lines", text, now_ns, fatal=False)
        if self.reader.chosen is None and early >= FEW_LINES:
            yield from self._reports.report(
                "no_columns",
                lambda: f"{self.url}: lines come, but none is a sample. {self._why_none()}",
                now_ns,
            )

    def _why_none(self) -> str:
        if not self._counts.bytes:
            return "It was empty."
        if isinstance(self._numbers, ByTime) and self._numbers.why_no_rate:
            return self._numbers.why_no_rate
        if self._left_out.counts and not self.reader.bad.counts:
            return f"The newest {self._left_out.newest}."
        return str(self.reader.refusal())
