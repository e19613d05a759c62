"""The benchmark of reading text.

The benchmark completely reads each kind of text that it writes, and names each figure that misses its goal.
"""

from pathlib import Path
from typing import Any

import pytest
from fltea.recording.csv_file import open_csv

from tools.bench import bench_reading as bench


@pytest.mark.parametrize("name", list(bench.FORMS | bench.LINEAR))
def test_each_form_is_read_whole_at_its_rate(tmp_path: Path, name: str) -> None:
    form = (bench.FORMS | bench.LINEAR)[name]
    bench._write(tmp_path / "rest.csv", form, 120)
    found = open_csv(tmp_path / "rest.csv", form.how)
    assert found.samples == 120
    assert found.rate_hz == pytest.approx(200)


def test_what_is_missed_is_named() -> None:
    good = {"seconds": [1.0, 2.0, 4.0], "twice": [2.0, 2.0], "s_per_mb": 0.1}
    speed = {"mb": 1.0, "fltea": [50.0], "pandas": [90.0], "of_pandas": 0.55}

    def missed(ratio: float, headers: float = 5.0, **growth: Any) -> list[str]:
        found: dict[str, Any] = {
            "speed": {"CSV with a header": speed | {"of_pandas": ratio}},
            "growth": {"a form": good | growth},
            "headers": {"live text": {"with": 100.0, "without": 500.0, "ratio": headers}},
        }
        found |= {"rows": 20, "rounds": 1}
        reached = bench.not_reached(found)
        assert bench.text(found | {"not_reached": reached}).count("| CSV with a header | 1.0 | 50 |") == 1
        return reached

    assert missed(0.55) == []
    assert missed(0.45) == ["CSV at 0.45 of pandas' speed, goal 0.5"]
    assert missed(0.55, twice=[2.0, 3.9]) == ["a form: twice the file takes 3.9 times as long, goal 2.5"]
    assert missed(0.55, s_per_mb=1.5) == ["a form: 1.50 s for 1 MB, goal 1"]
    assert missed(0.55, headers=25.0) == [
        "live text with a header before each row: 25.0 times the time, goal 20"
    ]
    assert missed(0.55, refused="no unit") == ["a form: refused"]


def test_each_row_with_a_header_is_compared_with_the_same_row_without(tmp_path: Path) -> None:
    found = bench._headers(tmp_path, 120, 1)
    assert list(found) == ["a file", "live text"]
    assert all(min(one.values()) > 0 for one in found.values())
