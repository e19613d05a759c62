"""Tests which columns the user means by a name without its unit, or by a position beside names; and titles of
three columns.
"""

from pathlib import Path

import numpy as np
import pytest
from fltea.recording.axis_titles import without_titles

from tests.rig.text_files import refusal, stored

HEADER = "stamp_s,gx [dps],gy [dps],gz [dps]"


def text_of(header: str, *, separator: str = ",", columns: int = 3) -> str:
    values = np.random.default_rng(1).normal(0, 1, (400, columns)) + range(10, 10 * columns + 10, 10)
    rows = [separator.join([f"{k / 100:.2f}", *(f"{v:.4f}" for v in row)]) for k, row in enumerate(values)]
    return "\n".join([header, *rows]) + "\n"


@pytest.mark.parametrize(
    ("columns", "time_column"),
    [
        (None, "1"),
        (None, "stamp"),
        (["gx", "gy", "gz"], None),
        (["gx", "gy [dps]", "gz"], "stamp_s"),
        (["gx", "gy", "gz"], "1"),
        (["2", "3", "4"], "stamp"),
        (["gx", "3", "gz"], "stamp"),
        (["2", "3", "4"], "1"),
    ],
)
def test_a_name_may_lack_its_unit_and_stand_beside_positions(
    columns: list[str] | None, time_column: str | None, tmp_path: Path
) -> None:
    found = stored(tmp_path, text_of(HEADER), columns=columns, time_column=time_column)
    assert found.whole().gyro.mean(axis=0) == pytest.approx([10, 20, 30], abs=0.5)
    reading = {one.question: one for one in found.reading}
    assert reading["columns"].value == "gx [dps], gy [dps], gz [dps] as x, y, z"
    assert reading["unit"].value == "deg/s"
    assert reading["clock"].why == "the times of stamp_s in s"


def test_a_name_that_two_columns_have_before_their_units_means_none(tmp_path: Path) -> None:
    text = text_of("stamp_s,gx [dps],gx [rad/s],gz [dps]")
    said = "which column gx means is not known: gx [dps], gx [rad/s]; give its whole name"
    assert f"{said}." in refusal(tmp_path, text, columns=["gx", "gz"])
    assert f"no column g4 (it has: stamp_s, gx [dps], gx [rad/s], gz [dps]); and {said}." in refusal(
        tmp_path, text, columns=["gx", "g4"]
    )


@pytest.mark.parametrize(
    ("how", "lacking"),
    [
        ({"columns": ["gx", "gy", "hz"]}, "hz (it has: stamp_s, gx [dps], gy [dps], gz [dps])"),
        ({"columns": ["2", "3", "4"], "time_column": "t"}, "t (it has: "),
        ({"time_column": "9"}, "9 (it has 4)"),
    ],
)
def test_the_message_names_the_column_that_is_lacking_alone(
    how: dict[str, object], lacking: str, tmp_path: Path
) -> None:
    assert f": no column {lacking}" in refusal(tmp_path, text_of(HEADER), **how)


TITLE = "Gyro X (deg/s), Gyro Y (deg/s), Gyro Z (deg/s) as x, y, z"


@pytest.mark.parametrize(
    ("header", "separator"),
    [
        ("Time (s),Gyro X,Y,Z (deg/s)", ","),
        ("Time (s),Gyro X, Y, Z (deg/s)", ","),
        ("Time (s),Gyro (X,Y,Z) (deg/s)", ","),
        ('Time (s),"Gyro X,Y,Z (deg/s)"', ","),
        ("Time (s),Gyro X/Y/Z (deg/s)", ","),
        ("Time (s);Gyro X,Y,Z (deg/s)", ";"),
        ("Time (s)\tGyro X,Y,Z (deg/s)", "\t"),
    ],
)
def test_a_title_of_three_columns_names_each(header: str, separator: str, tmp_path: Path) -> None:
    found = stored(tmp_path, text_of(header, separator=separator))
    reading = {one.question: one.value for one in found.reading}
    assert (reading["columns"], reading["unit"]) == (TITLE, "deg/s")
    assert found.whole().gyro.mean(axis=0) == pytest.approx([10, 20, 30], abs=0.5)


@pytest.mark.parametrize("order", ["ZYX", "YXZ", "zxy"])
@pytest.mark.parametrize("separator", [",", ";", "/"])
def test_a_title_may_have_its_axes_in_any_order(order: str, separator: str, tmp_path: Path) -> None:
    mark = "/" if separator == "/" else ","
    header = f"Time (s),Gyro {mark.join(order)} (deg/s)"
    text = text_of(header.replace(",", separator, 1), separator="," if separator == "/" else separator)
    mean = stored(tmp_path, text.replace("Time (s)/", "Time (s),")).whole().gyro.mean(axis=0)
    assert mean.tolist() == pytest.approx([10 * (order.upper().index(axis) + 1) for axis in "XYZ"], abs=0.5)


def test_columns_by_position_below_a_title_are_in_its_unit(tmp_path: Path) -> None:
    """The unit stands after the last axis alone, and is that of all three."""
    text = text_of("Time (s),Gyro X,Y,Z (deg/s)")
    why = "Gyro X (deg/s) is in deg/s by its name or the row of units, and --units rad/s says otherwise"
    assert why in refusal(tmp_path, text, columns=["2"], time_column="1", units="rad/s")


@pytest.mark.parametrize(
    "names",
    [
        ["t", "x", "y", "z"],
        ["gx", "gy", "gz [dps]"],
        ["Gyro X [dps]", "Y", "Z"],
        ["x", "y [m]", "z [m]"],
        ["Gyro X", "X", "Z [dps]"],
    ],
)
def test_other_names_are_no_titles(names: list[str]) -> None:
    assert without_titles(names) == names
