"""Tests times in two columns: whole seconds, and the fraction of a second in the unit of its name."""

from pathlib import Path

import numpy as np
import pytest

from tests.rig.text_files import refusal, stored

AXES = "gx [dps],gy [dps],gz [dps]"
RATE_HZ, LOST = 100, range(300, 500)
EPOCH_S = 1_700_000_000


def text_of(header: str, per_second: int, *, form: str = "{s},{fine}", digits: int = 0) -> str:
    """Return a file of 100 Hz whose rows 300 to 499 are missing, which are two whole seconds.

    `per_second`: how many of the column of fractions are a second.
    """
    rows = []
    for k in range(800):
        if k not in LOST:
            fine = f"{k % RATE_HZ / RATE_HZ * per_second:.{digits}f}"
            time = form.format(s=EPOCH_S + k // RATE_HZ, fine=fine, minute=13, second=k // RATE_HZ)
            rows.append(f"{time},{np.sin(k):.5f},{np.cos(k):.5f},{k % 7}\n")
    return f"{header},{AXES}\n{''.join(rows)}"


@pytest.mark.parametrize(
    ("header", "per_second", "digits"),
    [
        ("sec,msec", 1000, 0),
        ("sec,ms", 1000, 0),
        ("sec,usec", 10**6, 0),
        ("epoch seconds,nanos", 10**9, 0),
        ("time (s),time (ms)", 1000, 0),
        ("unix_time,milliseconds", 1000, 0),
        ("timestamp,microseconds", 10**6, 0),
        ("sec,frac", 1, 2),
        ("stamp.sec,stamp.nanosec", 10**9, 0),
    ],
)
@pytest.mark.parametrize("named", [None, 0, 1])
def test_whole_seconds_are_lost_between_two_columns(
    header: str, per_second: int, digits: int, named: int | None, tmp_path: Path
) -> None:
    """The same is read if the user names either of the two columns as that of times."""
    time_column = None if named is None else header.split(",")[named]
    found = stored(tmp_path, text_of(header, per_second, digits=digits), time_column=time_column)
    assert found.rate_hz == pytest.approx(RATE_HZ)
    seq = found.whole().seq
    assert seq is not None
    assert seq.tolist() == [k for k in range(800) if k not in LOST]
    clock = next(one for one in found.reading if one.question == "clock")
    assert clock.why == f"the times of {header.replace(',', ' + ')} in s"


def test_a_time_of_day_without_its_fraction_takes_it_from_the_next_column(tmp_path: Path) -> None:
    form = "2023-11-14 22:{minute}:{second:02d},{fine}"
    found = stored(tmp_path, text_of("date,msec", 1000, form=form))
    seq = found.whole().seq
    assert seq is not None
    assert seq[-1] == 799


def test_a_fraction_in_another_unit_than_its_name_states_is_asked_about(tmp_path: Path) -> None:
    why = "nothing says the times: by its values usec is a fraction of sec, but not in the unit of its name"
    for per_second in (1000, 10):
        text = refusal(tmp_path, text_of("sec,usec", per_second))
        assert "--time-column ?" in text
        assert why in text


@pytest.mark.parametrize(
    ("header", "form"),
    [
        ("time_s,time_us", "{t:.2f},{us}"),
        ("time_s,time_ms", "{t:.2f},{ms}"),
    ],
)
def test_two_complete_times_are_not_added(header: str, form: str, tmp_path: Path) -> None:
    """Each column holds the whole time, in another unit."""
    rows = [
        f"{form.format(t=k / 100, ms=10 * k, us=10_000 * k)},{k % 3},{k % 5},{k % 7}\n" for k in range(800)
    ]
    assert stored(tmp_path, f"{header},{AXES}\n{''.join(rows)}").rate_hz == pytest.approx(100.0)


@pytest.mark.parametrize("fine", ["{k}", "{dt}"])
def test_a_column_that_is_no_fraction_is_not_added(fine: str, tmp_path: Path) -> None:
    """Beside a clock of whole seconds, `ms` is a count since the start, or the length of each loop."""
    rows = [
        f"{EPOCH_S + k // 100},{fine.format(k=10 * k, dt=9 + k % 3)},{k % 3},{k % 5},{k % 7}\n"
        for k in range(800)
    ]
    text = f"unix_time,ms,{AXES}\n{''.join(rows)}"
    assert "nothing says which column has the times (unix_time, ms)" in refusal(tmp_path, text)


def test_fractions_alone_are_read_with_a_note_on_whole_seconds(tmp_path: Path) -> None:
    text = "\n".join(line.partition(",")[2] for line in text_of("sec,msec", 1000).splitlines())
    notes = [note.text for note in stored(tmp_path, f"{text}\n").notes]
    assert len(notes) == 1
    assert "a gap of whole seconds cannot be seen" in notes[0]


def test_a_damaged_fraction_is_left_out(tmp_path: Path) -> None:
    text = text_of("sec,msec", 1000).replace(f"{EPOCH_S + 1},500,", f"{EPOCH_S + 1},50000,")
    found = stored(tmp_path, text)
    assert found.samples == 599
    assert [note.text for note in found.notes if "with an impossible time in 'sec + msec'" in note.text]


def of_day(header: str, begin: str, *, first_s: int = 0, jump_s: int = 60) -> str:
    """Return a file of 100 Hz with a gap of `jump_s` after 400 of 800 rows.

    `begin`: the columns of the time, for `str.format`. `first_s`: time of day of the first row [s].
    """
    rows = []
    for k in range(800):
        ms = first_s * 1000 + 10 * k + 1000 * jump_s * (k >= 400)
        day, s = divmod(ms // 1000, 86_400)
        time = begin.format(day=14 + day, h=s // 3600, m=s // 60 % 60, s=s % 60, ms=ms % 1000)
        rows.append(f"{time},{np.sin(k):.5f},{np.cos(k):.5f},{k % 7}\n")
    return f"{header},{AXES}\n{''.join(rows)}"


@pytest.mark.parametrize(
    ("header", "begin"),
    [
        ("h,m,s,ms", "{h},{m},{s},{ms}"),
        ("hour,minute,second,millisecond", "{h},{m},{s},{ms}"),
        ("gps_hour,gps_min,gps_sec,gps_ms", "{h},{m},{s},{ms}"),
        ("min,sec,msec", "{m},{s},{ms}"),
    ],
)
def test_minutes_and_hours_are_read(header: str, begin: str, tmp_path: Path) -> None:
    """The first row is 50 s after a full hour."""
    found = stored(tmp_path, of_day(header, begin, first_s=12 * 3600 + 50))
    seq, epoch = found.whole().seq, found.whole().epoch
    assert seq is not None
    assert epoch is not None
    is_lost = seq[-1] == 799 + 6000
    assert is_lost or epoch[-1] == 1
    clock = next(one for one in found.reading if one.question == "clock")
    assert header.replace(",", " + ") in clock.why


def test_columns_that_are_no_minutes_and_hours_are_not_added(tmp_path: Path) -> None:
    """`m` and `h` may be lengths."""
    text = of_day("h,m,s,ms", "{h}.5,{m}.25,{s},{ms}", first_s=12 * 3600 + 10, jump_s=0)
    found = stored(tmp_path, text)
    assert found.samples == 800
    clock = next(one for one in found.reading if one.question == "clock")
    assert "the times of s + ms" in clock.why


def test_minutes_and_hours_beside_another_clock_are_compared_as_one(tmp_path: Path) -> None:
    rows = of_day("hour,minute,second,ms", "{h},{m},{s},{ms}", first_s=50, jump_s=0).splitlines()
    text = "\n".join([f"{rows[0]},time_us", *(f"{row},{k * 10_000}" for k, row in enumerate(rows[1:]))])
    assert stored(tmp_path, f"{text}\n").rate_hz == pytest.approx(100)
    text = text.replace(",10000\n", ",\n")
    assert stored(tmp_path, f"{text}\n").samples == 800


def test_damaged_minutes_are_left_out(tmp_path: Path) -> None:
    rows = of_day("h,m,s,ms", "{h},{m},{s},{ms}", first_s=50, jump_s=0).splitlines()
    rows[700] = rows[700].replace("0,0,", "0,77,", 1)
    found = stored(tmp_path, "\n".join(rows) + "\n")
    assert found.samples == 799


def test_midnight_is_no_gap(tmp_path: Path) -> None:
    text = of_day("h,m,s,ms", "{h},{m},{s},{ms}", first_s=86_398, jump_s=0)
    found = stored(tmp_path, text)
    assert found.whole().seq is not None
    assert found.whole().seq.tolist() == [*range(800)]  # type: ignore[union-attr]
    assert found.notes == ()


@pytest.mark.parametrize(
    "form", ["2023-11-{day}", "{day}.11.2023", "Nov {day} 2023", "11/{day}/2023", '"2023-11-{day}"']
)
@pytest.mark.parametrize(
    ("header", "clock"),
    [
        ("date,time", "{h:02d}:{m:02d}:{s:02d}.{ms:03d}"),
        ("date,time,ms", "{h:02d}:{m:02d}:{s:02d},{ms}"),
    ],
)
@pytest.mark.parametrize("first_s", [0, 86_398])
def test_a_date_in_a_column_before_the_time_is_read(
    form: str, header: str, clock: str, first_s: int, tmp_path: Path
) -> None:
    text = of_day(header, f"{form},{clock}", first_s=first_s, jump_s=86_400)
    epoch = stored(tmp_path, text).whole().epoch
    assert epoch is not None
    assert epoch.tolist() == [0] * 400 + [1] * 400
    seq = stored(tmp_path, of_day(header, f"{form},{clock}", first_s=first_s, jump_s=0)).whole().seq
    assert seq is not None
    assert seq.tolist() == [*range(800)]


@pytest.mark.parametrize("mark", ["\t", ";"])
def test_a_date_in_a_column_is_read_whatever_separates_the_columns(mark: str, tmp_path: Path) -> None:
    text = of_day("date,time", "{day}.11.2023,{h:02d}:{m:02d}:{s:02d}.{ms:03d}", jump_s=86_400)
    epoch = stored(tmp_path, text.replace(",", mark)).whole().epoch
    assert epoch is not None
    assert epoch.tolist() == [0] * 400 + [1] * 400


def test_a_date_that_is_none_does_not_hide_the_time(tmp_path: Path) -> None:
    """A clock that was never set writes such dates."""
    text = of_day("date,time", "00-00-2000,{h:02d}:{m:02d}:{s:02d}.{ms:03d}", jump_s=0)
    assert stored(tmp_path, text).samples == 800
