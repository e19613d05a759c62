"""If a table holds rows of several sensors, the user chooses one, and no rows of two sensors are mixed."""

import itertools
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import pytest
import scipy.io
from fltea.recording.csv_file import open_csv
from fltea.recording.files import Stored
from fltea.recording.one_sensor import MOST_SENSORS, OneSensor, as_word
from fltea.recording.reading import NotStated
from fltea.records.errors import UsageError
from fltea.settings.how import How
from fltea.sources.text_events import TextEvents
from hypothesis import given, settings
from hypothesis import strategies as st
from pyarrow import feather, parquet

from tests.rig.table_support import open_here

FILES = itertools.count()
N = 200
GYRO = np.round(np.random.default_rng(11).normal(size=(N, 3, 3)), 4)
"""Angular rates of three sensors."""
AXES = [f"gyro_{axis}_dps" for axis in "xyz"]
NUMBERS, WORDS, DEVICES = ["0", "1", "2"], ["left", "right", "the third"], ["3932170", "3932171", "3932172"]


def table(
    ids: Sequence[str], which: Sequence[int], column: str = "sensor_id", later_s: float = 0.0
) -> dict[str, list[Any]]:
    """Return rows at 100 Hz, each with its sensor's number.

    The second sensor's times are later by `later_s`.
    """
    count = [0] * len(ids)
    rows = []
    for one in which:
        k, count[one] = count[one], count[one] + 1
        value: Any = int(ids[one]) if ids[one].isdecimal() else ids[one]
        rows.append([round(k / 100 + later_s * one, 6), value, *GYRO[k, one].tolist()])
    return dict(zip(["t_s", column, *AXES], map(list, zip(*rows, strict=True)), strict=True))


def text(folder: Path, columns: dict[str, list[Any]], separator: str, quote: str = "", **how: Any) -> Stored:
    def cell(value: Any) -> str:
        return f"{quote}{value}{quote}" if isinstance(value, str) else str(value)

    lines = [
        separator.join(columns),
        *(separator.join(map(cell, row)) for row in zip(*columns.values(), strict=True)),
    ]
    path = folder / "rest.csv"
    path.write_text("\n".join(lines) + "\n")
    return open_csv(path, How(**how))


def csv(folder: Path, columns: dict[str, list[Any]], **how: Any) -> Stored:
    return text(folder, columns, ",", **how)


def quoted(folder: Path, columns: dict[str, list[Any]], **how: Any) -> Stored:
    return text(folder, columns, ";", '"', **how)


def json_lines(folder: Path, columns: dict[str, list[Any]], **how: Any) -> Stored:
    path = folder / "rest.jsonl"
    rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    return open_csv(path, How(**how))


def json_columns(folder: Path, columns: dict[str, list[Any]], **how: Any) -> Stored:
    path = folder / "rest.json"
    path.write_text(json.dumps(columns))
    return open_here("json", path, **how)


def of_parquet(folder: Path, columns: dict[str, list[Any]], **how: Any) -> Stored:
    path = folder / "rest.parquet"
    parquet.write_table(pa.table(columns), path, row_group_size=64)
    return open_here("parquet", path, **how)


def of_categories(folder: Path, columns: dict[str, list[Any]], **how: Any) -> Stored:
    path = folder / "rest.feather"
    made = {
        name: pa.array(values).dictionary_encode() if isinstance(values[0], str) else values
        for name, values in columns.items()
    }
    feather.write_feather(pa.table(made), path, chunksize=64)
    return open_here("feather", path, **how)


def hdf5(folder: Path, columns: dict[str, list[Any]], **how: Any) -> Stored:
    path = folder / f"{next(FILES)}.h5"  # a new name, since h5py may still hold the earlier file open
    with h5py.File(path, "w") as file:
        for name, values in columns.items():
            file[f"imu/{name}"] = values
    return open_here("hdf5", path, **how)


def npz(folder: Path, columns: dict[str, list[Any]], **how: Any) -> Stored:
    arrays: dict[str, Any] = {name: np.array(values) for name, values in columns.items()}
    np.savez(folder / "rest.npz", **arrays)
    return open_here("arrays", folder / "rest.npz", **how)


