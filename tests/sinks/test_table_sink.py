"""Tests of the table of a terminal, with all numbers and units."""

import io
import re

import msgspec
import pytest
from fltea.records.ports import SinkClosed
from fltea.records.records import (
    ACCEL_UNIT,
    AnyRecord,
    Error,
    Fit,
    Gap,
)
from fltea.records.stats import LinkStats
from fltea.sinks.page.axis_sentence import answer_of, axis_sentence
from fltea.sinks.table import BARS, TREND_WIDTH, PipedConsole, TableSink, sparkline
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from tests.rig.blocks import as_items
from tests.rig.dashboard_support import told
from tests.rig.example_records import GOOD, INVALID, axis_estimate
from tests.rig.fit_support import FRACTIONAL
from tests.rig.host_support import hello
from tests.rig.sink_records import EPOCH, ERROR, FIT, HELLO, MOVES, RESTS, STATS, STEP, estimate

WITHOUT_STD = msgspec.structs.replace(
    GOOD, fltea=msgspec.structs.replace(GOOD.fltea, innovation=None, alpha_std=None)
)
OPENED = msgspec.structs.replace(STATS, link=LinkStats(bad_frames={"partial": 1, "crc": 2}))


def shown(*records: AnyRecord, width: int = 80) -> str:
    console = Console(file=io.StringIO(), width=width, color_system=None)
    sink = TableSink(console)
    for item in as_items(records):
        sink.write(item)
    sink.close()
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


WIDTHS = pytest.mark.parametrize("width", [80, 100, 157, 158, 200])


@WIDTHS
def test_numbers_and_units_at_every_width(width: int) -> None:
    text = shown(HELLO, EPOCH, estimate(), STATS, width=width)
    for part in (
        "serial:/dev/ttyACM0  MPU-9250  100 Hz  ±2000 deg/s  firmware 0.1.0",
        "f [s^-α]",
        "state [deg/s]",
        "innov. [deg/s]",
        "0.412 ± 0.061",
        "-2.12 ± 0.49",
        "+0.1234",
        "-0.0567",
        "gyro_y",
        "not valid",
        "epoch 3  sample 701  delivered 1234  lost 56",
        "bad frames 5  reconnects 1  99.50 Hz  clock -62 ppm",
        "epoch 3 begins at sample 700: a gap too long to bridge",
    ):
        assert part in text
    headings = "heading after a rest  1 s       60 s", "gyro_x                ± 0.027°  ± 0.51°"
    assert all((part in text) == (width >= 135) for part in headings)
    assert "…" not in text
    assert max(map(len, text.splitlines())) <= width
    assert "use the fit above" in " ".join(text.split()), "α is not shown alone"
    assert "fltea identify" in " ".join(text.split())


@WIDTHS
def test_trends_are_shown_at_every_width(width: int) -> None:
    rising = [
        estimate(k * 10**9, gyro_x=axis_estimate(k / 10, 0.1, -k / 10, 0.1, 0.0, 0.0, True)) for k in range(8)
    ]
    text = shown(HELLO, *rising, width=width)
    assert BARS in text
    assert BARS[::-1] in text


def test_axis_that_is_not_valid_keeps_its_trend_and_shows_no_number() -> None:
    text = shown(HELLO, estimate(gyro_x=GOOD), estimate(10**9, gyro_x=INVALID), width=200)
    row = next(line for line in text.splitlines() if "gyro_x" in line and "not valid" in line)
    assert BARS[0] in row
    assert not re.search(r"\d", row.replace("gyro_x", ""))


@WIDTHS
def test_each_axis_stands_in_the_sentence_that_the_page_has(width: int) -> None:
    agreeing = [msgspec.structs.replace(FIT, samples=samples) for samples in (1000, 1200, 1400, 1600)]
    text = " ".join(shown(HELLO, *agreeing, estimate(), width=width).split())
    history = told([HELLO, EPOCH, *agreeing, estimate()])
    for name in ("gyro_x", "gyro_y", "gyro_z"):
        answer, newest = answer_of(history.fits, history.stats, name), history.epoch.newest.get(name)
        words = "".join(axis_sentence(answer, history.fits, history.stats, newest, name))
        assert f"{name} {words}" in text
    assert (
        "gyro_x Fractional: α = 0.80 (0.76 … 0.85), f = −1.0 (−1.3 … −0.8) s^−α; bias 0.234 ± 0.024" in text
    )
    assert "α ± 0.05: reached." in text
    assert "α ± 0.05 in about 10 min." in text
    assert "gyro_z White noise" in text


