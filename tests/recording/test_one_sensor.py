"""If a table holds rows of several sensors, the user chooses one, and no rows of two sensors are mixed."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
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

from tests.rig.sensor_tables import (
    AXES,
    DEVICES,
    GYRO,
    NUMBERS,
    WORDS,
    N,
    assert_is,
    csv,
    each_form,
    json_lines,
    npz,
    of_parquet,
    refusal,
    table,
)
from tests.rig.table_support import open_here


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