FORMS = [csv, quoted, json_lines, json_columns, of_parquet, of_categories, hdf5, npz]
each_form = pytest.mark.parametrize("form", FORMS, ids=lambda form: form.__name__)


def refusal(read: Callable[..., Any], *arguments: Any, kind: type[UsageError] = NotStated, **how: Any) -> str:
    with pytest.raises(kind) as caught:
        read(*arguments, **how)
    return str(caught.value)


def assert_is(stored: Stored, sensor: int, count: int = N) -> None:
    """Check that all samples of one sensor are there, and no other."""
    whole = stored.whole()
    assert whole.gyro.tolist() == GYRO[:count, sensor].tolist()
    assert stored.rate_hz == pytest.approx(100)
    assert whole.seq is None or whole.seq.tolist() == [*range(count)]


@each_form
@pytest.mark.parametrize("ids", [NUMBERS, WORDS, DEVICES], ids=["numbers", "words", "devices"])
@pytest.mark.parametrize("later_s", [0.0, 0.003])
def test_one_of_several_is_asked_for_and_read(
    form: Callable[..., Stored], ids: list[str], later_s: float, tmp_path: Path
) -> None:
    """The user is asked for the sensor, whatever the sensors' names and whether their times are equal."""
    columns = table(ids, [0, 1, 2] * N, later_s=later_s)
    asked = refusal(form, tmp_path, columns)
    assert f"which sensor is meant: column sensor_id tells several apart ({ids[0]}, {ids[1]}" in asked
    assert asked.splitlines()[0].endswith("--sensor ?")
    for sensor, name in enumerate(ids[:2]):
        stored = form(tmp_path, columns, topic=name)
        assert_is(stored, sensor)
        (answer,) = [one for one in stored.reading if one.question == "sensor"]
        assert str(answer) == f"sensor_id is {name} (given: --sensor)"
    has = f"no row has nobody in the column sensor_id; it has {', '.join(sorted(ids))}."
    assert has in refusal(form, tmp_path, columns, topic="nobody", kind=UsageError)


@each_form
def test_a_second_sensor_that_comes_late_is_asked_for(form: Callable[..., Stored], tmp_path: Path) -> None:
    """A second sensor that appears only in the last row is asked for. The rows before it are discarded."""
    columns = table(WORDS, [0] * (N - 1) + [1])
    assert "(left, right)" in refusal(form, tmp_path, columns)
    assert_is(form(tmp_path, columns, topic="left"), 0, N - 1)


@each_form
def test_a_column_with_one_value_tells_nothing_apart(form: Callable[..., Stored], tmp_path: Path) -> None:
    for ids in (["7"], ["MPU-6050"]):
        assert_is(form(tmp_path, table(ids, [0] * N)), 0)


@each_form
@pytest.mark.parametrize("column", ["i", "imu"])
def test_a_column_that_counts_the_rows_tells_nothing_apart(
    form: Callable[..., Stored], column: str, tmp_path: Path
) -> None:
    columns = table(["0"], [0] * N, column)
    columns[column] = [*range(N)]
    assert_is(form(tmp_path, columns), 0)


@each_form
def test_any_column_can_be_said_to_tell_them_apart(form: Callable[..., Stored], tmp_path: Path) -> None:
    columns = table(NUMBERS, [0, 1] * N, "port", later_s=0.003)
    assert_is(form(tmp_path, columns, topic="port=1"), 1)


def test_words_that_cannot_be_read_are_no_reason_to_mix(tmp_path: Path) -> None:
    columns = table(WORDS, [0, 1] * N, later_s=0.003)
    path = tmp_path / "rest.mat"
    cells = np.array(columns["sensor_id"], object)
    scipy.io.savemat(
        path, {**{name: np.array(values) for name, values in columns.items()}, "sensor_id": cells}
    )
    assert "sensor_id" in refusal(open_here, "mat", path, kind=UsageError)
    many = {**columns, "sensor_id": [f"row {k}" for k in range(2 * N)]}
    for form in (of_parquet, npz):
        assert "sensor_id: holds" in refusal(form, tmp_path, many, kind=UsageError)


