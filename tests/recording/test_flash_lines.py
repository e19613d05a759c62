"""Tests text logs of ArduPilot: FMT rows give the columns' names, and rows of one kind and one sensor are
read.
"""

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fltea.recording.csv_file import open_csv
from fltea.recording.files import Stored
from fltea.recording.flash_lines import FlashLines
from fltea.recording.reading import NotStated
from fltea.settings.how import How
from fltea.sources.text_events import TextEvents
from hypothesis import given
from hypothesis import strategies as st

N = 300
RATES = np.round(np.random.default_rng(4).normal(size=(N, 2, 3)) / 100, 6)
"""Angular rates of two sensors (instances), in rad/s."""
HEAD = [
    "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns",
    "FMT, 129, 31, GYR, QBQfff, TimeUS,I,SampleUS,GyrX,GyrY,GyrZ",
    "FMT, 130, 31, ACC, QBQfff, TimeUS,I,SampleUS,AccX,AccY,AccZ",
    "FMT, 131, 43, IMU, QBffffff, TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ",
    "PARM, 1000, LOG_BITMASK, 65535",
]


def lines(instances: int = 2, *, ids: bool = True) -> list[str]:
    found = [*HEAD] if ids else [HEAD[0], HEAD[3].replace("I,", ""), HEAD[4]]
    for k in range(N):
        for of in range(instances):
            numbers = ", ".join(map(str, RATES[k, of].tolist()))
            found.append(
                f"IMU, {1745135 + 20000 * k}, {f'{of}, ' if ids else ''}{numbers}, 0.01, -0.02, -9.81"
            )
        found += [f"ATT, {1745135 + 20000 * k}, 0.1, 0.2, 0.3, 0.4, 50, 50"] if k % 5 == 0 else []
    return found


def read(folder: Path, text: list[str], **how: Any) -> Stored:
    path = folder / "00000001.log"
    path.write_text("".join(f"{line}\n" for line in text))
    return open_csv(path, How(**how))


def test_an_instance_is_asked_for_and_read(tmp_path: Path) -> None:
    with pytest.raises(NotStated, match=r"column IMU\.I tells several apart \(0, 1\)"):
        read(tmp_path, lines())
    for topic, of in (("0", 0), ("1", 1), ("IMU.I=1", 1), ("I=0", 0)):
        stored = read(tmp_path, lines(), topic=topic)
        assert np.allclose(stored.whole().gyro, np.degrees(RATES[:, of]))
        assert stored.rate_hz == pytest.approx(50)
        assert [note.kind for note in stored.notes] == []
        (answer,) = [one for one in stored.reading if one.question == "unit"]
        assert str(answer) == "rad/s (dialect: ArduPilot IMU)"


@pytest.mark.parametrize("ids", [True, False])
def test_of_one_instance_nothing_is_asked(ids: bool, tmp_path: Path) -> None:
    stored = read(tmp_path, lines(1, ids=ids))
    whole = stored.whole()
    assert np.allclose(whole.gyro, np.degrees(RATES[:, 0]))
    assert whole.accel_ms2 is not None
    assert whole.accel_ms2[:2].tolist() == [[0.01, -0.02, -9.81]] * 2


def test_another_kind_is_read_if_its_columns_are_named(tmp_path: Path) -> None:
    raw = [f"GYR, {20000 * k}, 0, {20000 * k + 7}, {k % 7}, {k % 5}, {k % 3}" for k in range(N)]
    text = [*HEAD, *(row for two in zip(lines(1)[len(HEAD) :], raw, strict=False) for row in two)]
    assert np.allclose(read(tmp_path, text).whole().gyro[:200], np.degrees(RATES[:200, 0]))
    stored = read(tmp_path, text, columns=["GYR.GyrX", "GYR.GyrY", "GYR.GyrZ"])
    assert np.allclose(stored.whole().gyro[:3], np.degrees([[0, 0, 0], [1, 1, 1], [2, 2, 2]]))


def test_live_rows_are_read_as_a_file(tmp_path: Path) -> None:
    live = TextEvents("stdin:", How(topic="1"), fatal=False)
    live.open(0, within_line=False)
    for line in lines():
        list(live.feed(f"{line}\n".encode(), 0))
    list(live.finish(0))
    assert live.link_stats().frames == N
    assert not live.link_stats().bad_frames


@given(
    text=st.lists(st.sampled_from([*HEAD, "IMU, 1, 0, 1, 2, 3", "GYR, 1, 0, 2, 1, 2, 3", "", "x", "FMT, 1"])),
    cuts=st.lists(st.integers(0, 20), max_size=4),
)
def test_lines_stay_as_many_in_whatever_pieces_they_come(text: list[str], cuts: list[int]) -> None:
    def run(pieces: list[list[str]]) -> list[str]:
        flash = FlashLines(None)
        return [one for piece in pieces for one in flash.take(piece, is_known=False)] + flash.finish()

    edges = [0, *sorted(min(cut, len(text)) for cut in cuts), len(text)]
    whole = run([text])
    assert run([text[a:b] for a, b in itertools.pairwise(edges)]) == whole
    assert len(whole) == len(text)
