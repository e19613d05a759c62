"""Text that arrives live is read as a file of the same text would be: it gives the same samples, the same
evidence for units, and the same errors.
"""

import json
from collections.abc import Callable, Sequence
from functools import reduce
from itertools import pairwise
from operator import xor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fltea.recording.csv_file import open_csv
from fltea.recording.dialects import dialects
from fltea.recording.reading import Answer, NotStated
from fltea.records.errors import UsageError
from fltea.records.events import Event, RawBlock, Trouble
from fltea.records.records import Hello
from fltea.settings.how import How
from fltea.sources.text_events import TextEvents
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.rig.blocks import of
from tests.rig.corpus_files import HERE
from tests.rig.corpus_reading import OPTIONS, UNREAD_DIALECTS, how_of

N = 300
GYRO = np.round(np.random.default_rng(8).normal(size=(N, 3)), 4)
NAMES = ["time_s", "gyro_x_dps", "gyro_y_dps", "gyro_z_dps"]
HEAD = ",".join(NAMES) + "\n"


def row(k: int, separator: str = ",") -> str:
    return separator.join(map(str, [k / 100, *GYRO[k].tolist()]))


def lines(head: str, of_row: Callable[[int], str]) -> str:
    return head + "".join(of_row(k) + "\n" for k in range(N))


def rad(k: int) -> list[float]:
    return [round(float(value), 9) for value in np.radians(GYRO[k])]


def echoed(k: int) -> str:
    x, y, z = rad(k)
    stamp = f"header:\n  stamp:\n    sec: {k // 100}\n    nanosec: {k % 100 * 10_000_000}\n  frame_id: imu\n"
    return f"{stamp}angular_velocity:\n  x: {x}\n  y: {y}\n  z: {z}\n---"


def sentence(k: int) -> str:
    text = ",".join(map(str, ["VNGYR", *rad(k)]))
    return f"${text}*{reduce(xor, text.encode(), 0):02X}"


def tagged(k: int) -> str:
    return f"ACC,{k / 100},0.1,0.2,9.8\nGYR,{row(k)}\nMAG,{k / 100},1,2,3"


def of_two(k: int) -> str:
    other = ",".join(map(str, (-GYRO[k]).tolist()))
    return f"left,{row(k)}\nright,{k / 100 + 0.003},{other}"


def objects_of_two(k: int) -> str:
    left, right = (dict(zip(NAMES, [k / 100, *(sign * GYRO[k]).tolist()], strict=True)) for sign in (1, -1))
    return f"{json.dumps({'imu': 0, **left})}\n{json.dumps({'imu': 1, **right})}"


def of_day(k: int) -> str:
    """Return the row of sample k with its time of day. The first time is 23:59:58."""
    clock = f"23:59:{58 + k // 100}" if k < 200 else "00:00:00"
    return f"{clock}.{k % 100:02},{row(k).partition(',')[2]}"


def paged(k: int) -> str:
    return f"{HEAD}{row(k)}" if k % 25 == 0 else row(k)


def torn(k: int) -> str:
    return "W (99) wifi: lost" if k % 50 == 20 else row(k)


BY_PLACE: dict[str, Any] = {
    "columns": ["3", "4", "5"],
    "time_column": "2",
    "units": "dps",
    "time_unit": "s",
}
FORMS: dict[str, tuple[str, dict[str, Any]]] = {
    "rows": (lines(HEAD, row), {}),
    "a row of units": (lines("time,gx,gy,gz\ns,deg/s,deg/s,deg/s\n", row), {}),
    "pages": (lines("", paged), {}),
    "words among rows": (lines(HEAD, torn), {}),
    "semicolons and decimal commas": (
        lines(HEAD.replace(",", ";"), lambda k: row(k, ";").replace(".", ",")),
        {},
    ),
    "an echoed topic": (lines("", echoed), {}),
    "sentences": (lines("", sentence), {"rate_hz": 100.0}),
    "rows of several kinds": (lines("", tagged), {**BY_PLACE, "topic": "GYR"}),
    "rows of several sensors": (lines("imu," + HEAD, of_two), {"topic": "left"}),
    "objects of several sensors": (lines("", objects_of_two), {"topic": "0"}),
    "Python's bytes": (lines("", lambda k: repr(f"x,{row(k)}\r\n".encode())), BY_PLACE),
    "Python's dicts": (
        lines("", lambda k: repr(dict(zip(NAMES, map(float, row(k).split(",")), strict=True)))),
        {},
    ),
    "labels": (
        lines("", lambda k: "Gyro X: {} Y: {} Z: {} dps".format(*GYRO[k].tolist())),
        {"rate_hz": 100.0},
    ),
    "times of day": (lines(HEAD.replace("time_s", "time"), of_day), {}),
}


