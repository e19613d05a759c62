"""Tests of the comparison of several recordings: a star marks a figure only if it differs by more than
chance.
"""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from fltea.identification.axis import IdentifyOptions
from fltea.identification.axis_report import AxisReport, FileReport
from fltea.identification.comparison import Compared, compared, rows, said
from fltea.identification.load import GYRO_UNIT, Series
from fltea.records.fit import Interval
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from tests.rig.host_support import fltea_here
from tests.rig.identify_files import counts, npz
from tests.rig.identify_one import identify_series
from tests.rig.identify_support import H, white

N_SAMPLES = 30_000


@pytest.fixture(scope="module")
def alike() -> AxisReport:
    """Return a sensor's result that includes a random walk."""
    noise = 0.1 * white(N_SAMPLES, 1, 3)[0] + 0.001 * np.cumsum(white(N_SAMPLES, 1, 4)[0])
    return identify_series(Series(noise, GYRO_UNIT, None), H, IdentifyOptions(), False, forecast=True)


def times(axis: AxisReport, factor: float) -> AxisReport:
    """Return the result of an axis whose N was multiplied by a factor."""
    N = axis.result.level.N
    larger = Interval(*(None if end is None else end * factor for end in (N.value, N.low, N.high)))
    return replace(axis, result=replace(axis.result, level=replace(axis.result.level, N=larger)))


def of(**axes: AxisReport) -> list[FileReport]:
    return [FileReport(f"{name}.npz", axes={"gyro_x": axis}) for name, axis in axes.items()]


def one(pairs: list[Compared], figure: str) -> Compared:
    (found,) = [pair for pair in pairs if pair.figure == figure]
    return found


def test_a_recording_beside_itself_differs_in_nothing(alike: AxisReport) -> None:
    reports = of(a=alike, b=alike)
    pairs = compared(reports)
    assert [pair.figure for pair in pairs] == ["N", "K", "B", "bias", "± after 60 s"]
    assert {pair.differs for pair in pairs} <= {False, None}
    assert one(pairs, "N").ratio.value == one(pairs, "K").ratio.value == 1.0
    assert one(pairs, "bias").difference.value == 0.0
    assert one(pairs, "bias").ratio.value is None
    assert said(reports) == [
        "No figure whose interval is known differs by more than chance.",
        "Not compared, as an interval is not known: B, ± after 60 s of some axes.",
    ]
    assert not any("*" in cell for _, _, lines in rows(reports) for line in lines for cell in line)


@given(st.floats(0.2, 5))
def test_a_ratio_and_its_interval(alike: AxisReport, factor: float) -> None:
    """The interval of a ratio combines both relative errors in quadrature.

    If the two files are exchanged, the ratio and the ends of its interval are inverted.
    """
    N = alike.result.level.N
    assert N.value is not None
    assert N.low is not None
    assert N.high is not None
    there = one(compared(of(a=alike, b=times(alike, factor))), "N").ratio
    back = one(compared(of(a=times(alike, factor), b=alike)), "N").ratio
    assert there.value == pytest.approx(factor)
    half = math.hypot(math.log(N.value / N.low), math.log(N.high / N.value))
    assert there.low == pytest.approx(factor * math.exp(-half))
    assert there.high == pytest.approx(factor * math.exp(half))
    assert back.low == pytest.approx(1 / (there.high or 0))


def test_what_differs_has_a_star_and_a_sentence(alike: AxisReport) -> None:
    reports = of(a=alike, b=times(alike, 1.5))
    ((_, headings, lines),) = rows(reports)
    assert headings == ["", "a.npz", "b.npz", "second beside first"]
    starred = [line[0] for line in lines if line[-1].endswith("*")]
    assert starred == ["N [deg/√h]"]
    first, others, last = said(reports)
    assert first.startswith("N of b.npz differs from that of a.npz by more than chance: gyro_x (× 1.5 (1.4")
    assert others == "Other figures whose intervals are known differ by no more than chance."
    assert last.startswith("Not compared")


