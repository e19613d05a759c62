"""Show a live table in the terminal.

The table describes the noise of each axis, and shows FLTEA's α and f with small diagrams, the state of the
connection, and the last events and errors.
"""

import time
from collections import deque
from collections.abc import Iterator, Sequence

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from fltea.diagnostics.asked import AskedOutput
from fltea.diagnostics.finding import Finding
from fltea.records.block import Block
from fltea.records.events import Reads, TransportEvent
from fltea.records.plus_minus import angle_within, plus_minus
from fltea.records.ports import Item, Printed, Sink, SinkClosed
from fltea.records.records import (
    AnyRecord,
    DeviceEstimates,
    DeviceFits,
    Epoch,
    Error,
    Estimate,
    Fit,
    Gap,
    Hello,
    Motion,
    Stats,
    Step,
)
from fltea.records.visible import visible
from fltea.sinks import table_of_device
from fltea.sinks.axis_words import unit_of
from fltea.sinks.changes import MOVES, sentence, time_of
from fltea.sinks.opening import Opening
from fltea.sinks.page.axis_sentence import answer_of, axis_sentence
from fltea.sinks.page.fits import Fits
from fltea.sinks.page.happenings import EPOCH_WORDS
from fltea.sinks.table_of_device import grid
from fltea.sinks.words import duration, figure

REFRESH_S = 0.2
TREND_WIDTH = 24
TREND_STEP_NS = 10**9
WIDE_COLUMNS = 135
"""If the terminal is at least this wide [columns], the small diagrams of α and f stand next to the numbers.
In a narrower terminal they stand below the numbers.
"""

BARS = "▁▂▃▄▅▆▇█"
WHITE_NOTES = {
    "triple": "On white noise, this variant gives α ≈ 0.4 and f ≈ -2 (0.15 and -0.3 with guard consistent)",
    "joint": "On white noise, this variant gives α ≈ 0.10 after 3,000 samples, 0.01 after 20,000",
}
NOT_DESCRIBED = "* does not describe the noise: no order, another order, or innovations that are not white. "
ADVICE = "; use the fit above, or for a recording fltea identify."


def sparkline(values: Sequence[float]) -> str:
    """Return a small diagram of numbers: a row of characters that look like bars of different heights."""
    if not values:
        return ""
    low, high = min(values), max(values)
    # each number is halved first, since the difference of two huge numbers may exceed the largest float
    span = (high / 2 - low / 2) or 1.0
    return "".join(BARS[min(len(BARS) - 1, int((v / 2 - low / 2) / span * len(BARS)))] for v in values)


class PipedConsole(Console):
    """A console that raises `SinkClosed` when the program that reads the console's output has ended.

    The console of the library rich would exit with code 1.
    """

    def on_broken_pipe(self) -> None:
        """Raise `SinkClosed`, which ends the program without a message."""
        raise SinkClosed


class TableSink(Sink):
    """Redraws the table in place on a terminal.

    If the output is no terminal, it prints the table once, at the end.
    """

    name = "stdout"
    lossless = True

    def __init__(self, console: Console | None = None) -> None:
        self._console = console or PipedConsole()
        self._live = (
            Live(console=self._console, auto_refresh=False, transient=False)
            if self._console.is_terminal
            else None
        )
        self._drawn_s = 0.0
        self._views: dict[str | None, DeviceView] = {}
        self._general = DeviceView()
        if self._live:
            self._live.start()

    def write(self, item: Item) -> None:
        """Remember the record, and redraw the table at most a few times a second."""
        if isinstance(item, Printed | TransportEvent | Reads):
            return
        if isinstance(item, Block) and not (item.estimates and item.due_rows):
            return
        if item.device is None and self._views and isinstance(item, Error):
            self._general.add(item)
        else:
            self._views.setdefault(item.device, DeviceView()).add(item)
        now_s = time.monotonic()
        if self._live and (now_s - self._drawn_s >= REFRESH_S or isinstance(item, Error)):
            self._drawn_s = now_s
            self._live.update(self.render(), refresh=True)

    def close(self) -> None:
        """Draw the table for the last time; it stays on the screen."""
        if self._live:
            self._live.update(self.render(), refresh=True)
            self._live.stop()
        else:
            self._console.print(self.render())

    def render(self) -> Group:
        """Return the whole table as it is now."""
        views = list(self._views.values()) or [self._general]
        lines = [line for view in views for line in view.lines(self._console.width)]
        if self._views:
            lines += self._general.events()
        return Group(*lines, Text(views[0].note(), style="dim"))