def live(parts: Sequence[bytes], how: How) -> tuple[list[Event], TextEvents]:
    source = TextEvents("stdin:", how, fatal=False)
    source.open(0, within_line=False)
    events = [event for part in parts for event in source.feed(part, 0)]
    return [*events, *source.finish(0)], source


def cut(data: bytes, places: Sequence[int]) -> list[bytes]:
    return [data[a:b] for a, b in pairwise([0, *sorted(min(one, len(data)) for one in places), len(data)])]


def samples(events: list[Event]) -> tuple[float, list[Any], list[int]]:
    """Return the sampling rate, the values in deg/s or counts, and the sample numbers in these events."""
    blocks = of(RawBlock, events)
    rate_hz = of(Hello, events)[0].rate_hz
    gyro = np.concatenate([block.gyro for block in blocks])
    return rate_hz, gyro.tolist(), np.concatenate([block.sequence for block in blocks]).tolist()


def of_file(folder: Path, data: bytes, how: How) -> tuple[float, list[Any], list[int], tuple[Answer, ...]]:
    path = folder / "rest.csv"
    path.write_bytes(data)
    found = open_csv(path, how)
    whole = found.whole()
    numbers = range(len(whole.gyro)) if whole.seq is None else whole.seq.tolist()
    return found.rate_hz, whole.gyro.tolist(), [*numbers], found.reading


@pytest.mark.parametrize("name", FORMS)
def test_samples_and_evidence_are_those_of_the_file(name: str, tmp_path: Path) -> None:
    text, options = FORMS[name]
    data, how = text.encode(), How(**options)
    events, source = live([data[k : k + 777] for k in range(0, len(data), 777)], how)
    rate_hz, gyro, numbers = samples(events)
    file_hz, file_gyro, file_numbers, answers = of_file(tmp_path, data, how)
    assert rate_hz == pytest.approx(file_hz, rel=1e-6)
    assert rate_hz == pytest.approx(100)
    assert (gyro, numbers) == (file_gyro, file_numbers)
    assert len({hello.boot_id for hello in of(Hello, events)}) == 1, "one run"
    expected = GYRO[[k for k in range(N) if name != "words among rows" or k % 50 != 20]]
    assert np.array(gyro) == pytest.approx(expected, abs=1e-6)
    assert source.reader.chosen is not None
    seen = [
        answer for answer in answers if not (answer.question == "clock" and answer.evidence == "measured")
    ]
    assert [*source.reader.chosen.answers] == seen


@given(st.sampled_from([*FORMS]), st.lists(st.integers(0, 20_000), min_size=1, max_size=8))
@settings(max_examples=40)
def test_samples_are_the_same_in_whatever_pieces_they_come(name: str, places: list[int]) -> None:
    text, options = FORMS[name]
    data, how = text.encode(), How(**options)
    cut_hz, *cut_samples = samples(live(cut(data, places), how)[0])
    rate_hz, *whole = samples(live([data], how)[0])
    assert cut_hz == pytest.approx(rate_hz, rel=1e-9)
    assert cut_samples == whole


LIVE = [
    name
    for one in dialects()
    for name in one.corpus
    if name.endswith((".txt", ".csv", ".gcsv"))
    and not one.file
    and not one.unread
    and name != "xsens_mtw.txt"
]


@pytest.mark.parametrize("name", LIVE)
def test_a_logger_is_recognised_from_a_few_lines(name: str, tmp_path: Path) -> None:
    """Which logger has written a text is recognised from live lines, too. They come one by one, whereas all
    numbers of a file can be examined together.
    """
    data, how = (HERE / name).read_bytes(), how_of(OPTIONS[name])
    events, source = live(data.splitlines(keepends=True), how)
    whole = open_csv(HERE / name, how).whole()
    assert samples(events)[1] == whole.gyro.tolist()
    assert source.reader.chosen is not None
    (unit,) = [answer for answer in source.reader.chosen.answers if answer.question == "unit"]
    (of_whole,) = [answer for answer in open_csv(HERE / name, how).reading if answer.question == "unit"]
    assert unit == of_whole


