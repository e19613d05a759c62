"""Tests times and accelerometers in text recordings as other programs write them."""

import math
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from zoneinfo import ZoneInfo

import numpy as np
import pytest
from fltea.recording.sample_times import Elapsed
from fltea.recording.text_times import Clocks, with_seconds
from hypothesis import assume, given
from hypothesis import strategies as st

from tests.rig.text_files import refusal, stored

# --- the accelerometer ---

ACCELS = {
    "ours": ("accel_{}_ms2", None, 1.0),
    "in g": ("a{} [g]", None, 9.80665),
    "EuRoC": ("a_RS_S_{} [m s^-2]", None, 1.0),
    "phyphox": ("Linear Acceleration {} (m/s^2)", None, 1.0),
    "a line of units": ("acc_{}", "mg", 9.80665e-3),
}


@pytest.mark.parametrize("name", ACCELS)
def test_an_accelerometer_whose_unit_is_known_is_read_too(name: str, tmp_path: Path) -> None:
    form, unit, ms2 = ACCELS[name]
    header = ["time_s", *[form.format(axis) for axis in "zxy"], "gyro_x_dps"]
    units = "" if unit is None else ",".join(["s", unit, unit, unit, "dps"]) + "\n"
    text = ",".join(header) + "\n" + units + "".join(f"{k / 10},3,1,2,{k}\n" for k in range(4))
    found = stored(tmp_path, text).whole()
    assert found.gyro.ravel().tolist() == [0, 1, 2, 3]
    assert found.accel_ms2 == pytest.approx(np.array([[1, 2, 3]] * 4) * ms2)
    assert stored(tmp_path, text, columns=["gyro_x_dps"], rate_hz=10.0).whole().accel_ms2 is not None


@pytest.mark.parametrize(
    "header",
    ["ax,ay,az", "ax [g],ay [g],az", "ax [g],ay [g],az [m/s^2]", "ax [g],ay [g],p", "ax [g],ax [g],az [g]"],
)
def test_an_accelerometer_that_leaves_a_doubt_is_not_read(header: str, tmp_path: Path) -> None:
    found = stored(tmp_path, f"gyro_x_dps,{header}\n1,0,0,x\n", rate_hz=1.0)
    assert found.whole().accel_ms2 is None
    assert found.notes == ()


def test_an_accelerometer_with_missing_numbers_is_left_out_and_told(tmp_path: Path) -> None:
    rows = ["1,0,0,1", "nan,0,,1", "2,0,0,1", "3,0,,1", "4,,,"]
    text = "gyro_x_dps,accel_x_ms2,accel_y_ms2,accel_z_ms2\n" + "\n".join(rows) + "\n"
    found = stored(tmp_path, text, rate_hz=1.0)
    assert found.whole().gyro.ravel().tolist() == [1, 2, 3, 4]
    assert found.whole().accel_ms2 is None
    assert [note.kind for note in found.notes] == ["missing_numbers"] * 2
    assert ":5: accel_x_ms2, accel_y_ms2, accel_z_ms2: a row has no acceleration here" in found.notes[0].text
    whole = stored(tmp_path, "\n".join(text.split("\n")[:4]) + "\n", rate_hz=1.0).whole()
    assert whole.accel_ms2.tolist() == [[0, 0, 1]] * 2


# --- times ---


def timed(times: list[float], name: str = "t", separator: str = ",") -> str:
    return f"{name}{separator}gyro_x_dps\n" + "".join(f"{t:.10g}{separator}1\n" for t in times)


@pytest.mark.parametrize(
    ("name", "per_s"),
    [
        ("time_s", 1.0),
        ("t [ms]", 1e3),
        ("time_us", 1e6),
        ("timestamp [ns]", 1e9),
        ("Timestamp(µs)", 1e6),
        ("millis", 1e3),
        ("time", 1.0),
    ],
)
def test_units_of_times_by_their_name(name: str, per_s: float, tmp_path: Path) -> None:
    found = stored(tmp_path, timed([k * per_s / 100 for k in range(200) if k != 50], name))
    assert found.rate_hz == pytest.approx(100.0)
    assert found.whole().device_s[-1] == pytest.approx(1.99)


