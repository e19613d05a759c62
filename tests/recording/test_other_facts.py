"""Tests texts in blocks: what a line between the rows says of those below it is never ignored in silence."""

from pathlib import Path

import numpy as np
import pytest
from fltea.recording.files import Stored

from tests.rig.text_files import stored

N = 300
NAMES, BARE = "t,gx,gy,gz", "t,x,y,z"
GIVEN = {"columns": ["x", "y", "z"], "units": "deg/s"}


def rows(first: float = 0.0, begin: int = 0) -> list[str]:
    """Return rows of 100 Hz with their times, from row `begin` on. The numbers are near `first`."""
    values = first + np.random.default_rng(1).normal(0, 1, (N, 3))
    return [f"{k / 100:.2f},{x:.4f},{y:.4f},{z:.4f}" for k, (x, y, z) in enumerate(values, begin)]


def counts() -> list[str]:
    return [f"{k / 100:.2f},{k % 7},{k % 5},{k % 3}" for k in range(N)]


def text_of(*blocks: str | list[str]) -> str:
    return "".join(f"{one if isinstance(one, str) else chr(10).join(one)}\n" for one in blocks)


def said_below(found: Stored) -> list[str]:
    return [note.text for note in found.notes if "rows below" in note.text]


@pytest.mark.parametrize("unit", ["m/s^2", "g", "uT", "deg", "LSB"])
@pytest.mark.parametrize("names", [NAMES, BARE])
def test_rows_below_a_row_of_units_of_another_quantity_are_left_out(
    unit: str, names: str, tmp_path: Path
) -> None:
    how = GIVEN if names == BARE else {}
    head, other = f"{names}\ns,deg/s,deg/s,deg/s", f"{names}\ns,{unit},{unit},{unit}"
    found = stored(tmp_path, text_of(head, rows(), other, rows(100), head, rows()), **how)
    assert found.samples == 2 * N
    assert np.abs(found.whole().gyro).max() < 20
    assert said_below(found)


def test_a_row_of_units_as_above_the_first_row_goes_on(tmp_path: Path) -> None:
    """A file whose units the user corrects has the same row of units again."""
    head = f"{BARE}\ns,deg,deg,deg"
    found = stored(tmp_path, text_of(head, rows(), head, rows()), **GIVEN, overrule=True)
    assert found.samples == 2 * N
    assert not said_below(found)


@pytest.mark.parametrize("form", ["[{}]", "({})"])
def test_a_row_of_units_in_brackets_is_one(form: str, tmp_path: Path) -> None:
    units = [",".join(map(form.format, ("s", *[unit] * 3))) for unit in ("deg/s", "rad/s")]
    head = f"{NAMES}\n{units[0]}"
    found = stored(tmp_path, text_of(head, rows(), units[1], rows(100), head, rows()))
    assert found.samples == 2 * N
    assert said_below(found)


FIRST = "# t_s,gx [dps],gy [dps],gz [dps]"


@pytest.mark.parametrize(
    "other",
    [
        FIRST.replace("dps", "rad/s"),
        FIRST.replace("dps", "g"),
        FIRST.replace("t_s", "t_ms"),
        "# t_s,gz [dps],gy [dps],gx [dps]",
        "# gx [dps],gy [dps],gz [dps],t_s",
    ],
)
def test_rows_below_names_in_a_comment_that_say_otherwise_are_left_out(other: str, tmp_path: Path) -> None:
    """Two files of numpy's savetxt, one after the other."""
    found = stored(tmp_path, text_of(FIRST, rows(), other, rows(100), FIRST, rows()))
    assert found.samples == 2 * N
    assert np.abs(found.whole().gyro).max() < 20
    assert said_below(found)


@pytest.mark.parametrize("again", [FIRST, "# t_s,gx,gy,gz", "# t_s,gx [deg/s],gy [deg/s],gz [deg/s]"])
def test_rows_below_names_in_a_comment_that_agree_go_on(again: str, tmp_path: Path) -> None:
    found = stored(tmp_path, text_of(FIRST, rows(), again, rows()))
    assert (found.samples, said_below(found)) == (2 * N, [])


