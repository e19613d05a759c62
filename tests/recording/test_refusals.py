"""Tests that files of other programs are recognised for what they are, and that the error for a file that is
no recording says so.
"""

import json
import shlex
import zipfile
from pathlib import Path

import numpy as np
import pytest
from fltea.recording.text_rows import TextReader
from fltea.records.errors import UsageError
from fltea.records.events import RawBlock
from fltea.records.records import Hello
from fltea.settings.how import How
from fltea.sources.replay import ReplaySource

_random = np.random.default_rng(5)
N, RATE_HZ = 80, 50.0
GYRO = np.round(0.1 * _random.normal(size=(N, 3)) + [0.5, -0.3, 0.1], 3)
TIMES = np.arange(N) / RATE_HZ


def refusal(path: Path, how: How | None = None) -> str:
    with pytest.raises(UsageError) as caught:
        ReplaySource(path, how=how or How())
    return str(caught.value)


def read(path: Path, how: How | None = None) -> tuple[float, np.ndarray]:
    events = list(ReplaySource(path, how=how or How()).events())
    (hello,) = [event for event in events if isinstance(event, Hello)]
    return hello.rate_hz, np.concatenate([event.gyro for event in events if isinstance(event, RawBlock)])


def lines(head: str, of_row) -> str:
    return head + "".join(of_row(k) + "\n" for k in range(N))


@pytest.mark.parametrize("order", [("accel", "gyro"), ("gyro", "accel")])
@pytest.mark.parametrize("up", range(3))
def test_columns_without_names_are_asked_for_with_what_can_be_measured(
    tmp_path: Path, order: tuple[str, str], up: int
) -> None:
    accel = np.full((N, 3), [200.0, -370.0, 150.0])
    accel[:, up] = 16384
    counts = {"accel": accel + np.rint(10 * GYRO), "gyro": np.rint(131 * GYRO)}
    table = np.hstack([counts[one] for one in order])
    path = tmp_path / "raw.txt"
    path.write_text(lines("", lambda k: "\t".join(f"{v:.0f}" for v in table[k])))
    text = refusal(path)
    assert f"fltea identify {path} --columns ?,?,? --units ? --rate ?" in text
    first = 1 if order[0] == "accel" else 4
    assert text.count(f"columns {first} to {first + 2} have the length") == 3
    assert "--rate 1" not in text


def test_the_weather_is_not_taken_for_a_gyroscope(tmp_path: Path) -> None:
    path = tmp_path / "weather.csv"
    path.write_text(
        lines("date,temp_c,humidity,city\n", lambda k: f"2026-11-01,{15 + k % 7},{60 + k % 11},Berlin")
    )
    assert "--columns ?,?,?" in refusal(path)


def test_axes_of_an_app_whose_sensor_nothing_says_are_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "mine.csv"
    path.write_text(
        lines(
            "time,seconds_elapsed,z,y,x\n",
            lambda k: f"{1700000000000000000 + 20_000_000 * k},{TIMES[k]},1.1,2.2,.{k}",
        )
    )
    assert "--columns ?,?,? --units ?" in refusal(path)


def test_an_excel_sheet_with_an_index_has_a_first_column_without_a_name(tmp_path: Path) -> None:
    path = tmp_path / "index.tsv"
    head = "\ttime_s\tgyro_x_dps\tgyro_y_dps\tgyro_z_dps\n"
    path.write_text(lines(head, lambda k: "\t".join(map(str, [k, TIMES[k], *GYRO[k]]))))
    rate_hz, gyro = read(path)
    assert rate_hz == pytest.approx(RATE_HZ)
    assert gyro == pytest.approx(GYRO)


@pytest.mark.parametrize("between", [" ", ", "])
def test_labels_with_numbers_are_no_header(tmp_path: Path, between: str) -> None:
    path = tmp_path / "plotter.txt"
    path.write_text(
        lines("", lambda k: between.join(f"G{a}: {v}" for a, v in zip("xyz", GYRO[k], strict=True)))
    )
    assert read(path, How(units="dps", rate_hz=RATE_HZ))[1] == pytest.approx(GYRO)


OBJECTS = [{"t": t, "gx_dps": x, "gy_dps": y, "gz_dps": z} for t, (x, y, z) in zip(TIMES, GYRO, strict=True)]
DOCUMENTS = {
    "array": json.dumps(OBJECTS),
    "array over lines": json.dumps(OBJECTS, indent=1),
    "split": json.dumps(
        {"columns": [*OBJECTS[0]], "index": [*range(N)], "data": [[*one.values()] for one in OBJECTS]}
    ),
    "columns": json.dumps(
        {name: {str(k): one[name] for k, one in enumerate(OBJECTS)} for name in OBJECTS[0]}
    ),
    "lists": json.dumps({name: [one[name] for one in OBJECTS] for name in OBJECTS[0]}),
}


