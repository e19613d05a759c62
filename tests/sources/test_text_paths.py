"""The same text gives the same samples from a file as from a pipe, or is refused with an error from both."""

from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from fltea.recording.csv_file import open_csv
from fltea.records.errors import UsageError
from fltea.records.events import Event, RawBlock
from fltea.records.records import Hello
from fltea.settings.how import How
from fltea.sources.text_events import TextEvents
from hypothesis import example, given, settings
from hypothesis import strategies as st

DEG = 180 / np.pi


class Found(NamedTuple):
    """The samples that were read from a text.

    `seq`: sequence numbers of the samples. They begin with 0 at each start of the logger.
    """

    gyro: list[list[float]]
    accel: list[list[float]] | None
    seq: list[int]
    rate_hz: float
    lsb: float | None


def of_file(path: Path, text: bytes, how: How) -> Found:
    path.write_bytes(text)
    stored = open_csv(path, how)
    whole = stored.whole()
    assert np.isfinite(whole.gyro).all()
    assert (np.diff(whole.device_s) > 0).all()
    epochs, numbers = whole.epoch.tolist(), whole.seq.tolist()
    first = dict(zip(epochs[::-1], numbers[::-1], strict=True))
    seq = [number - first[epoch] for epoch, number in zip(epochs, numbers, strict=True)]
    accel = None if whole.accel_ms2 is None else whole.accel_ms2.tolist()
    return Found(whole.gyro.tolist(), accel, seq, stored.rate_hz, whole.lsb_per_dps)


def of_pipe(text: bytes, how: How, cuts: list[int]) -> Found:
    live = TextEvents("stdin:", how, fatal=False)
    live.open(0, within_line=False)
    places = [0, *sorted(min(cut, len(text)) for cut in cuts), len(text)]
    events: list[Event] = [event for a, b in pairwise(places) for event in live.feed(text[a:b], 0)]
    events += live.finish(0)
    gyro: list[list[float]] = []
    accel: list[list[float]] = []
    seq: list[int] = []
    boot, base, hello = None, 0, None
    for event in events:
        if isinstance(event, Hello):
            hello = event
        elif isinstance(event, RawBlock):
            if hello.boot_id != boot:
                boot, base = hello.boot_id, int(event.sequence[0])
            gyro += event.gyro.tolist()
            accel += [] if event.accel is None else event.accel.tolist()
            seq += (event.sequence - base).tolist()
    return Found(gyro, accel or None, seq, hello.rate_hz, hello.gyro_lsb_per_dps)


def both(path: Path, text: bytes, how: How, cuts: list[int]) -> tuple[Found | str, Found | str]:
    found: list[Found | str] = []
    for read in (lambda: of_file(path, text, how), lambda: of_pipe(text, how, cuts)):
        try:
            found.append(read())
        except UsageError as error:
            found.append(str(error))
    return found[0], found[1]


RATE: dict[str, Any] = {"rate_hz": 100.0}
FORMS: dict[str, tuple[str, dict[str, Any], float]] = {
    "names that are given": (
        "gyro_x_rad_s,gyro_y_rad_s\n1,2\n3,4\n",
        {"columns": ["gyro_x_rad_s", "gyro_y_rad_s"], **RATE},
        DEG,
    ),
    "decimal commas from the second row on": ("gx;gy\n1;2\n1,5;2,0\n", {"units": "dps", **RATE}, 1.0),
    "names that are known": ("t_ms angular_velocity.x wy\n0 1 2\n10 3 4\n", {"units": "rad/s"}, DEG),
    "a file's own objects": (
        '{"t_ms": 0, "wx_rads": 1, "wy_rads": 2}\n{"t_ms": 10, "wx_rads": 3, "wy_rads": 4}\n',
        {},
        DEG,
    ),
    "words in fields that nobody asked for, as of `ros2 topic echo --csv`": (
        "17,5,imu_link,1,2,3\n17,6,imu_link,4,5,6\n",
        {"columns": ["4", "5", "6"], "units": "rad/s", **RATE},
        DEG,
    ),
}
"""Examples of texts, in addition to those that hypothesis generates below."""


@pytest.mark.parametrize("name", FORMS)
def test_forms_that_a_file_and_a_pipe_give_alike(name: str, tmp_path: Path) -> None:
    text, how, first = FORMS[name]
    from_file, from_pipe = both(tmp_path / "a.csv", text.encode(), How(**how), [7, 20])
    assert from_file == from_pipe
    assert from_file.gyro[0][0] == pytest.approx(first)
    assert len(from_file.gyro) == 2


@pytest.mark.parametrize("header", ["gx [rad/s]", "gyro_x_rad_s", "gx\nrad/s"])
@pytest.mark.parametrize("units", ["deg/s", "mdps", "lsb:131"])
def test_a_unit_that_the_header_denies_is_an_error_that_names_both(
    header: str, units: str, tmp_path: Path
) -> None:
    for found in both(tmp_path / "a.csv", f"{header}\n1\n2\n".encode(), How(units=units, rate_hz=9.0), []):
        assert f"is in rad/s by its name or the row of units, and --units {units} says otherwise" in found


def test_another_name_for_the_same_unit_is_no_contradiction(tmp_path: Path) -> None:
    for units in ("deg/s", "°/s", "dps"):
        for found in both(tmp_path / "a.csv", b"gyro_x_dps\n1\n2\n", How(units=units, rate_hz=9.0), []):
            assert isinstance(found, Found)