@pytest.mark.parametrize("ids", [NUMBERS, WORDS], ids=["numbers", "words"])
def test_a_row_that_does_not_say_its_sensor_is_of_none(ids: list[str], tmp_path: Path) -> None:
    columns = table(ids, [0] * N)
    columns["sensor_id"][5] = None
    asked = refusal(of_parquet, tmp_path, columns)
    assert f"({', '.join(sorted([ids[0], 'nan']))})" in asked
    assert of_parquet(tmp_path, columns, topic=ids[0]).samples == N - 1


def test_other_rows_of_json_lines_are_left_out(tmp_path: Path) -> None:
    """In JSON lines, rows of another kind of sensor (a barometer) have other keys, and are left out."""
    path = tmp_path / "rest.jsonl"
    lines = []
    for k in range(N):
        lines.append({"t_s": k / 100, "sensor": "baro", "hPa": 1013.2})
        lines += [
            {"t_s": k / 100, "sensor": name, **dict(zip(AXES, GYRO[k, one].tolist(), strict=True))}
            for one, name in enumerate(WORDS[:2])
        ]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    assert "column sensor tells several apart (baro, left, right)" in refusal(open_csv, path, How())
    assert_is(open_csv(path, How(topic="right")), 1)


@each_form
@pytest.mark.parametrize("count", [2, 3])
def test_rows_by_turns(form: Callable[..., Stored], count: int, tmp_path: Path) -> None:
    columns = table(NUMBERS, [*range(count)] * N)
    del columns["sensor_id"]
    asked = refusal(form, tmp_path, columns)
    assert f"whether {count} sensors take turns, or the clock is coarser than the samples" in asked
    for sensor in range(count):
        stored = form(tmp_path, columns, topic=f"{sensor + 1}/{count}")
        assert_is(stored, sensor)
        (answer,) = [one for one in stored.reading if one.question == "sensor"]
        assert str(answer) == f"row {sensor + 1} of every {count} (given: --sensor)"


@pytest.mark.parametrize(("count", "later_s"), [(2, 0.003), (3, 0.002)])
def test_steps_that_come_again_are_sensors_in_turns(count: int, later_s: float, tmp_path: Path) -> None:
    """The times of alternating sensors are not taken for an even clock of a higher rate, nor for bursts."""
    columns = table(NUMBERS, [*range(count)] * N, later_s=later_s)
    del columns["sensor_id"]
    asked = refusal(csv, tmp_path, columns)
    assert f"nothing says whether {count} sensors take turns, or one has uneven times" in asked
    assert f"--sensor 1/{count}: the first of {count} sensors in turns" in asked
    assert_is(csv(tmp_path, columns, topic=f"2/{count}"), 1)