def test_a_row_that_is_commented_out_gives_no_names(tmp_path: Path) -> None:
    how = {"columns": ["2", "3", "4"], "units": "deg/s", "rate_hz": 100.0}
    found = stored(tmp_path, text_of(rows(), "# 1, 4, 3, 2", rows(begin=N)), **how)
    assert (found.samples, said_below(found)) == (2 * N, [])


@pytest.mark.parametrize(
    "title",
    [
        "# accelerometer in g",
        "# accelerometer in m/s^2",
        "# Accelerometer data in m/s²:",
        "[accel]",
        "--- ACC ---",
        "=== Magnetometer ===",
        "# Beschleunigung (g)",
        "# Beschleunigungssensor",
        "# accéléromètre",
    ],
)
def test_rows_below_the_title_of_another_sensor_are_left_out(title: str, tmp_path: Path) -> None:
    text = text_of("# gyroscope in deg/s", BARE, rows(), title, BARE, rows(100))
    found = stored(tmp_path, text, columns=["x", "y", "z"])
    assert found.samples == N
    assert said_below(found)
    again = text + text_of("# gyroscope in deg/s", BARE, rows())
    assert stored(tmp_path, again, columns=["x", "y", "z"]).samples == 2 * N


@pytest.mark.parametrize(
    "title", ["Gyroscope (rad/s)", "# gyroscope in rad/s", "; unit rad/s", "# now rad/s"]
)
def test_a_line_of_another_unit_of_the_gyroscope_is_heard(title: str, tmp_path: Path) -> None:
    head = "Gyroscope (deg/s)"
    found = stored(tmp_path, text_of(head, NAMES, rows(), title, rows(100), head, NAMES, rows()))
    assert found.samples == 2 * N
    assert said_below(found)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("# range: 250 dps", "# range: 500 dps"),
        ("# gyro full scale +-250 deg/s", "# gyro full scale +-500 deg/s"),
        ("# 131 LSB per dps", "# 65.5 LSB per dps"),
    ],
)
def test_counts_of_another_range_or_scale_are_left_out(first: str, second: str, tmp_path: Path) -> None:
    how = {"units": "lsb:131"}
    text = text_of(first, NAMES, counts(), second, counts(), first, NAMES, counts())
    found = stored(tmp_path, text, **how)
    assert found.samples == 2 * N
    assert said_below(found)
    same = stored(tmp_path, text_of(first, NAMES, counts(), first, counts()), **how)
    assert (same.samples, said_below(same)) == (2 * N, [])
    if "LSB" not in second:
        rates = stored(tmp_path, text_of(first, "t,gx [dps],gy [dps],gz [dps]", rows(), second, rows()))
        assert (rates.samples, said_below(rates)) == (2 * N, [])


@pytest.mark.parametrize(
    "line", ["# Schwerefeld (g)", "# now the other values in uT", "# values of board 2, rad/s"]
)
def test_a_comment_with_a_unit_that_is_not_understood_is_noted(line: str, tmp_path: Path) -> None:
    """No rule says of which rows it speaks, so they are read as before, but not in silence."""
    found = stored(tmp_path, text_of("t,gx [dps],gy [dps],gz [dps]", rows(), line, rows(begin=N)))
    assert found.samples == 2 * N
    (note,) = found.notes
    assert note.text.endswith(f"rest.csv:{N + 2}: {line!r}: the rows below this comment are read as before.")


@pytest.mark.parametrize(
    "line", ["# temperature 25 C", "# battery 3.7 V", "# restart after 5 s", "# 12:30", "# ok"]
)
def test_ordinary_comments_have_no_note(line: str, tmp_path: Path) -> None:
    found = stored(tmp_path, text_of("t,gx [dps],gy [dps],gz [dps]", rows(), line, rows(begin=N)))
    assert (found.samples, found.notes) == (2 * N, ())
