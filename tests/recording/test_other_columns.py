"""Tests texts in blocks: rows below a line that names other columns than the gyroscope's are left out."""

from pathlib import Path

import numpy as np
import pytest
from fltea.recording.files import Stored
from fltea.recording.text_rows import TextReader
from fltea.settings.how import How

from tests.rig.text_files import refusal, stored

N = 300
GYRO, ACCEL = "time_s,gx [dps],gy [dps],gz [dps]", "time_s,ax [m/s^2],ay [m/s^2],az [m/s^2]"
BARE, G_BARE = "time_s,x,y,z", "time_s,gx,gy,gz"


def rows(first: float, times: bool = True) -> list[str]:
    """Return rows of 100 Hz, each of which begins with its time if `times`. The numbers are near `first`."""
    values = first + np.random.default_rng(1).normal(0, 1, (N, 3))
    return [
        ",".join([f"{k / 100:.2f}"] * times + [f"{value:.4f}" for value in row])
        for k, row in enumerate(values)
    ]


def text_of(*blocks: list[str]) -> str:
    return "\n".join(line for block in blocks for line in block) + "\n"


def is_gyro_alone(found: Stored) -> bool:
    return found.samples == N and np.abs(found.whole().gyro).max() < 20


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (GYRO, ACCEL),
        (GYRO, "time_s,ax,ay,az"),
        (GYRO, "time_s,mx [uT],my [uT],mz [uT]"),
        (GYRO, "time_s,temperature,pressure,humidity"),
        (GYRO, "stamp,roll,pitch,yaw"),
        (f"# {GYRO}", f"# {ACCEL}"),
        (GYRO.replace(" ", "").replace(",", "\t"), "time_s\tax\tay\taz"),
        (GYRO.replace(" [dps]", "_dps").replace(",", " "), "time_s ax ay az"),
        (GYRO, "Accelerometer"),
        (GYRO, "Accelerometer (m/s^2):"),
        (GYRO, f"Accelerometer\n{ACCEL}"),
        (GYRO, "# Magnetometer data"),
    ],
)
def test_rows_below_names_of_other_columns_are_left_out(first: str, second: str, tmp_path: Path) -> None:
    """The note says at which line they begin, how many they are, and what stands above them."""
    text = text_of([first], rows(0), [second], rows(100))
    for mark in ("\t", " "):
        if mark in first.removeprefix("# ").replace(" [", "["):
            text = text.replace(",", mark)
            break
    found = stored(tmp_path, text)
    assert is_gyro_alone(found)
    (note,) = found.notes
    assert (
        f"rest.csv:{N + 2}: the first of {N + 1 + second.count(chr(10))} lines that hold no sample"
        in note.text
    )
    assert f"the rows below {second.partition(chr(10))[0]!r}" in note.text


def test_without_times_a_block_that_is_left_out_is_no_lost_sample(tmp_path: Path) -> None:
    """It does not become one run with the gyroscope's next block, since nothing says how long it lasted."""
    names = [GYRO.partition(",")[2]], [ACCEL.partition(",")[2]]
    plain, other = rows(0, times=False), rows(100, times=False)
    found = stored(tmp_path, text_of(names[0], plain, names[1], other), rate_hz=100.0)
    assert is_gyro_alone(found)
    again = stored(
        tmp_path, text_of(names[0], plain, names[1], other, names[0], plain), rate_hz=100.0
    ).whole()
    assert len(again.gyro) == 2 * N
    assert again.epoch is not None
    assert again.epoch.tolist() == [0] * N + [1] * N
    for line in ("Gyroscope", f"# {names[0][0]}"):
        text = text_of(names[0], plain, ["Accelerometer"], other, [line], plain)
        titled = stored(tmp_path, text, rate_hz=100.0).whole().epoch
        assert titled is not None
        assert titled.tolist() == again.epoch.tolist()


def test_titles_at_equal_distances_do_not_end_a_run(tmp_path: Path) -> None:
    """A program may print a title above each row, or above each block of a buffer."""
    pairs = zip(rows(0, times=False), rows(100, times=False), strict=True)
    text = text_of(*(["Gyroscope:", row, "Accelerometer:", other] for row, other in pairs))
    found = stored(tmp_path, text, columns=["1", "2", "3"], units="dps", rate_hz=100.0)
    assert is_gyro_alone(found)
    epoch = found.whole().epoch
    assert epoch is None or epoch.max() == 1


@pytest.mark.parametrize("columns", [["x", "y", "z"], ["2", "3", "4"]])
@pytest.mark.parametrize("other", [ACCEL, f"Accelerometer\n{BARE}", f"Linear acceleration (m/s^2)\n{BARE}"])
def test_columns_that_the_user_names_are_those_of_their_block(
    columns: list[str], other: str, tmp_path: Path
) -> None:
    how = {"columns": columns, "units": "dps"}
    gyro, accel = ["Gyroscope (deg/s)", BARE, *rows(0)], [other, *rows(100)]
    assert is_gyro_alone(stored(tmp_path, text_of(gyro, accel), **how))
    if BARE in other:
        assert is_gyro_alone(stored(tmp_path, text_of(accel, gyro), **how))


def test_the_figures_that_a_question_shows_are_of_one_block(tmp_path: Path) -> None:
    text = refusal(tmp_path, text_of([BARE], rows(0), ["time_s,ax,ay,az"], rows(100)))
    figures = [line.partition("mean ")[2] for line in text.splitlines() if "mean" in line][1:]
    assert all(abs(float(line.partition(",")[0])) < 1 for line in figures)
    assert len(figures) == 3