def test_each_dialect_of_text_that_names_no_file_is_tried_live() -> None:
    assert len(LIVE) > 25
    assert not {*LIVE} & {*UNREAD_DIALECTS}


REFUSED: dict[str, tuple[str, dict[str, Any], str]] = {
    "no unit": (lines("t,gx,gy,gz\n", row), {}, "nothing says the unit of gx, gy, gz"),
    "no rate": (lines("gx_dps,gy_dps,gz_dps,q\n", row), {}, "as there is no column of times"),
    "no columns": (lines("a,b,c,d\n", row), {"rate_hz": 9.0}, "which columns are the gyroscope's axes"),
    "no names": (lines("", row), {}, "--columns ?,?,? --units ?"),
    "a unit that contradicts the names": (lines(HEAD, row), {"units": "rad/s"}, "--units rad/s says"),
    "a unit of times that contradicts": (lines(HEAD, row), {"time_unit": "ms"}, "--time-unit ms says"),
    "a rate that the times contradict": (lines(HEAD, row), {"rate_hz": 50.0}, "the rate is 100 Hz"),
    "an acceleration": (
        lines("t,ax [g],ay [g],az [g]\n", row),
        {"columns": ["ax [g]"], "units": "dps", "time_unit": "s"},
        "which is no angular rate",
    ),
    "several sensors": (lines("imu," + HEAD, of_two), {}, "column imu tells several apart (left, right)"),
    "objects of several sensors": (lines("", objects_of_two), {}, "column imu tells several apart (0, 1)"),
    "no such sensor": (lines("imu," + HEAD, of_two), {"topic": "front"}, "no row has front in the column"),
    "a clock in ticks": (
        lines("t,gx_dps\n", lambda k: f"{k * 10_000},{GYRO[k, 0]}"),
        {},
        "count. Say it",
    ),
    "columns that no gyroscope gives": (
        lines("", lambda k: f"{k},{16384 + k % 7}"),
        {"columns": ["2"], "units": "dps", "rate_hz": 100.0},
        "is beyond 4000 deg/s in",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_a_file_is_refused_for_live_text_is_too(name: str, tmp_path: Path) -> None:
    text, options, reason = REFUSED[name]
    with pytest.raises(UsageError) as of_whole:
        of_file(tmp_path, text.encode(), How(**options))
    with pytest.raises(UsageError) as caught:
        live(cut(text.encode(), range(0, len(text), 333)), How(**options))
    for error in (of_whole.value, caught.value):
        assert reason in str(error)
    if isinstance(of_whole.value, NotStated) and isinstance(caught.value, NotStated):
        assert " ? " in f"{caught.value} ".replace("?,?,?", "?").replace("\n", " ")


@pytest.mark.parametrize("places", [range(0, 4000, 7), range(0, 4000, 1000)])
def test_a_sentence_with_a_wrong_checksum_is_counted_and_lost(places: range) -> None:
    text = lines("", lambda k: sentence(k).replace("VNGYR,", "VNGYR,1", 1) if k == 50 else sentence(k))
    events, source = live(cut(text.encode(), places), How(rate_hz=100.0))
    assert samples(events)[2] == [k for k in range(N) if k != 50]
    assert source.link_stats().bad_frames == {"number": 1}
    assert any("wrong checksum" in trouble.message for trouble in of(Trouble, events))


def test_a_sender_that_begins_again_in_another_unit_is_read_in_it() -> None:
    rads = "".join(",".join(map(str, rad(k))) + "\n" for k in range(10))
    text = "gx_dps,gy_dps,gz_dps\n" + "".join(row(k).partition(",")[2] + "\n" for k in range(10))
    events, _ = live([(text + "gx_rads,gy_rads,gz_rads\n" + rads).encode()], How(rate_hz=100.0))
    gyro = np.concatenate([block.gyro for block in of(RawBlock, events)])
    assert gyro == pytest.approx(np.tile(GYRO[:10], (2, 1)), abs=1e-6)