@each_form
@pytest.mark.parametrize("later_s", [0.0, 0.005, 0.003])
def test_rows_by_turns_stay_in_turn_behind_a_lost_row(
    form: Callable[..., Stored], later_s: float, tmp_path: Path
) -> None:
    """If both rows of a pair have the same time and one is lost, the sensor of the other row is unknown.

    If the rows of a pair have different times, these show the sensor.
    """
    columns = table(NUMBERS, [0, 1] * N, later_s=later_s)
    lost = [60, 121, 240, 241, 301]
    kept = {name: np.delete(np.array(values), lost).tolist() for name, values in columns.items()}
    del kept["sensor_id"]
    for sensor in (0, 1):
        out = {row // 2 for row in lost if later_s == 0.0 or row % 2 == sensor}
        stored = form(tmp_path, kept, topic=f"{sensor + 1}/2")
        assert stored.whole().gyro.tolist() == np.delete(GYRO[:, sensor], sorted(out), axis=0).tolist()
        assert stored.rate_hz == pytest.approx(100)


def test_a_torn_row_of_text_takes_its_turn(tmp_path: Path) -> None:
    """Without times, only the order of the rows distinguishes the sensors. So an unreadable line has to be
    counted as a row of the sensor whose turn it is.
    """
    columns = table(NUMBERS, [0, 1] * N)
    del columns["sensor_id"], columns["t_s"]
    columns["gyro_y_dps"][7] = "torn"
    assert_is(csv(tmp_path, columns, topic="1/2", rate_hz=100.0), 0)
    other = csv(tmp_path, columns, topic="2/2", rate_hz=100.0).whole()
    assert other.gyro.tolist() == np.delete(GYRO[:, 1], 3, axis=0).tolist()


@pytest.mark.parametrize("given_", ["0/2", "3/2", "1/17", "1/", "a/2", "-1/2"])
def test_turns_that_cannot_be(given_: str, tmp_path: Path) -> None:
    columns = table(NUMBERS, [0] * N)
    del columns["sensor_id"]
    assert "no column is known that tells sensors apart" in refusal(
        csv, tmp_path, columns, topic=given_, kind=UsageError
    )


@given(
    which=st.lists(st.integers(0, 2), min_size=20, max_size=120),
    ids=st.sampled_from([NUMBERS, WORDS, DEVICES]),
    form=st.sampled_from([csv, json_lines, npz]),
)
@settings(max_examples=40)
def test_samples_of_two_sensors_are_never_mixed(
    tmp_path_factory: pytest.TempPathFactory, which: list[int], ids: list[str], form: Callable[..., Stored]
) -> None:
    columns = table(ids, which)
    folder = tmp_path_factory.getbasetemp()
    if len({*which}) > 1:
        refusal(form, folder, columns)
    for sensor in {*which}:
        if (count := which.count(sensor)) > 1:
            assert_is(form(folder, columns, topic=ids[sensor]), sensor, count)


@given(st.lists(st.lists(st.sampled_from("abc"), max_size=9), max_size=9), st.none() | st.sampled_from("abd"))
def test_it_is_the_same_in_whatever_pieces_rows_come(pieces: list[list[str]], wanted: str | None) -> None:
    sensor = OneSensor("rest", "imu", wanted)
    whole = [one for piece in pieces for one in piece]
    if wanted is None and len({*whole}) > 1:
        with pytest.raises(NotStated):
            [sensor.keep(piece) for piece in pieces]
        return
    kept = [mark for piece in pieces for mark in sensor.keep(piece).tolist()]
    assert kept == [one == (wanted or whole[0]) for one in whole]
    assert (sensor.why_none() is not None) == (bool(whole) and not any(kept))


def test_a_column_of_many_values_does_not_fill_the_memory() -> None:
    sensor = OneSensor("rest", "i", "0")
    for k in range(100):
        sensor.keep([str(1000 * k + j) for j in range(100)])
    assert len(sensor.others) < MOST_SENSORS + 102


def test_numbers_as_they_are_typed() -> None:
    assert [*map(as_word, (1.0, 3932171.0, 1e-7, 2.5))] == ["1", "3932171", "1e-07", "2.5"]


def test_live_rows_of_a_second_sensor_end_the_reading() -> None:
    columns = table(WORDS, [0] * (N - 20) + [1] * 20)
    lines = [",".join(columns), *(",".join(map(str, row)) for row in zip(*columns.values(), strict=True))]
    data = "".join(line + "\n" for line in lines).encode()
    live = TextEvents("stdin:", How(), fatal=False)
    live.open(0, within_line=False)
    list(live.feed(data[:5000], 0))
    with pytest.raises(NotStated, match="which sensor is meant"):
        list(live.feed(data[5000:], 0))


@pytest.mark.parametrize("column", ["id", "foo", "port"])
@pytest.mark.parametrize("ids", [NUMBERS, WORDS], ids=["numbers", "words"])
@pytest.mark.parametrize("later_s", [0.0, 0.003, 0.005])
def test_live_rows_by_turns_end_the_reading(column: str, ids: list[str], later_s: float) -> None:
    """The first row alone does not show that rows of several sensors alternate."""
    columns = table(ids, [0, 1] * N, column, later_s)
    lines = [",".join(columns), *(",".join(map(str, row)) for row in zip(*columns.values(), strict=True))]
    live = TextEvents("stdin:", How(), fatal=False)
    live.open(0, within_line=False)
    data = [f"{line}\n".encode() for line in lines]
    with pytest.raises(NotStated, match=f"column {column} tells several apart .{ids[0]}, {ids[1]}"):
        list(itertools.chain.from_iterable(live.feed(line, 0) for line in data))


@each_form
@pytest.mark.parametrize("column", ["id", "DeviceName", "foo"])
@pytest.mark.parametrize("later_s", [0.0, 0.003, 0.005])
def test_alike_sensors_are_told_by_their_turns(
    form: Callable[..., Stored], column: str, later_s: float, tmp_path: Path
) -> None:
    """The user is asked for a sensor by its number, whatever the name of the column with the numbers."""
    columns = table(NUMBERS, [0, 1] * N, column, later_s)
    asked = refusal(form, tmp_path, columns)
    assert f"which sensor is meant: column {column} tells several apart (0, 1)" in asked
    assert "--sensor 1: " in asked
    assert_is(form(tmp_path, columns, topic="1"), 1)
    assert_is(form(tmp_path, columns, topic=f"{column}=0"), 0)
    columns["t_s"] = [row / 100 for row in range(2 * N)]
    assert form(tmp_path, columns, topic="1/1").samples == 2 * N


def side_by_side(folder: Path, **how: Any) -> Stored:
    """Return data of two Shimmer sensors as ConsensysPRO writes them.

    The rates of the second sensor are three times those of the first.
    """
    names = [f"Shimmer_{of}_{name}_CAL" for of in ("B5A1", "B5A12") for name in ("Timestamp_Unix", *SHIMMER)]
    units = ["ms", *["deg/s"] * 3] * 2
    rows = [
        [1.7e12 + 10 * k, *GYRO[k, 0].tolist(), 1.7e12 + 10 * k + 3, *(3 * GYRO[k, 0]).tolist()]
        for k in range(N)
    ]
    lines = [",".join(names) + ",", ",".join(units) + ",", *(",".join(map(repr, row)) + "," for row in rows)]
    path = folder / "rest.csv"
    path.write_text("\n".join(["sep=,", *lines]) + "\n")
    return open_csv(path, How(**how))


SHIMMER = [f"Gyro_{axis}" for axis in "XYZ"]


@pytest.mark.parametrize("by_position", [False, True])
@pytest.mark.parametrize(("sensor", "first"), [("B5A1", 2), ("B5A12", 6)])
def test_sensors_side_by_side_are_asked_for_and_named(
    by_position: bool, sensor: str, first: int, tmp_path: Path
) -> None:
    """Each sensor has its own column of times."""
    asked = refusal(side_by_side, tmp_path)
    assert asked.startswith(f"{tmp_path}/rest.csv:2: nothing says which columns are the gyroscope's axes")
    assert "6  Shimmer_B5A12_Gyro_X_CAL: mean" in asked
    names = [f"Shimmer_{sensor}_{name}_CAL" for name in SHIMMER]
    columns = [str(first + k) for k in range(3)] if by_position else names
    stored = side_by_side(tmp_path, columns=columns)
    (clock,) = [answer for answer in stored.reading if answer.question == "clock"]
    assert f"the times of Shimmer_{sensor}_Timestamp_Unix_CAL" in clock.why
    assert np.allclose(stored.whole().gyro, GYRO[:, 0] * (3 if first > 2 else 1))


def test_rows_that_come_in_bursts_may_be_of_sensors_in_turns(tmp_path: Path) -> None:
    columns = table(NUMBERS, [0, 1] * N, later_s=1e-6)
    del columns["sensor_id"]
    assert "If they are of 2 sensors that take turns: --sensor 1/2" in refusal(csv, tmp_path, columns)
    assert_is(csv(tmp_path, columns, topic="2/2"), 1)