@pytest.mark.parametrize("kind", DOCUMENTS)
def test_a_document_of_json_is_read_from_a_file(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "rest.json"
    path.write_text(DOCUMENTS[kind])
    rate_hz, gyro = read(path)
    assert rate_hz == pytest.approx(RATE_HZ)
    assert gyro == pytest.approx(GYRO)


@pytest.mark.parametrize("kind", ["array", "array over lines", "split", "columns"])
def test_a_document_of_json_that_comes_as_a_stream_is_called_so(kind: str) -> None:
    reader = TextReader("stdin", How())
    assert not reader.feed(DOCUMENTS[kind].encode() + b"\n") + reader.finish()
    assert "is one JSON document" in str(reader.refusal())


def test_a_stream_of_utf_16_is_read_like_a_file(tmp_path: Path) -> None:
    text = lines("time_s,gyro_x_dps\n", lambda k: f"{TIMES[k]},{GYRO[k, 0]}").encode("utf-16")
    reader = TextReader("stdin", How())
    rows = [one for k in range(0, len(text), 7) for one in reader.feed(text[k : k + 7])] + reader.finish()
    assert np.concatenate([one.values for one in rows])[:, 0] == pytest.approx(GYRO[:, 0])


def test_the_times_of_a_message_are_those_of_its_header(tmp_path: Path) -> None:
    path = tmp_path / "echo.csv"
    head = "%time,field.header.stamp," + ",".join(f"field.angular_velocity.{a}" for a in "xyz") + "\n"
    stamp = 1_700_000_000_000_000_000
    path.write_text(
        lines(head, lambda k: f"{stamp + 7 * k * k},{stamp + 20_000_000 * k}," + ",".join(map(str, GYRO[k])))
    )
    assert read(path)[0] == pytest.approx(RATE_HZ)
    assert read(path, How(time_unit="us", overrule=True))[0] == pytest.approx(RATE_HZ / 1000)


def test_times_that_cross_tell_a_mean_by_the_first_and_the_last_of_them(tmp_path: Path) -> None:
    path = tmp_path / "arrivals.csv"
    late = TIMES + 0.05 * (np.arange(N) % 3)
    path.write_text(lines("time_s,gyro_x_dps\n", lambda k: f"{late[k]:.3f},{GYRO[k, 0]}"))
    text = refusal(path)
    assert "times of 'time_s' are earlier than the one before" in text
    assert text.partition("\n")[0].endswith("--rate ?")
    rate_hz = float(text.partition("these times give ")[2].split(" ")[0])
    assert rate_hz == pytest.approx(RATE_HZ, rel=0.06)


@pytest.mark.parametrize(
    ("name", "data", "reason"),
    [
        ("empty.csv", b"", "is empty."),
        ("empty.parquet", b"", "is empty."),
        ("empty_object.tsv", b"{}", "no line of numbers; the first line is '{}'"),
        ("readme.md", b"# Mine\n\nSome words.\n" * 9, "none of its first lines holds a number"),
        ("frame.pkl", b"\x80\x04\x95" + bytes(60), "is a pickle of Python"),
        ("rest.zst", b"(\xb5/\xfd" + bytes(60), "is compressed by zstd"),
    ],
)
def test_what_is_no_recording_is_called_by_its_name(
    tmp_path: Path, name: str, data: bytes, reason: str
) -> None:
    path = tmp_path / name
    path.write_bytes(data)
    assert reason in refusal(path)


def test_a_command_that_converts_can_be_copied_whatever_the_file_is_called(tmp_path: Path) -> None:
    path = tmp_path / "my rest; of today.pkl"
    path.write_bytes(b"\x80\x04\x95" + bytes(60))
    command = refusal(path).rpartition("turn it into CSV: ")[2]
    assert shlex.split(command)[-1] == str(path)


def test_an_archive_without_a_table_is_no_riddle(tmp_path: Path) -> None:
    for name, inner, reason in (
        ("a.docx", "word/document.xml", "is a text of Word"),
        ("b.jar", "x.class", "is an archive without a recording"),
    ):
        with zipfile.ZipFile(tmp_path / name, "w") as archive:
            archive.writestr(inner, "<a/>")
            archive.writestr("other.xml", "<a/>")
        assert reason in refusal(tmp_path / name)
