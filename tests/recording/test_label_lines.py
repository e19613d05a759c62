"""Tests labelled numbers, such as `gx: 0.1`: lines with one label each, units in each row, and columns that
the user names by their positions instead of labels.
"""

import itertools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fltea.recording import text_labels
from fltea.recording.csv_file import open_csv
from fltea.recording.files import Stored
from fltea.recording.label_lines import LabelLines
from fltea.recording.reading import NotStated
from fltea.recording.text_labels import labelled
from fltea.records.errors import UsageError
from fltea.settings.how import How
from fltea.sources.text_events import TextEvents
from hypothesis import given
from hypothesis import strategies as st

from tests.rig.table_support import open_here

N = 300
GYRO = np.round(np.random.default_rng(8).normal(size=(N, 3)), 4)


def read(folder: Path, lines: list[str], **how: Any) -> Stored:
    path = folder / "rest.txt"
    path.write_text("".join(f"{line}\n" for line in lines))
    return open_csv(path, How(**how))


def of_samples(form: Callable[[int, str, float], str], order: str = "xyz") -> list[str]:
    return [form(k, axis, GYRO[k, "xyz".index(axis)]) for k in range(N) for axis in order]


FORMS: dict[str, tuple[Callable[[int, str, float], str], dict[str, Any]]] = {
    "teleplot": (lambda k, axis, v: f">g{axis}:{v}", {}),
    "teleplot with times": (lambda k, axis, v: f">g{axis}:{1000 + 10 * k}:{v}", {"rate_hz": None}),
    "teleplot with units": (lambda k, axis, v: f">g{axis}:{v}§deg/s|g", {"units": None}),
    "equals": (lambda k, axis, v: f"gyro_{axis} = {v}", {}),
    "names with blanks": (lambda k, axis, v: f"Gyro {axis.upper()}: {v} dps", {"units": None}),
    "bare": (lambda k, axis, v: f"{axis}={v}", {"columns": ["x", "y", "z"]}),
    "positions": (lambda k, axis, v: f"{axis}: {v}", {"columns": ["1", "2", "3"]}),
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("between", [[], [""], ["---"], ["I am here"]])
def test_one_label_a_line_is_a_sample_of_three(form: str, between: list[str], tmp_path: Path) -> None:
    make, how = FORMS[form]
    lines = []
    for k, line in enumerate(of_samples(make)):
        lines += [*(between if k % 3 == 0 else []), line]
    stored = read(tmp_path, lines, **{"units": "deg/s", "rate_hz": 100.0, **how})
    assert stored.whole().gyro.tolist() == GYRO.tolist()
    assert stored.rate_hz == pytest.approx(100)


def test_a_lost_line_does_not_mix_samples(tmp_path: Path) -> None:
    make = FORMS["teleplot with times"][0]
    lines = [*of_samples(make)]
    for lost in (100, 201, 302):  # the x of one sample is lost, the y of another, and the z of a third
        lines[lost] = ""
    found = read(tmp_path, lines, units="deg/s").whole()
    kept = [k for k in range(N) if k not in (100 // 3, 201 // 3, 302 // 3)]
    assert found.gyro.tolist() == GYRO[kept].tolist()


@pytest.mark.parametrize("begin", [0, 1, 2])
def test_live_lines_may_begin_within_a_sample(begin: int) -> None:
    lines = of_samples(FORMS["teleplot"][0])[begin:]
    live = TextEvents("stdin:", How(units="deg/s", rate_hz=100.0), fatal=False)
    live.open(0, within_line=False)
    found = []
    for line in lines:
        found += list(live.feed(f"{line}\n".encode(), 0))
    found += list(live.finish(0))
    first = live.reader.chosen
    assert first is not None
    assert [*first.axes] == ["x", "y", "z"]
    assert live.link_stats().frames == (N if begin == 0 else N - 1)


def test_other_quantities_come_when_they_come(tmp_path: Path) -> None:
    lines = []
    for k in range(N):
        lines += [f">g{axis}:{v}" for axis, v in zip("xyz", GYRO[k], strict=True)]
        lines += [f">temp:{20 + k / 100}"] if k % 10 == 9 else []
    stored = read(tmp_path, lines, units="deg/s", rate_hz=100.0)
    assert stored.whole().gyro.tolist() == GYRO.tolist()


@pytest.mark.slow
def test_axes_on_lines_that_hold_more_are_refused(tmp_path: Path) -> None:
    lines = of_samples(lambda k, axis, v: f"g{axis}: {v} t{axis}: {k}")
    with pytest.raises(UsageError, match="stands on another line, so which numbers are of one sample"):
        read(tmp_path, lines, units="deg/s", rate_hz=100.0)


def test_a_head_of_labels_before_rows_stays_what_it_is(tmp_path: Path) -> None:
    rows = [",".join(map(str, [k / 100, *GYRO[k].tolist()])) for k in range(N)]
    head = ["Rate: 100", "Gain: 2", "Serial: 7"]
    stored = read(tmp_path, [*head, "time_s,gx_dps,gy_dps,gz_dps", *rows])
    assert stored.whole().gyro.tolist() == GYRO.tolist()


def test_one_axis_alone_is_one_axis(tmp_path: Path) -> None:
    stored = read(tmp_path, [f"gz: {v}" for v in GYRO[:, 2]], units="deg/s", rate_hz=100.0)
    assert stored.whole().gyro[:, 0].tolist() == GYRO[:, 2].tolist()


@given(
    lines=st.lists(
        st.sampled_from([">gx:1", ">gy:2", ">gz:3", "t=4", "", "hello", "1,2,3", "a: 1 b: 2", "x"]),
        max_size=40,
    ),
    cuts=st.lists(st.integers(0, 40), max_size=4),
)
def test_lines_are_as_many_as_there_were(lines: list[str], cuts: list[int]) -> None:
    """However the text is cut into pieces, the same lines come out, and as many as went in."""

    def run(pieces: list[list[str]]) -> list[str]:
        labels = LabelLines()
        return [one for piece in pieces for one in labels.take(piece, is_known=False)] + labels.finish()

    edges = [0, *sorted(min(cut, len(lines)) for cut in cuts), len(lines)]
    whole = run([lines])
    assert run([lines[a:b] for a, b in itertools.pairwise(edges)]) == whole
    assert len(whole) == len(lines)


@pytest.mark.parametrize(
    ("line", "names", "unit"),
    [
        ("Gyro: (x=0.1, y=0.2, z=0.3) deg/s", ["Gyro x", "Gyro y", "Gyro z"], "deg/s"),
        ("IMU(gyro=Vector3(x=0.1, y=0.2, z=0.3), t=4.0)", ["gyro x", "gyro y", "gyro z", "t"], ""),
        ("gyro={x: 0.1, y: 0.2, z: 0.3}", ["gyro x", "gyro y", "gyro z"], ""),
        ("Gyro (dps): X: 0.1 Y: 0.2 Z: 0.3", ["Gyro X", "Gyro Y", "Gyro Z"], "dps"),
    ],
)
def test_brackets_around_a_group(line: str, names: list[str], unit: str) -> None:
    found = labelled(line)
    assert found is not None
    assert [*found.values] == names
    assert [*found.values.values()][:3] == [0.1, 0.2, 0.3]
    assert found.units[names[0]] == unit


def test_lines_of_a_log_with_colours(tmp_path: Path) -> None:
    lines = [f"\x1b[0;32mI ({10 * k}) IMU: {a}, {b}, {c}\x1b[0m" for k, (a, b, c) in enumerate(GYRO.tolist())]
    with pytest.raises(NotStated, match="1  IMU x: mean"):
        read(tmp_path, lines)
    stored = read(tmp_path, lines, columns=["1", "2", "3"], units="deg/s", rate_hz=100.0)
    assert stored.whole().gyro.tolist() == GYRO.tolist()


def test_positions_of_objects_are_those_of_the_table(tmp_path: Path) -> None:
    """An error shows for each field the position by which `--columns` can name it. JSON objects with other
    fields, also before the rows of the table, do not change the positions.
    """
    rows = [{"id": k, "t_ms": 10 * k, "v": row} for k, row in enumerate(GYRO.tolist())]
    lines = [json.dumps(row) for row in [{"a": 1, "b": 2, "c": 3, "d": 4, "e": 5}, *rows]]
    with pytest.raises(NotStated, match="3  v_x: mean"):
        read(tmp_path, lines)
    stored = read(tmp_path, lines, columns=["3", "4", "5"], units="deg/s")
    assert stored.whole().gyro.tolist() == GYRO.tolist()


def rows_with_units(units: list[str], name: str = "unit") -> list[dict[str, Any]]:
    return [
        {"time": k / 100, "gx": a, "gy": b, "gz": c, name: units[k % len(units)]}
        for k, (a, b, c) in enumerate(GYRO.tolist())
    ]


def as_csv(folder: Path, rows: list[dict[str, Any]], **how: Any) -> Stored:
    return read(folder, [",".join(rows[0]), *(",".join(map(str, row.values())) for row in rows)], **how)


def as_json_lines(folder: Path, rows: list[dict[str, Any]], **how: Any) -> Stored:
    return read(folder, [json.dumps(row) for row in rows], **how)


def as_json(folder: Path, rows: list[dict[str, Any]], **how: Any) -> Stored:
    (folder / "rest.json").write_text(json.dumps(rows))
    return open_here("json", folder / "rest.json", **how)


@pytest.mark.parametrize("form", [as_csv, as_json_lines, as_json])
def test_a_unit_in_each_row_is_stated(form: Callable[..., Stored], tmp_path: Path) -> None:
    rows = rows_with_units(["rad/s"])
    stored = form(tmp_path, rows)
    assert np.allclose(stored.whole().gyro, np.degrees(GYRO))
    with pytest.raises(UsageError, match="says otherwise"):
        form(tmp_path, rows, units="deg/s")
    assert form(tmp_path, rows, units="deg/s", overrule=True).whole().gyro.tolist() == GYRO.tolist()


@pytest.mark.parametrize("form", [as_csv, as_json_lines, as_json])
def test_rows_in_several_units_are_refused(form: Callable[..., Stored], tmp_path: Path) -> None:
    mixed = rows_with_units(["rad/s", "deg/s"])
    late = [*rows_with_units(["deg/s"])[:-1], rows_with_units(["rad/s"])[-1]]
    for rows in (mixed, late):
        with pytest.raises(NotStated, match=r"column unit tells several apart .deg/s, rad/s"):
            form(tmp_path, rows)
    found = form(tmp_path, mixed, topic="unit=rad/s").whole()
    assert np.allclose(found.gyro, np.degrees(GYRO[::2]))


def test_a_unit_in_a_group_of_each_row_is_stated(tmp_path: Path) -> None:
    lines = [
        json.dumps({"t_ms": 10 * k, "gyro": {"unit": "rad/s", "x": a, "y": b, "z": c}})
        for k, (a, b, c) in enumerate(GYRO.tolist())
    ]
    assert np.allclose(read(tmp_path, lines).whole().gyro, np.degrees(GYRO))
    with pytest.raises(UsageError, match="says otherwise"):
        read(tmp_path, lines, units="deg/s")


@given(st.text(alphabet="ax:=[ \t-+.,1٣(e", max_size=20))
def test_the_quick_search_excludes_no_line_with_a_label(line: str) -> None:
    if text_labels._PAIR.search(line) is not None:
        assert text_labels._MARK.search(line) is not None