@pytest.mark.parametrize(
    ("records", "there", "not_there"),
    [
        ([], ["waiting for the device"], []),
        ([HELLO], ["no estimate yet"], []),
        ([HELLO, EPOCH, STATS], ["start-up window: 123 samples to go"], []),
        ([HELLO, OPENED], ["bad frames 2 "], []),
        ([HELLO, estimate(), EPOCH], ["no estimate yet"], ["0.412"]),
        ([HELLO, FIT, EPOCH], ["Fractional"], []),  # the last fit stays shown in a new epoch
        ([HELLO, estimate(), EPOCH, estimate()], [BARS[0]], []),
        ([estimate(gyro_x=WITHOUT_STD)], ["0.412"], ["0.412 ±", "None"]),
        # the library rich would read [bold] and [5 s] as markup if that were not switched off
        ([HELLO, ERROR], ["silent: nothing [bold]came[/bold] for [5 s]"], []),
        ([HELLO, Gap(40, 3, 1, 0)], ["gap: 3 samples lost from number 40"], []),
        ([HELLO, STEP], ["gyro_x: step of +0.104 ± 0.022 deg/s at 0:00:07"], []),
        ([HELLO, MOVES], ["the sensor moves since 0:00:08 (shown by accel)"], []),
        (
            [HELLO, MOVES, RESTS],
            ["at rest again since 0:00:10: it moved for 200 samples"],
            ["the sensor moves"],
        ),
        ([HELLO, MOVES, Gap(40, 3, 1, 0), RESTS], ["the sensor moves", "at rest again"], []),
        ([hello(source="[red]/tmp/a[0].npz")], ["[red]/tmp/a[0].npz"], []),
        ([Gap(k, 1, 1, 0) for k in range(6)], [f"number {k}" for k in range(2, 6)], ["number 0", "number 1"]),
    ],
)
def test_what_is_shown_and_what_is_not(
    records: list[AnyRecord], there: list[str], not_there: list[str]
) -> None:
    text = shown(*records)
    assert [part for part in there if part not in text] == []
    assert [part for part in not_there if part in text] == []


def test_diverging_numbers_do_not_burst_the_table() -> None:
    axis = axis_estimate(3.2, 0.1, -1.5e139, 2e138, 1e7, -1e300, True)
    lines = shown(HELLO, *[estimate(k * 10**9, gyro_x=axis) for k in range(3)], width=100).splitlines()
    text = "\n".join(lines)
    for part in ("-1.500e+139", "3.920e+138", "+1.0000e+07", "-1.0000e+300"):
        assert part in text
    assert max(map(len, lines)) <= 100


def test_fits_a_terminal_of_24_lines() -> None:
    axes = dict.fromkeys(("gyro_x", "gyro_y", "gyro_z"), GOOD)
    gaps = [Gap(k, 1, 1, 0) for k in range(4)]
    fit = Fit(701, 3, 7_010_000, 0, 702, dict.fromkeys(axes, FRACTIONAL))
    for width in (80, 135):
        text = shown(HELLO, EPOCH, *gaps, estimate(**axes), fit, STATS, width=width)
        assert len(text.splitlines()) <= 24


def test_terminal_is_redrawn_at_errors_and_left_with_the_last_state() -> None:
    console = Console(file=io.StringIO(), width=100, force_terminal=True, color_system=None)
    sink = TableSink(console)
    sink.write(HELLO)
    sink.write(ERROR)
    assert isinstance(console.file, io.StringIO)
    assert "silent: nothing" in console.file.getvalue()
    sink.write(estimate())
    sink.close()
    assert "0.412 ± 0.061" in console.file.getvalue()


def test_closed_pipe_of_the_table_is_sink_closed() -> None:
    class Closed(io.StringIO):
        def write(self, text: str) -> int:
            raise BrokenPipeError

    with pytest.raises(SinkClosed):
        TableSink(PipedConsole(file=Closed(), width=80)).close()


def test_several_devices_below_each_other() -> None:
    two = [
        msgspec.structs.replace(record, device=name)
        for name in ("left", "right")
        for record in (hello(source=f"serial:{name}"), EPOCH, estimate(), STATS)
    ]
    general = Error("output_lost", "nothing more is written", 1)
    text = shown(*two, general)
    assert text.index("serial:left") < text.index("serial:right") < text.index("output_lost")
    assert text.count("0.412 ± 0.061") == 2
    assert text.count("On white noise") == 1


def test_axes_of_the_accelerometer_have_their_unit() -> None:
    axis = axis_estimate(0.3, 0.1, -1.0, 0.5, 0.0123, -0.0045, True, unit=ACCEL_UNIT)
    text = shown(HELLO, EPOCH, estimate(gyro_x=GOOD, accel_z=axis), width=150)
    assert re.search(r"accel_z.*\+0\.0123.*-0\.0045", text)
    assert "m/s²" in text


def test_sparkline() -> None:
    assert sparkline([]) == ""
    assert sparkline([3.0]) == "▁"
    assert sparkline([2.0, 2.0, 2.0]) == "▁▁▁"
    assert sparkline([0, 1, 2, 3, 4, 5, 6, 7]) == BARS
    assert sparkline([-1.0, 1.0, 0.0]) == "▁█▅"
    assert sparkline([-1e308, 1e308, 0.0]) == "▁█▅"


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1))
def test_sparkline_has_a_bar_a_number_in_order(values: list[float]) -> None:
    bars = sparkline(values)
    assert len(bars) == len(values)
    heights = [BARS.index(bar) for bar in bars]
    by_value = [height for _, height in sorted(zip(values, heights, strict=True))]
    assert by_value == sorted(heights)
    assert heights[values.index(min(values))] == 0


def test_trends_take_one_a_second_and_forget_the_oldest() -> None:
    n = 100 * (TREND_WIDTH + 5)
    axes = (axis_estimate(float(k), 0.1, 0.0, 0.1, 0.0, 0.0, True) for k in range(n))
    text = shown(HELLO, *(estimate(k * 10_000_000, gyro_x=axis) for k, axis in enumerate(axes)), width=200)
    assert sparkline([100.0 * k for k in range(5, TREND_WIDTH + 5)]) in text