class DeviceView:
    """What the table shows about one device."""

    def __init__(self) -> None:
        self._hello: Hello | None = None
        self._epoch: Epoch | None = None
        self._newest: Estimate | Block | None = None
        self._fits = Fits()
        self._of_device: DeviceEstimates | None = None
        self._stats: Stats | None = None
        self._events: deque[str] = deque(maxlen=4)
        self._trends: dict[str, tuple[deque[float], deque[float]]] = {}
        self._trend_ns = 0

    @property
    def _estimate(self) -> Estimate | None:
        """The newest estimate.

        A block of samples may hold the estimate. Then its record is made only when the table needs it.
        """
        if isinstance(self._newest, Block):
            self._newest = self._newest.last_estimate()
        return self._newest

    def add(self, record: AnyRecord | Block) -> None:
        """Remember a record, or a block that has estimates to be shown."""
        match record:
            case Hello():
                self._hello = record
            case Epoch():
                self._epoch, self._newest, self._of_device = record, None, None
                self._trends, self._trend_ns = {}, 0
                self._fits.begin()
                self._events.append(
                    f"epoch {record.epoch} begins at sample {record.seq}: {EPOCH_WORDS[record.reason]}"
                )
            case Estimate() | Block():
                self._newest = record
                self._follow(record.host_ns if isinstance(record, Estimate) else int(record.host_ns[-1]))
            case DeviceEstimates():
                self._of_device = record
            case DeviceFits():
                self._fits.take_device(record)
            case Fit():
                self._fits.take(record, self._hello.rate_hz if self._hello else 100.0)
            case Gap():
                self._events.append(f"gap: {record.missing} samples lost from number {record.seq}")
            case Step() | Motion():
                text = sentence(record, time_of(record))
                if isinstance(record, Motion) and self._events and self._events[-1].startswith(MOVES):
                    # the new text describes the whole motion, and replaces the text about its beginning
                    self._events.pop()
                self._events.append(visible(text))
            case Error():
                message = " ".join(record.message.split("\n"))
                self._events.append(visible(f"{record.kind}: {message}"))
            case Stats():
                self._stats = record

    def _follow(self, host_ns: int) -> None:
        """Add the newest estimate to the small diagrams, once a second by the samples' clock."""
        if host_ns < self._trend_ns or self._estimate is None:
            return
        self._trend_ns = host_ns + TREND_STEP_NS
        for name, axis in self._estimate.axes.items():
            alpha, f = self._trends.setdefault(name, (deque(maxlen=TREND_WIDTH), deque(maxlen=TREND_WIDTH)))
            if axis.fltea.alpha is not None and axis.fltea.f is not None:
                alpha.append(axis.fltea.alpha)
                f.append(axis.fltea.f)

    def lines(self, width: int) -> list[RenderableType]:
        """Return the part of the table about this device, for a terminal of `width` columns."""
        wide = width >= WIDE_COLUMNS
        lines: list[RenderableType] = [Text(self._head(), style="bold")]
        if self._fits.newest is not None or self._estimate is not None:
            lines.append(self._answers())
        lines += self._headings() if wide else []
        lines.append(self._table(wide=wide))
        if not wide and self._estimate is not None:
            lines.append(self._rows_below(self._estimate))
        if self._of_device is not None:
            lines += table_of_device.estimates(self._of_device)
        if self._fits.device:
            lines.append(table_of_device.fits(self._fits.device))
        return [*lines, Text(self._health()), *self.events()]

    def events(self) -> list[RenderableType]:
        """Return the lines of text about the last events."""
        return [Text("\n".join(self._events), style="yellow")] if self._events else []

    def note(self) -> str:
        """Return a text that says how far the estimates can be trusted."""
        info = self._epoch and (self._epoch.estimator or self._epoch.accel_estimator)
        marked = any(map(self._mark, self._stats.axes)) if self._stats else False
        return (NOT_DESCRIBED if marked else "") + WHITE_NOTES[info.variant if info else "joint"] + ADVICE

    def _head(self) -> str:
        hello = self._hello
        if hello is None:
            return "fltea: waiting for the device …"
        parts = [hello.source, hello.sensor, f"{hello.rate_hz:g} Hz"]
        if hello.gyro_range_dps:
            parts.append(f"±{hello.gyro_range_dps:g} deg/s")
        if hello.firmware_version:
            parts.append(f"firmware {hello.firmware_version}")
        return "fltea  " + visible("  ".join(p for p in parts if p))

    def _table(self, *, wide: bool) -> RenderableType:
        if self._estimate is None:
            remaining = self._stats.startup_remaining if self._stats else 0
            return Text(f"start-up window: {remaining} samples to go" if remaining else "no estimate yet")
        unit = f"[{', '.join(dict.fromkeys(map(unit_of, self._estimate.axes)))}]"
        # The titles are `Text` objects, since the library rich would treat "[deg/s]" in a plain string as
        # markup.
        titles = map(Text, ("FLTEA: α", "f [s^-α]", f"state {unit}", f"innov. {unit}", ""))
        table = grid("", *titles, *(("α, last seconds", "f, last seconds") if wide else ()))
        for name, axis in self._estimate.axes.items():
            bars = map(sparkline, self._trends[name]) if wide else ()
            own = axis.fltea
            if not own.valid:
                table.add_row(name, "not valid", "", "", "", "", *bars)
                continue
            table.add_row(
                name,
                plus_minus(own.alpha, own.alpha_std) + self._mark(name),
                plus_minus(own.f, own.f_std),
                _rate(own.state),
                _rate(own.innovation),
                "" if own.settled else "settling",
                *bars,
            )
        return table

    def _answers(self) -> Table:
        """Return the description of each axis's noise, in the same words as on the page."""
        known = self._estimate.axes if self._estimate else {}
        rows = Table.grid(padding=(0, 2))
        rows.add_column(no_wrap=True)
        for name in {**self._fits.axes, **known}:
            found = answer_of(self._fits, self._stats, name)
            head, rest = axis_sentence(found, self._fits, self._stats, known.get(name), name)
            rows.add_row(name, Text.assemble((head, "bold"), rest))
        return rows

    def _headings(self) -> list[RenderableType]:
        """Return a table of the heading's error about each axis, for several times after a rest."""
        axes = self._stats.axes if self._stats else {}
        of = {
            name: stds for name, axis in axes.items() if axis.tracker and (stds := axis.tracker.heading_std)
        }
        if not of:
            return []
        rows = grid("heading after a rest", *map(duration, next(iter(of.values()))))
        for name, stds in of.items():
            rows.add_row(name, *map(angle_within, stds.values()))
        return [rows]

    def _mark(self, axis: str) -> str:
        stats = self._stats.axes.get(axis) if self._stats else None
        return " *" if stats is not None and stats.describes_noise is False else ""

    def _rows_below(self, estimate: Estimate) -> Table:
        rows = grid("", "α, last seconds", "f, last seconds")
        for name in estimate.axes:
            rows.add_row(name, *map(sparkline, self._trends[name]))
        return rows

    @staticmethod
    def _device_health(stats: Stats) -> str:
        """Return the state of a device that makes estimates itself, as text; empty for other devices."""
        board, own = stats.board, stats.device_estimator
        if own is None:
            return ""
        share = board.cpu_share_percent if board else None
        cpu = "" if share is None else f"  CPU {share:.1f} %"
        step = f"  longest step of an axis {own.longest_axis_us / 1000:.2f} ms"
        return f"device:{cpu}{step}  skipped {own.skipped}\n"

    def _health(self) -> str:
        stats = self._stats
        if stats is None:
            return ""
        rate = "" if stats.rate_hz is None else f"  {stats.rate_hz:.2f} Hz"
        ppm = "" if stats.clock_ppm is None else f"  clock {stats.clock_ppm:+.0f} ppm"
        bad = sum(stats.link.damaged.values())
        counts = stats.sample_counts
        seq = "" if self._estimate is None else f"  sample {self._estimate.seq}"
        return self._device_health(stats) + (
            f"epoch {stats.epoch}{seq}  delivered {counts.delivered}  lost {counts.lost}\n"
            f"bad frames {bad}  reconnects {stats.link.reconnects}{rate}{ppm}"
        )


def _rate(value: float | None) -> str:
    return "" if value is None else f"{'+' if value >= 0 else ''}{figure(value, 4)}"


def open_output(opening: Opening) -> TableSink:
    """Open the table on the terminal."""
    return TableSink()


def check_output(asked: AskedOutput) -> Iterator[Finding]:
    """Yield nothing: what is wrong with the standard output is not known before it is used."""
    return iter(())