@pytest.mark.parametrize(("unit", "per_s"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
@pytest.mark.parametrize("rate_hz", [10.0, 100.0, 1000.0])
def test_times_without_a_unit_are_never_taken_for_seconds(
    unit: str, per_s: float, rate_hz: float, tmp_path: Path
) -> None:
    text = timed([round(k * per_s / rate_hz) for k in range(100)])
    reason = refusal(tmp_path, text)
    assert "nothing says what the times of t count" in reason
    assert f"--time-unit {unit}: {rate_hz:g} Hz" in reason
    assert stored(tmp_path, text, time_unit=unit).rate_hz == pytest.approx(rate_hz)


@pytest.mark.parametrize("rate_hz", [400.0, 416.0, 333.0, 64.0])
def test_times_in_whole_milliseconds_are_a_clocks(rate_hz: float, tmp_path: Path) -> None:
    """Times that were rounded to whole milliseconds give the true sampling rate: alternating steps of 2 and 3
    ms mean 400 Hz.

    The rounded times do not count as uneven, and none of the alternating steps counts as a gap.
    """
    times = [round(k * 1000 / rate_hz) for k in range(2000) if k != 1000]
    found = stored(tmp_path, timed(times, "time_ms"))
    assert found.rate_hz == pytest.approx(rate_hz, rel=2e-3)
    in_s = stored(tmp_path, timed([t / 1000 for t in times], "time_s"))
    assert in_s.rate_hz == pytest.approx(found.rate_hz)


@pytest.mark.parametrize("name", ["time_s", "t", "millis"])
def test_with_a_rate_times_still_number_the_samples(name: str, tmp_path: Path) -> None:
    lost = {30, 31, 32, *range(50, 90)}
    scale = 1e3 if name == "millis" else 1.0
    found = stored(
        tmp_path, timed([k * scale / 100 for k in range(200) if k not in lost], name), rate_hz=100.5
    )
    whole = found.whole()
    assert whole.seq.tolist() == [k for k in range(200) if k not in lost]
    assert (found.rate_hz, found.notes) == (100.5, ())


def test_a_rate_that_contradicts_the_times_is_refused_unless_they_are_wrong(tmp_path: Path) -> None:
    text = timed([k / 50 for k in range(100)], "time_s")
    assert "the rate is 50 Hz, and --rate 100 says otherwise" in refusal(tmp_path, text, rate_hz=100.0)
    found = stored(tmp_path, text, rate_hz=100.0, overrule=True)
    assert found.rate_hz == 100.0
    assert found.whole().seq.tolist() == list(range(100))  # type: ignore[union-attr]


def test_times_that_number_nothing_are_told(tmp_path: Path) -> None:
    for times in ([0, 1, 0.5, 2], [0, 0.001, 0.1, 0.101, 0.2, 0.201]):
        found = stored(tmp_path, timed(times), rate_hz=10.0)
        assert found.whole().seq.tolist() == list(range(len(times)))  # type: ignore[union-attr]
        assert found.whole().device_s == pytest.approx(np.arange(len(times)) / 10)
        assert [note.kind for note in found.notes] == ["row_times"]


def test_jitter_of_a_device_is_no_gap_and_times_of_arrival_are_refused(tmp_path: Path) -> None:
    """Jitter of 5 % of the period, as of a device's clock, gives no gaps. Jitter of 40 %, as of times of
    arrival, is refused as too uneven.

    If each step were rounded to whole periods by itself, jitter would give gaps.
    """
    random = np.random.default_rng(1)
    small, large = (np.arange(2000) * 0.01 + random.uniform(-s, s, 2000) for s in (0.0005, 0.004))
    assert stored(tmp_path, timed(small.tolist(), "time_s")).rate_hz == pytest.approx(100, rel=1e-3)
    reason = refusal(tmp_path, timed(large.tolist(), "time_s"))
    assert "too uneven" in reason
    assert "--rate" in reason


def test_times_of_a_form_that_nobody_knows_number_nothing(tmp_path: Path) -> None:
    text = "timestamp,gyro_x_dps\n" + "".join(f"day 3 hour {k},{k}\n" for k in range(9))
    found = stored(tmp_path, text, rate_hz=1.0)
    assert found.samples == 9
    assert "'day 3 hour 0' is no number, so it cannot tell" in found.notes[0].text
    assert ":2: column 'timestamp': 'day 3 hour 0' is not a number. " in refusal(tmp_path, text)
    assert "--rate ?" in refusal(tmp_path, text)


def test_long_files_go_over_many_blocks(tmp_path: Path) -> None:
    n = 150_000
    times = [k / 200 for k in range(n) if k % 10_000 != 9_999]
    lines = timed(times, "time_s").splitlines(keepends=True)
    lines[70_000] = "# a remark\n" + lines[70_000]
    lines[80_000] = lines[80_000].split(",")[0] + ",\n"
    found = stored(tmp_path, "".join(lines))
    whole = found.whole()
    assert found.rate_hz == pytest.approx(200.0)
    assert len(whole.gyro) == found.samples == len(times) - 1
    assert int(np.rint(whole.device_s[-1] * 200)) == round(times[-1] * 200)
    assert ":80002: the first of 1 rows" in found.notes[0].text
    lines[120_000] = "600,1x\n"
    found = stored(tmp_path, "".join(lines))
    assert (
        ":120002: the first of 1 lines that hold no sample and are left out: column 'gyro_x_dps': '1x'"
        in (found.notes[0].text)
    )
    assert found.samples == len(times) - 2


# --- dates and times of day ---


@pytest.mark.parametrize(
    "turn", [datetime(2026, 3, 29, 1, tzinfo=UTC), datetime(2026, 10, 25, 1, tzinfo=UTC)]
)
@pytest.mark.parametrize("form", ["%Y-%m-%d %H:%M:%S.%f", "%H:%M:%S.%f", "%Y-%m-%dT%H:%M:%S.%f%z"])
def test_a_night_of_daylight_saving_loses_nothing_and_is_named(
    turn: datetime, form: str, tmp_path: Path
) -> None:
    """The local time of a logger steps by an hour forwards or backwards.

    If the logger writes the offset from UTC, there is no step.
    """
    times = (turn + timedelta(milliseconds=10 * k) for k in range(-300, 300))
    clock = ZoneInfo("Europe/Berlin")
    rows = "".join(f"{when.astimezone(clock).strftime(form)},1\n" for when in times)
    found = stored(tmp_path, f"time,gyro_x_dps\n{rows}")
    whole = found.whole()
    assert (found.rate_hz, found.samples) == (pytest.approx(100.0), 600)
    assert len(set(whole.seq.tolist())) == 600
    named = [note.text for note in found.notes if "daylight saving" in note.text]
    assert len(named) == (not form.endswith("%z"))
    assert all("column 'time': 1 steps of an hour" in text for text in named)


def test_a_gap_of_another_length_is_no_night_of_daylight_saving(tmp_path: Path) -> None:
    times = [k / 100 + (3590 if k > 300 else 0) for k in range(600)]
    assert not stored(tmp_path, timed(times, "time_s")).notes
    times = [k * 10 + (3600 if k > 300 else 0) for k in range(600)]
    assert not any("daylight" in note.text for note in stored(tmp_path, timed(times, "t_ms")).notes), "3.6 s"


BEGIN = datetime(2023, 5, 3, 9, 46, 40, tzinfo=UTC)

DATES = [
    "2023-05-03T09:46:40",
    "2023-05-03 09:46:40Z",
    "2023-05-03T11:46:40+02:00",
    "2023/05/03, 9:46:40 AM",
    "2023-5-3 9:46:40",
    "03.05.2023 09:46:40",
    "5/3/2023 9:46:40 AM",
    "03-May-2023 09:46:40",
    "3-MAY-23 09:46:40",
    "3 May 2023 09:46:40",
    "May 3, 2023 9:46:40 AM",
    "Wednesday, May 3rd 2023 9:46:40 a.m.",
    "Wed, 03 May 2023 09:46:40 GMT",
]


@pytest.mark.parametrize("text", DATES)
@pytest.mark.parametrize("form", ["{}", '"{}"', "{},1.5", "7,{},1.5", '{{"t":"{}","gx":1.5}}', "t: {}"])
def test_dates_are_seconds_of_unix_time(text: str, form: str) -> None:
    quoted = form.replace('"{}"', "{}")
    expected = quoted.format(f"{BEGIN.timestamp():.0f}")
    assert with_seconds(form.format(text)) == expected


@given(
    st.datetimes(datetime(2000, 1, 1), datetime(2068, 1, 1)),
    st.sampled_from(
        ["%Y-%m-%dT%H:%M:%S.%f", "%d-%b-%Y %H:%M:%S.%f", "%B %d, %Y %I:%M:%S.%f %p", "%d.%m.%y %H:%M:%S.%f"]
    ),
)
def test_any_date_is_its_seconds(when: datetime, form: str) -> None:
    found = with_seconds(f"{when.strftime(form)},1.5").removesuffix(",1.5")
    assert float(found) == pytest.approx(when.replace(tzinfo=UTC).timestamp(), abs=1e-6)


NO_TIMES = ["12-Foo-2023", "00:11:22:33:44:55", "(F4:9B:00:12:34:56)", "x09:46:40", "9:75:40", "9:46:40:12"]
NO_TIMES += ["2023-13-45 09:46:40", "gx:10.5,gy:22.5", '{"gx":10.5}', "1.2.3:45"]


@pytest.mark.parametrize("text", NO_TIMES)
def test_what_is_no_time_stays(text: str) -> None:
    assert with_seconds(f"{text}\n1,2") == f"{text}\n1,2"


@pytest.mark.parametrize("point", [".", ":"])
def test_milliseconds_that_are_not_padded(point: str, tmp_path: Path) -> None:
    """WitMotion's SDK for Python joins the numbers of a chip's time without padding, each converted by `str`.

    See `get_chiptime` in wit_protocol_resolver.py in Python/Python-WitProtocol of
    github.com/WITMOTION/WitStandardProtocol_JY901. So 9:46:40.5 means 5 ms after the second. Read as a
    fraction, it would be half a second after.
    """
    text = "time,wx(deg/s)\n"
    for k in range(400):
        when = BEGIN + timedelta(milliseconds=5 + 20 * k)
        clock = f"{when.hour}:{when.minute}:{when.second}{point}{when.microsecond // 1000}"
        text += f"{when.year}-{when.month}-{when.day} {clock},{k % 7}\n"
    found = stored(tmp_path, text)
    assert found.rate_hz == pytest.approx(50.0)
    assert found.whole().seq.tolist() == list(range(400))  # type: ignore[union-attr]


@given(st.integers(0, 999), st.integers(1, 333), st.sampled_from(["padded", "not padded", "without zeros"]))
def test_parts_of_a_second_are_read_as_they_are_written(begin_ms: int, step_ms: int, form: str) -> None:
    times_ms = [begin_ms + step_ms * k for k in range(max(60, 3000 // step_ms))]
    lines = []
    for time in times_ms:
        ms = time % 1000
        digits = {"padded": f"{ms:03}", "not padded": f"{ms}", "without zeros": f"{ms:03}".rstrip("0")}[form]
        point = "." if digits else ""
        lines.append(f"9:{time // 60_000:02}:{time // 1000 % 60:02}{point}{digits}")
    found = Clocks().with_seconds("\n".join(lines)).split("\n")
    assert [float(one) for one in found] == pytest.approx([32_400 + time / 1000 for time in times_ms])


def test_lines_that_come_one_by_one_are_read_as_a_block() -> None:
    clocks = Clocks()
    lines = [f"9:46:{40 + k // 20}.{50 * k % 1000}" for k in range(60)]
    found = [float(clocks.with_seconds(line)) for line in lines]
    assert found == pytest.approx([35200 + 0.05 * k for k in range(60)])


def test_a_clock_goes_on_at_midnight(tmp_path: Path) -> None:
    begin = datetime(2023, 5, 3, 23, 59, 58, tzinfo=UTC)
    times = [begin + timedelta(milliseconds=10 * k) for k in range(600) if k not in (190, 200, 201)]
    text = "Time,gx (deg/s)\n" + "".join(f"{time:%H:%M:%S.%f},1.5\n" for time in times)
    found = stored(tmp_path, text)
    whole = found.whole()
    assert found.rate_hz == pytest.approx(100.0)
    assert found.notes == ()
    assert whole.seq.tolist() == [k for k in range(600) if k not in (190, 200, 201)]  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("unit", "times", "begins"),
    [
        ("s", [86_399.99, 0.0], False),
        (None, [86_399.0, 1.0], False),
        ("s", [86_399.0, 100.0], True),
        ("s", [86_401.0, 0.5], True),
        ("s", [200_000.0, 113_650.0], True),
        ("s", [100.0, 0.0], True),
        ("ms", [86_399_990.0, 0.0], True),
        ("ms", [4_294_967_290.0, 4.0], False),
        ("ns", [5.0, 1.0], True),
    ],
)
def test_a_step_back_is_a_new_run_unless_a_counter_or_the_day_ended(
    unit: str, times: list[float], begins: bool
) -> None:
    _, found = Elapsed(unit).add(np.array(times), np.zeros((2, 1)))  # type: ignore[arg-type]
    assert found.tolist() == [False, begins]


def days_of(*dates: str) -> list[float]:
    """Return the steps [days] between these dates at midday, as the reader understands the dates.

    A step is NaN if the text before or after it is not read as a date.
    """
    read = with_seconds("\n".join(f"{one} 12:00:00" for one in dates)).split("\n")
    return np.diff([float(one) / 86_400 if one.isdigit() else math.nan for one in read]).tolist()


@pytest.mark.parametrize("sign", ["/", "-"])
@pytest.mark.parametrize("year", ["2023", "23"])
def test_day_and_month_have_one_order_in_a_text(sign: str, year: str) -> None:
    def told(*dates: str) -> list[float]:
        return days_of(*(f"{one}/{year}".replace("/", sign) for one in dates))

    # in the first date, 31 shows that the day comes before the month
    assert told("31/01", "01/02", "02/02") == [1, 1]
    # steps of one day show that the day comes before the month
    assert told("03/05", "04/05", "05/05", "06/05") == [1, 1, 1]
    assert told("11/05", "12/05", "13/05", "14/05") == [1, 1, 1]
    assert told("12/05", "13/05") == [1]  # in the later date, 13 shows that the day comes before the month
    assert told("02/03", "02/04") == [1]
    assert told("05/31", "06/01") == [1]
    assert told("01/31", "02/01") == [1]
    found = told("31/01", "01/02", "02/28")  # once the order of day and month is known, it does not change
    assert found[0] == 1
    assert math.isnan(found[1])


@given(st.dates(date(2000, 1, 1), date(2099, 12, 1)), st.booleans(), st.lists(st.integers(0, 20), max_size=9))
def test_dates_in_either_order_go_on_as_they_are(first: date, is_day_first: bool, steps: list[int]) -> None:
    days = [first + timedelta(days=int(k)) for k in np.cumsum([0, 1, *steps])]
    form = "%d/%m/%Y" if is_day_first else "%m/%d/%Y"
    assume(first.day != first.month or days[1].month == first.month)
    assert days_of(*(day.strftime(form) for day in days)) == [1, *steps]
