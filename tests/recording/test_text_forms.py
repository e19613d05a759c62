"""Tests texts as other programs write them: separators, headers, comments, missing numbers, times."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.rig.text_files import refusal, stored

DEG = 180 / np.pi
GYRO = [[1.5, 2.5, 3.5], [4.0, 5.0, -6.0], [7.0, 8.0, 9.0]]
OURS = "time_s,gyro_x_dps,gyro_y_dps,gyro_z_dps\n"
S, MS = ("0", "0.1", "0.2"), ("0", "100", "200")
NS = [f"{1403636579758555392 + k * 100_000_000}" for k in range(3)]
ECHOED = [f"{1.6e18 + k * 1.01e8:.0f},{1.6e18 + k * 1e8:.0f},imu" for k in range(3)]


def rows(
    separator: str = ",", decimal: str = ".", times: Sequence[str] = S, rads: bool = False, end: str = "\n"
) -> str:
    """Return GYRO at 10 Hz, each row preceded by its time."""
    numbers = (
        [time, *(repr(v / DEG if rads else v) for v in row)] for time, row in zip(times, GYRO, strict=True)
    )
    return "".join(separator.join(row).replace(".", decimal) + end for row in numbers)


def ours(separator: str, decimal: str = ".") -> str:
    return OURS.replace(",", separator) + rows(separator, decimal)


FORMS: dict[str, str | bytes] = {
    "semicolons": ours(";"),
    "tabs": ours("\t"),
    "blanks, in columns": OURS.replace(",", "  ") + " 0    1.5 2.5  3.5\n 0.1  4 5 -6 \n 0.2 7  8 9\n",
    "decimal commas": ours(";", ","),
    "decimal commas, and numbers without": ours(";", ",").replace(",0", ""),
    "decimal commas and tabs": ours("\t", ","),
    "decimal commas and blanks": ours(" ", ","),
    "comments": "# a logger\n// of mine\n" + OURS + "% go\n" + rows(end="\n#\n\n") + "# end\n",
    "titles": "IMU log of today\nrange 2000 dps\n" + ours(","),
    "units in a second line": "time,gx,gy,gz,ax\n[ms],[deg/s],[deg/s],[deg/s],[g]\n"
    + rows(times=MS, end=",0\n"),
    "the header is a comment": "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
    "a_RS_S_x [m s^-2]\n" + rows(times=NS, rads=True, end=",9.81\n"),
    "as rostopic echo -p": "%time,field.header.stamp,field.header.frame_id,field.angular_velocity.x,"
    "field.angular_velocity.y,field.angular_velocity.z,field.angular_velocity_covariance0\n"
    + rows(times=ECHOED, rads=True, end=",0\n"),
    "no header": rows(),
    "no header and a rate": rows(" ", times="000"),
    "no header, as many names": "1.5 2.5 3.5\n4 5 -6\n7 8 9\n",
    "positions under a header": "p,q,r,s\n" + rows(),
    "columns of text beside": "note,time_ms,gx,gy,gz,state\n"
    "a,0,1.5,2.5,3.5,on\nb c,100,4,5,-6,\n,200,7,8,9,NaN\n",
    "names in quotes, units in brackets": '"Time (us)";"Gyro X [°/s]";"Gyro Y [°/s]";"Gyro Z [°/s]"\n'
    + rows(";", times=("5", "100005", "200005")),
    "units as Windows writes them": ("time_s,gx [°/s],gy [°/s],gz [°/s]\n" + rows()).encode("cp1252"),
    "empty columns at the end": OURS + rows(end=",\n"),
    "milliseconds by what the user says": "t,gx,gy,gz\n" + rows(times=MS),
    "a mark of UTF-8, and blank lines": "\ufeff" + OURS + "\n" + rows(end="\n\n"),
    "blanks around": ours(" , "),
    "quotes, and a surplus field": OURS + '"0","1.5","2.5","3.5"\n0.1,4,5,-6,surplus\n0.2,7,8,9\n',
    "columns that are named, in their order": "t,a,b,c,note\n0,3.5,1.5,2.5,a\n0.1,-6,4,5,b\n0.2,9,7,8,c\n",
    "no line end at the end": ours(",").rstrip(),
}
BY_POSITION: dict[str, object] = {"columns": ["2", "3", "4"], "time_column": "1", "units": "dps"}
HOW: dict[str, dict[str, object]] = {
    "as rostopic echo -p": {"units": "rad/s", "time_column": "field.header.stamp", "time_unit": "ns"},
    "no header": BY_POSITION,
    "no header and a rate": {"columns": ["2", "3", "4"], "rate_hz": 10.0, "units": "dps"},
    "no header, as many names": {"columns": ["a", "b", "c"], "rate_hz": 10.0, "units": "dps"},
    "positions under a header": BY_POSITION,
    "columns of text beside": {"units": "dps"},
    "milliseconds by what the user says": {"units": "dps", "time_unit": "ms"},
    "columns that are named, in their order": {"columns": ["b", "c", "a"], "units": "dps"},
}
"""Options that some of these texts need."""


@pytest.mark.parametrize("name", FORMS)
@pytest.mark.parametrize("ends", ["\n", "\r\n"])
def test_forms_that_mean_the_same(name: str, ends: str, tmp_path: Path) -> None:
    text = FORMS[name]
    data = text if isinstance(text, bytes) else text.encode()
    found = stored(tmp_path, data.replace(b"\n", ends.encode()), **HOW.get(name, {}))
    whole = found.whole()
    assert whole.gyro == pytest.approx(np.array(GYRO), rel=1e-12)
    assert found.rate_hz == pytest.approx(10.0, rel=1e-6)
    assert whole.device_s == pytest.approx([0, 0.1, 0.2], abs=1e-6)
    assert (found.notes, whole.lsb_per_dps, whole.host_s, whole.accel) == ((), None, None, None)


NAMES = [
    "gyro_{}",
    "Gyro{}",
    "g{}",
    "w{}",
    "omega_{}",
    "angular_velocity.{}",
    "angular_velocity_{}",
    "gyroscope_{}",
    "GYR {}",
    "imu0.gyro.{}",
    "gyro_{}_rads",
    "ang_vel_{} (rad/s)",
    "Gyroscope {} (rad/s)",
]


@pytest.mark.parametrize("name", NAMES)
def test_names_that_other_loggers_use(name: str, tmp_path: Path) -> None:
    header = ",".join([name.format(axis) for axis in "zyx"] + ["ax", "ay", "az", "temp"])
    found = stored(tmp_path, f"{header}\n1,2,3,4,5,6,7\n", rate_hz=10.0, units="rad/s")
    assert found.whole().gyro[0] == pytest.approx([3 * DEG, 2 * DEG, 1 * DEG])
    if "rad" in name:
        assert stored(tmp_path, f"{header}\n1,2,3,4,5,6,7\n", rate_hz=10.0).whole().gyro[0, 0] == 3 * DEG
    else:
        assert "nothing says the unit" in refusal(tmp_path, f"{header}\n1,2,3,4,5,6,7\n", rate_hz=10.0)


def test_names_that_count_the_axes(tmp_path: Path) -> None:
    text = "timestamp,gyro_rad[0],gyro_rad[1],gyro_rad[2],dt\n" + "".join(
        f"{k * 5000},1,2,3,0\n" for k in range(9)
    )
    found = stored(tmp_path, text, time_unit="us")
    assert found.rate_hz == pytest.approx(200.0)
    assert found.whole().gyro[0] == pytest.approx([DEG, 2 * DEG, 3 * DEG])
    # the dialect is recognised: names and units are those of PX4's sensor_combined
    assert stored(tmp_path, text).rate_hz == pytest.approx(200.0)


@pytest.mark.parametrize(
    "header",
    [
        "alpha_gyro_x,std_gyro_x",
        "ax,ay,az",
        "gain,weight",
        "imu0_gyro_x,imu1_gyro_x",
        "x,y,z",
        "gyro_x_dps_std",
    ],
)
def test_names_that_leave_a_doubt_are_not_taken(header: str, tmp_path: Path) -> None:
    row = ",".join("1" for _ in header.split(","))
    assert "nothing says which columns are the gyroscope's axes" in refusal(
        tmp_path, f"{header}\n{row}\n", rate_hz=10.0, units="dps"
    )


BAD: dict[str, tuple[Any, ...]] = {
    "two columns of a name": (
        "gx,gx,gy\n1,2,3\n",
        {"columns": ["gx"], "rate_hz": 1.0},
        ":1: 2 columns are called gx",
    ),
    "two of ours": ("gyro_x_dps,gyro_x_dps\n1,2\n", {"rate_hz": 1.0}, "nothing says which columns"),
    "a column named twice": ("gx,gy\n1,2\n", {"columns": ["gx", "gx"]}, "gx is named twice"),
    "no column named": ("gx,gy\n1,2\n", {"columns": ["", " "]}, "--columns names no column"),
    "two columns of times": (
        "time,timestamp,gyro_x_dps\n1,2,3\n",
        ":1: nothing says which column has the times (time, timestamp)",
        "--time-column ?",
    ),
    "no such column of times": (
        "t,gyro_x_dps\n0,1\n",
        {"time_column": "tt"},
        "no column tt (it has: t, gyro_x_dps)",
    ),
    "units that differ": ("t,gx [dps],gy [rad/s]\n0,1,1\n", "gx [dps] in deg/s, gy [rad/s] in rad/s"),
    "radians by their name": (
        "t,radx\n0,1\n",
        {"columns": ["radx"]},
        ":1: nothing says the unit of radx. Say it",
        "--columns radx --units ?",
    ),
    "counts without their scale": (
        "t,gx,gy\n0,1,1\n1,-1,1\n2,1,-1\n3,0,2\n",
        "nothing says the unit of gx, gy",
        "--units lsb:131",
        "--units ?",
    ),
    "decimal commas among commas": (
        OURS + "0,01,1,5,2,5,3,5\n",
        ":2: has 8 fields, and there are 4 columns. If the numbers have decimal commas",
    ),
    "a decimal comma in a later row": (
        "t,gx,gy,gz,note\n0,1,2,3,a\n1,1,2,3,a b\n2,1,2,3,5,4\n",
        {"units": "dps"},
        "the first is 4: has 6 fields, and there are 5 columns",
    ),
    "thousands": (OURS.replace(",", ";") + "0;1.000,5;2,5;1\n", ":2: column 'gyro_x_dps': '1.000,5' is not"),
    "a word before the names": (
        "# columns: t gx gy\n0 1 2\n1 1 2\n",
        {"units": "dps"},
        ":2: has 3 fields, and the header names 4 columns",
    ),
    "positions beyond": ("1 2 3\n", {"columns": ["4"], "rate_hz": 1.0}, "no column 4"),
    "no header and no positions": ("1,2,3\n4,5,6\n", {"rate_hz": 1.0}, "--rate 1 --columns ?,?,? --units ?"),
    "nothing but text": (OURS + "0,x,2,3\n1,x,2,3\n", ":2: column 'gyro_x_dps': 'x' is not a number"),
    "a unit of times against the header": (
        OURS + "0,1,2,3\n",
        {"time_unit": "ms"},
        ":1: the column time_s is in s by its name or line of units, and --time-unit ms says otherwise",
    ),
    "an empty axis": (OURS + "0,1,2,\n1,2,3,\n", ":2: column gyro_z_dps is empty"),
    "nothing": ("", "none of its first lines holds a number"),
    "other names": ("p,q\n1,2\n", "which columns are the gyroscope's axes", "--columns ?,?,?"),
    "a header alone": (OURS, "no rows"),
    "a header and blank lines": (OURS + "\n\n", "no rows"),
    "a word": (OURS + "0,1,2,3\n1,4,five,6\n", "the first is 3: ", "'gyro_y_dps'", "'five' is not a number"),
    "a word after blank lines": (OURS + "\n\n0,1,2,3\n\n1,x,5,6\n", "the first is 6: ", "'x'"),
    "a short row": (OURS + "0,1,2,3\n1,4\n", "the first is 3: has 2 fields", "'gyro_y_dps' is number 3"),
    "a decimal comma in quotes": (OURS + '0,"1,5",2,3\n', ":2: ", "'1,5' is not a number"),
    "an underscore": ("gx\n1_0\n", {"units": "dps", "rate_hz": 9.0}, "'1_0' is not a number"),
    "infinity": (OURS + "0,-inf,2,3\n", ":2: column gyro_x_dps is empty"),
    "too large": (OURS + "0,1e99,2,3\n", ":2: more than 1e+06 deg/s"),
    "no time": (OURS + "nan,1,2,3\n", ":2: column time_s is empty"),
    "times that stand": (
        OURS + "0,1,2,3\n1,4,5,6\n1,4,5,7\n",
        "1 of 3 times of 'time_s' are the same as the one before, the first in line 4",
    ),
    "times that run backwards": (
        OURS + "0,1,2,3\n2,4,5,6\n\n1,4,5,6\n3,1,1,1\n",
        "1 of 4 times of 'time_s' are earlier",
        "in line 5",
        "--rate ?",
    ),
    "neither times nor a rate": (
        "gyro_x_dps\n1\n2\n",
        "nothing says the rate, as there is no column of times",
        "--rate ?",
    ),
    "one time": ("time_s,gyro_x_dps\n0,1\n", "--rate"),
    "not UTF-8": (OURS.encode() + b"0,1,\xff,2\n", ":2: column 'gyro_y_dps': 'ÿ' is not a number"),
    "columns that are not there": (
        "gx,gy\n1,2\n",
        {"columns": ["gx", "wy", "wz"]},
        "no column wy, wz (it has: gx, gy)",
    ),
    "more columns than axes": ("a,b,c,d\n1,2,3,4\n", {"columns": ["a", "b", "c", "d"]}, "4 columns"),
    "nothing in whole rows": (OURS + "0,,2,\n1,2,,\n2,,,3\n", ":2: no row has numbers in all columns"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_not_clear_is_refused(name: str, tmp_path: Path) -> None:
    text, *words = BAD[name]
    how = words.pop(0) if isinstance(words[0], dict) else {}
    reason = refusal(tmp_path, text, **how)
    assert [word for word in words if word not in reason] == []


MISSING = ["", "nan", "NaN", "NA", "null", "None", "N/A", ' "" ']


@pytest.mark.parametrize("separator", [",", ";", "\t", " "])
@pytest.mark.parametrize("timed", [True, False])
def test_what_is_missing_is_a_gap_and_counted(separator: str, timed: bool, tmp_path: Path) -> None:
    for word in MISSING if separator in ",;" else MISSING[1:-1]:
        rows = [[f"{k / 10}", "1", f"{k}", "2"] for k in range(10)]
        rows[0][3] = rows[4][1] = rows[5][2] = word
        text = OURS + "".join(",".join(row) + "\n" for row in rows)
        found = stored(tmp_path, text.replace(",", separator), **({} if timed else {"rate_hz": 10.0}))
        whole = found.whole()
        assert whole.gyro[:, 1].tolist() == [1, 2, 3, 6, 7, 8, 9]
        assert np.diff(whole.device_s) == pytest.approx([0.1, 0.1, 0.3, 0.1, 0.1, 0.1])
        assert whole.seq is not None
        assert np.diff(whole.seq).tolist() == [1, 1, 3, 1, 1, 1]
        (note,) = found.notes
        assert note.kind == "missing_numbers"
        assert ":2: the first of 3 rows (of 10)" in note.text


@pytest.mark.parametrize(
    "header", ["t [ms],wx [rad/s],note\n", "# t_ms,wx_rads,note\n", "a title\nt,x,note\nms,rad/s,-\n"]
)
def test_positions_have_the_units_of_the_header_above(header: str, tmp_path: Path) -> None:
    text = header + "0,1,a\n10,2,b\n20,3,c\n"
    found = stored(tmp_path, text, columns=["2"], time_column="1")
    assert found.rate_hz == pytest.approx(100.0)
    assert found.whole().gyro.ravel() == pytest.approx([DEG, 2 * DEG, 3 * DEG])
    assert "--units dps says otherwise" in refusal(tmp_path, text, columns=["2"], units="dps", rate_hz=9.0)


@pytest.mark.slow
def test_the_header_has_to_stand_near_the_beginning(tmp_path: Path) -> None:
    assert "holds a number" in refusal(tmp_path, "# a remark\n" * 200_000 + OURS + "0,1,2,3\n")


ODD: dict[str, tuple[Any, ...]] = {
    "a unit behind a blank among blanks": ("t [s] gx gy\n0 1 2\n0.1 1 2\n", {"units": "dps"}, [1, 2, 1, 2]),
    "names that are numbers": ("time_s,2,3\n0,1,5\n0.1,2,6\n", {"columns": ["3"], "units": "dps"}, [5, 6]),
    "one column with decimal commas": ("gyro_x_dps\n0,5\n-1,5\n2\n", {"rate_hz": 10.0}, [0.5, -1.5, 2.0]),
    "commas in quotes are text": (
        'note,t,gx\na,0,1\n"a, b, 5, 6",0.1,2\nb,0.2,3,more\n',
        {"units": "dps"},
        [1, 2, 3],
    ),
    "the axes that are there": ("gyro_z_dps,gyro_x_dps\n3,1\n", {"rate_hz": 10.0}, [1, 3]),
    "rows that may begin after comments": (
        OURS + "# a remark\n" * 500 + "0,1,2,3\n0.1,4,5,6\n",
        {},
        [1, 2, 3, 4, 5, 6],
    ),
    "comments before the header": (
        "# a remark\n" * 500 + OURS + "0,1,2,3\n0.1,4,5,6\n",
        {},
        [1, 2, 3, 4, 5, 6],
    ),
}


@pytest.mark.parametrize("name", ODD)
def test_what_is_odd_and_yet_clear_is_read(name: str, tmp_path: Path) -> None:
    text, how, gyro = ODD[name]
    assert stored(tmp_path, text, **how).whole().gyro.ravel().tolist() == gyro


def test_rows_number_the_samples_where_there_are_no_times(tmp_path: Path) -> None:
    found = stored(tmp_path, "gyro_x_dps\nnan\n1\nnan\nnan\n2\nnan\n3\n", rate_hz=10.0).whole()
    assert (found.seq.tolist(), found.gyro.ravel().tolist()) == ([0, 3, 5], [1, 2, 3])


def test_a_last_line_that_is_cut_is_left_out_and_told(tmp_path: Path) -> None:
    found = stored(tmp_path, OURS + "0,1,2,3\n0.1,4,5,6\n0.2,7")
    assert found.samples == 2
    assert [note.kind for note in found.notes] == ["cut_recording"]
    assert ":4: the last line is cut off" in found.notes[0].text
    found = stored(tmp_path, OURS + "0,1,2,3\n0.1,4,5,6\n0.2,7\n")
    assert [note.kind for note in found.notes] == ["bad_lines"]
    assert (
        ":4: the first of 1 lines that hold no sample and are left out: has 2 fields" in found.notes[0].text
    )
