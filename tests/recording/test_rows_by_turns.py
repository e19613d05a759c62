"""Tables in which the rows of several sensors take turns: the user is asked for one of them."""

import itertools
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from fltea.recording.files import Stored
from fltea.recording.reading import NotStated
from fltea.records.errors import UsageError
from fltea.settings.how import How
from fltea.sources.text_events import TextEvents

from tests.rig.sensor_tables import GYRO, NUMBERS, WORDS, N, assert_is, csv, each_form, refusal, table


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
    """The times of alternating sensors have unequal steps that repeat. They are not taken for bursts of rows,
    nor for an even clock of a higher rate: the user is asked.
    """
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
    """The rows of two sensors alternate, and some rows are lost. If the two sensors' rows have equal times,
    the row that is left of a pair may be of either sensor, so it is left out.

    If their times differ, these show the sensor.
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


@pytest.mark.parametrize("column", ["id", "foo", "port"])
@pytest.mark.parametrize("ids", [NUMBERS, WORDS], ids=["numbers", "words"])
@pytest.mark.parametrize("later_s", [0.0, 0.003, 0.005])
def test_live_rows_by_turns_end_the_reading(column: str, ids: list[str], later_s: float) -> None:
    """The first row alone does not show that rows of several sensors alternate. So the reading begins, and
    ends with an error when later rows show it.
    """
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


def test_rows_that_come_in_bursts_may_be_of_sensors_in_turns(tmp_path: Path) -> None:
    columns = table(NUMBERS, [0, 1] * N, later_s=1e-6)
    del columns["sensor_id"]
    assert "If they are of 2 sensors that take turns: --sensor 1/2" in refusal(csv, tmp_path, columns)
    assert_is(csv(tmp_path, columns, topic="2/2"), 1)


@each_form
@pytest.mark.parametrize("later_s", [0.0, 0.003, 1e-6])
def test_rows_that_the_user_says_are_of_one_sensor_are_asked_only_for_their_rate(
    form: Callable[..., Stored], later_s: float, tmp_path: Path
) -> None:
    columns = table(NUMBERS, [0, 1] * N, later_s=later_s)
    del columns["sensor_id"]
    asked = refusal(form, tmp_path, columns, topic="1/1")
    assert "nothing says the rate, as " in asked
    assert "take turns" not in asked
    assert form(tmp_path, columns, topic="1/1", rate_hz=200.0).samples == 2 * N