@pytest.mark.parametrize(
    ("N", "other", "ratio", "differs"),
    [
        # One side of an interval may be much longer than the other side. The side towards the figure of the
        # other file decides.
        ((0.986, 0.698, 0.999), (1.15, 1.13, 1.16), (1.166, 1.141, 1.65), True),
        ((0.302, 0.0, 0.303), (1.19, 1.18, 1.21), (3.94, 3.90, None), True),
        ((1.19, 1.18, 1.21), (0.302, 0.0, 0.303), (0.2538, 0.0, 0.256), True),
        ((1.0, 0.5, 1.01), (0.7, 0.69, 1.2), (0.7, 0.69, 1.68), False),
    ],
)
def test_intervals_that_are_longer_on_one_side(
    alike: AxisReport,
    N: tuple[float, float, float],
    other: tuple[float, float, float],
    ratio: tuple[float, float, float | None],
    differs: bool,
) -> None:
    pair = [
        replace(alike, result=replace(alike.result, level=replace(alike.result.level, N=Interval(*ends))))
        for ends in (N, other)
    ]
    found = one(compared(of(a=pair[0], b=pair[1])), "N")
    assert (found.ratio.value, found.ratio.low) == pytest.approx(ratio[:2], rel=0.01)
    assert found.ratio.high == (None if ratio[2] is None else pytest.approx(ratio[2], rel=0.02))
    assert found.differs == differs


def test_more_comparisons_need_more_to_differ(alike: AxisReport) -> None:
    """Two sensors differ in N by a little more than chance explains.

    If a hundred equal sensors are compared as well, this difference does not count: among so many
    comparisons, some differ as much by chance.
    """
    N = alike.result.level.N
    assert N.high is not None
    assert N.value is not None
    assert N.low is not None
    barely = math.exp(1.4 * math.hypot(math.log(N.value / N.low), math.log(N.high / N.value)))
    assert one(compared(of(a=alike, b=times(alike, barely))), "N").differs
    others = {f"c{i}": alike for i in range(100)}
    pairs = compared(of(a=alike, b=times(alike, barely), **others))
    assert [pair.differs for pair in pairs if pair.figure == "N" and pair.file == "b.npz"] == [False]


def test_three_have_a_line_each(alike: AxisReport) -> None:
    ((name, headings, lines),) = rows(of(a=alike, b=alike, c=times(alike, 2)))
    assert name == "gyro_x"
    assert headings[0] == ""
    assert headings[-1] == "verdict"
    assert [line[0] for line in lines] == ["a.npz", "b.npz", "c.npz"]
    assert [line[1].endswith(" *") for line in lines] == [False, False, True]
    assert {len(line) for line in lines} == {len(headings)}


def test_files_called_alike_are_told_apart(alike: AxisReport) -> None:
    reports = [FileReport(name, axes={"gyro_x": alike}) for name in ("a/rest.npz", "b/rest.npz")]
    ((_, headings, _),) = rows(reports)
    assert headings[1:3] == ["a/rest.npz", "b/rest.npz"]


def test_an_axis_of_one_file_alone_and_another_unit(alike: AxisReport) -> None:
    reports = of(a=alike)
    reports.append(FileReport("b.npz", axes={"gyro_x": replace(alike, unit="m/s²"), "gyro_y": alike}))
    assert compared(reports) == []
    assert [name for name, *_ in rows(reports)] == ["gyro_x"], "side by side, without a ratio"
    assert list(rows(of(a=alike, b=alike)[:1])) == []
    assert said(reports) == []


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("two")
    return [npz(folder / f"{name}.npz", size * counts(6000)) for name, size in (("small", 1), ("large", 2))]


def test_the_command_says_json_and_the_report(two: list[Path], tmp_path: Path) -> None:
    """Text, JSON and report agree on a sensor with twice the noise."""
    small, large = two
    folder = tmp_path / "report"
    flags = ("--channels", "gyro_x,gyro_z", "--shuffles", 1)
    text = fltea_here("identify", small, large, *flags, "--report", folder).stdout
    assert "N of large.npz differs from that of small.npz by more than chance: gyro_x (× 2" in " ".join(
        text.split()
    )
    found = json.loads(fltea_here("identify", small, large, *flags, "--json").stdout)["compared"]
    assert {pair["axis"] for pair in found} == {"gyro_x", "gyro_z"}
    for pair in found:
        if pair["figure"] == "N":
            assert pair["ratio"]["low"] < 2 < pair["ratio"]["high"]
            assert pair["differs"]
    assert "second beside first" in (folder / "report.html").read_text(encoding="utf-8")


def test_one_recording_is_compared_with_nothing(two: list[Path]) -> None:
    found = fltea_here("identify", two[0], "--shuffles", 1, "--json")
    assert "compared" not in json.loads(found.stdout)