@pytest.mark.parametrize(
    "line",
    [
        "error",
        "ERR,ERR,ERR,ERR",
        "sensor lost, restarting",
        "# gyro is warm, temperature ok, go, on",
        "nan,nan,nan,nan",
    ],
)
def test_words_between_rows_are_no_names_of_columns(line: str, tmp_path: Path) -> None:
    found = stored(tmp_path, text_of([GYRO], rows(0)[:200], [line], rows(0)[200:]))
    assert found.samples == N
    assert not any("are not of the columns" in note.text for note in found.notes)


def test_names_that_are_repeated_above_rows_given_by_position_go_on(tmp_path: Path) -> None:
    """The line above the rows has fewer names than a row has fields, so it gives no column its name."""
    line = "time_s,ax,ay,az"
    text = text_of([line], [f"{row},7" for row in rows(0)], [line], [f"{row},7" for row in rows(0)])
    found = stored(tmp_path, text, columns=["2", "3", "4"], units="dps", rate_hz=100.0)
    assert found.samples == 2 * N


UNITS = "s,deg/s,deg/s,deg/s"


@pytest.mark.parametrize(
    ("head", "other"),
    [
        (f"time_s,gx,gy,gz\n{UNITS}", f"time_s,gx,gy,gz\n{UNITS.replace('deg', 'rad')}"),
        (f"time_s,gx,gy,gz\n{UNITS}", UNITS.replace("deg", "rad")),
        (f"time,gx,gy,gz\n{UNITS}", f"time,gx,gy,gz\nm{UNITS}"),
        (f"# gyro in deg/s\n{G_BARE}", f"# gyro in rad/s\n{G_BARE}"),
        (f"Units: deg/s\n{G_BARE}", "Units: rad/s"),
    ],
)
def test_a_later_block_in_another_unit_is_left_out(head: str, other: str, tmp_path: Path) -> None:
    found = stored(tmp_path, text_of([head], rows(0), [other], rows(0)))
    assert found.samples == N
    assert any("rows below" in note.text for note in found.notes)
    again = stored(tmp_path, text_of([head], rows(0), [other], rows(100), [head], rows(0)))
    assert again.samples == 2 * N
    assert np.abs(again.whole().gyro).max() < 20
    both = stored(tmp_path, text_of([head], rows(0), [head], rows(0)))
    assert both.samples == 2 * N


@pytest.mark.parametrize("scale", ["scale: 131 LSB/(deg/s)", "gyro sensitivity 131 LSB/dps"])
def test_a_later_block_of_counts_with_another_scale_is_left_out(scale: str, tmp_path: Path) -> None:
    """The comment in the middle does not count among the rows, so the numbers are known to be counts."""
    counts = [f"{k / 100:.2f},{k % 7},{k % 5},{k % 3}" for k in range(N)]
    text = text_of([f"# {scale}", "time_s,gx,gy,gz"], counts, [f"# {scale.replace('131', '65.5')}"], counts)
    found = stored(tmp_path, text)
    assert (found.samples, found.lsb_per_dps) == (N, 131.0)


@pytest.mark.parametrize("how", [{}, {"rate_hz": 100.0}])
def test_a_later_block_of_another_rate_is_left_out(how: dict[str, object], tmp_path: Path) -> None:
    """A column of times says the rate of each block, so there the line in words does not matter."""
    names, plain = GYRO.partition(",")[2], rows(0, times=False)
    text = text_of(["# rate: 100 Hz", names], plain, ["# rate: 200 Hz", names], plain)
    assert stored(tmp_path, text, **how).samples == N
    assert stored(tmp_path, text, **how, overrule=True).samples == 2 * N
    text = text_of(["# rate: 100 Hz", GYRO], rows(0), ["# rate: 200 Hz", GYRO], rows(0))
    assert stored(tmp_path, text).samples == 2 * N


@pytest.mark.parametrize("size", [1, 7, 300, 4096])
def test_pieces_of_any_length_give_the_same_rows(size: int) -> None:
    text = text_of(
        [GYRO], rows(0), [ACCEL], rows(100), [GYRO], rows(0), ["Accelerometer"], rows(100)
    ).encode()
    reader = TextReader("x", How())
    found = [
        one for k in range(0, len(text), size) for one in reader.feed(text[k : k + size])
    ] + reader.finish()
    numbers = np.concatenate([one.numbers for one in found])
    assert numbers.tolist() == [*range(2, N + 2), *range(2 * N + 4, 3 * N + 4)]
    assert reader.bad.counts == {"header": 2 * N + 2}
    assert reader.lines == 4 * N + 4


@pytest.mark.parametrize(
    ("header", "samples"),
    [
        ("t,gx,gy,gz", 2 * N),
        ("t_s,gx [dps],gy [dps],gz [dps]", 2 * N),
        ("t,gz,gy,gx", N),
        ("t_ms,gx,gy,gz", N),
        ("t,gx [rad/s],gy [rad/s],gz [rad/s]", N),
        ("t,ax,ay,az", N),
    ],
)
def test_the_first_names_of_columns_by_position_may_come_late(
    header: str, samples: int, tmp_path: Path
) -> None:
    """So they do if the program began to read before a board started again and printed its header. Names of
    other columns, or in another order or unit, still begin rows that are left out.
    """
    found = stored(
        tmp_path,
        text_of(rows(0), [header], rows(0)),
        columns=["2", "3", "4"],
        units="dps",
        time_column="1",
        time_unit="s",
    )
    assert found.samples == samples
    assert len(found.notes) >= 1