@pytest.mark.parametrize("times", [["", "", "", ""], ["0,", "10,", "500,", "3,"]])
def test_a_header_in_the_middle_begins_a_new_run_where_times_do_not_number(
    times: list[str], tmp_path: Path
) -> None:
    header = "t_ms,gyro_x_dps\n" if times[0] else "gyro_x_dps\n"
    rows = [f"{time}{k}\n" for k, time in enumerate(times)]
    text = header + "".join(rows[:2]) + header + "".join(rows[2:])
    from_file, from_pipe = both(tmp_path / "a.csv", text.encode(), How(rate_hz=100.0), [])
    assert from_file == from_pipe
    assert from_file.seq == [0, 1, 0, 1]


def test_a_counter_that_wraps_and_times_that_run_back_are_alike(tmp_path: Path) -> None:
    times = [(2**32 - 60 + 10 * k) % 2**32 for k in range(20)] + [5, 15, 25, 25, 45]
    text = "t_ms,gyro_x_dps\n" + "".join(f"{t},{k % 24}\n" for k, t in enumerate(times))
    from_file, from_pipe = both(tmp_path / "a.csv", text.encode(), How(), [])
    assert from_file == from_pipe
    assert from_file.seq == [*range(20), 0, 1, 2, 4]
    assert from_file.rate_hz == pytest.approx(100.0)


number = st.one_of(st.integers(-999, 999).map(str), st.floats(-2000, 2000, width=32).map("{:.6g}".format))
field = st.one_of(
    number, number, number, st.sampled_from(["", "nan", "NA", "x", "1_0", "1e5", "2,5", '"7"', "inf"])
)
garbage = st.sampled_from(
    ["", "# a remark", "IMU ready", "gx gy", "1", "-", ",,,", ";;;", "\x00\x1b[2J", "{", '{"gx": 1}', '"']
)
HEADERS = [
    "",
    "t_ms,gx,gy\n",
    "# t_ms,gx [rad/s],gy [rad/s]\n",
    "title\ntime_s,gyro_x_dps,gyro_y_dps\n",
    "t,gx,gy\nms,rad/s,rad/s\n",
    "t_ms,wx_rads,wy_rads,ax [g],ay [g],az [g]\n",
    "a,b,c\n",
]
HOWS: list[dict[str, Any]] = [
    {},
    {"units": "rad/s"},
    {"rate_hz": 100.0},
    {"rate_hz": 100.0, "units": "dps"},
    {"columns": ["gx", "gy"], "rate_hz": 50.0},
    {"columns": ["2", "3"], "time_column": "1", "time_unit": "ms"},
    {"columns": ["2", "3"], "rate_hz": 100.0},
    {"columns": ["a", "b", "c"], "rate_hz": 100.0, "units": "lsb:16.4"},
]


@st.composite
def texts(draw: st.DrawFn) -> bytes:
    separator = draw(st.sampled_from([",", ";", "\t", " "]))
    comma = separator != "," and draw(st.booleans())
    header = draw(st.sampled_from(HEADERS)).replace(",", separator)
    # The sampling rate of a pipe is found from its first 2 s, that of a file from all rows. The times in
    # these texts are equally spaced, so that both rates are equal.
    step = draw(st.sampled_from(["0.01", "0"] if "time_s" in header else ["10", "10", "10", "0.01", "0"]))
    columns = 6 if "ax" in header else 3
    lines = []
    for k in range(draw(st.integers(0, 40))):
        kind = draw(st.integers(0, 9))
        if kind == 0:
            lines.append(draw(garbage))
            continue
        one = field if kind == 1 else number
        row = [
            f"{k * float(step):.6g}",
            *draw(st.lists(one, min_size=columns - 1, max_size=columns - (kind > 1))),
        ]
        text = separator.join(row)
        lines.append(text.replace(".", ",") if comma else text)
        if kind == 2 and draw(st.booleans()):
            lines.append(header.rstrip("\n"))
    end = draw(st.sampled_from(["\n", "\r\n"]))
    text = header + "\n".join(lines) + draw(st.sampled_from(["", "\n"]))
    return text.replace("\n", end).encode()


@example(text=b"t_ms,wx_rads,wy_rads,ax [g],ay [g],az [g]\n,,,", how={}, cuts=[])
@given(text=texts(), how=st.sampled_from(HOWS), cuts=st.lists(st.integers(0, 2000), max_size=6))
@settings(max_examples=120)
def test_what_a_file_takes_a_pipe_takes_with_the_same_samples(
    tmp_path_factory: pytest.TempPathFactory, text: bytes, how: dict[str, Any], cuts: list[int]
) -> None:
    from_file, from_pipe = both(tmp_path_factory.getbasetemp() / "a.csv", text, How(**how), cuts)
    if isinstance(from_file, str) or isinstance(from_pipe, str):
        assert isinstance(from_file, str), from_pipe
        assert isinstance(from_pipe, str), from_file
        return
    # If a line lacks the accelerometer's values, the accelerometer is left out. From a file it is left out
    # completely. From a pipe the earlier lines have already been passed on with it.
    if from_file.accel is None:
        from_pipe = from_pipe._replace(accel=None)
    assert from_file == from_pipe
