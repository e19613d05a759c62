"""Tests the head of a text: column names with blanks, units of times, and facts in plain words."""

from pathlib import Path

import numpy as np
import pytest
from fltea.recording.files import Stored
from fltea.recording.text_rows import TextReader
from fltea.settings.how import How

from tests.rig.text_files import refusal, stored

N, RATE_HZ = 400, 100.0
GYRO_DPS = np.round(np.random.default_rng(3).normal([0.5, -0.3, 0.2], 0.2, (N, 3)), 5)


def table(head: str, separator: str = ",", times_s: float | None = 1.0, factor: float = 1.0) -> str:
    """Return a text that consists of a head and rows.

    `times_s`: unit of the times, in seconds, such as 0.001 for ms; None for no column of times. `factor`: the
    rates in deg/s are multiplied by this factor.
    """
    rows = []
    for k, rates in enumerate(GYRO_DPS * factor):
        time = [] if times_s is None else [f"{k / RATE_HZ / times_s:.12g}"]
        rows.append(separator.join([*time, *(f"{rate:.9g}" for rate in rates)]))
    return f"{head}\n" + "\n".join(rows) + "\n"


def is_right(found: Stored) -> bool:
    recording = found.whole()
    is_counted = found.lsb_per_dps or 1.0
    gyro_dps = recording.gyro / is_counted
    is_same = gyro_dps.shape == (N, 3) and np.allclose(gyro_dps, GYRO_DPS, atol=2e-5)
    return is_same and found.rate_hz == pytest.approx(RATE_HZ, rel=1e-6)


NAMES_WITH_BLANKS = {
    "Time [s],Body rate X [deg/s],Body rate Y [deg/s],Body rate Z [deg/s]": (",", 1.0),
    "Time (s);Drehrate X (°/s);Drehrate Y (°/s);Drehrate Z (°/s)": (";", 1.0),
    "Time [s]\tVitesse X [°/s]\tVitesse Y [°/s]\tVitesse Z [°/s]": ("\t", 1.0),
    "loopIteration, time (ms), gyroADC[0] (deg/s), gyroADC[1] (deg/s), gyroADC[2] (deg/s)": (", ", 1e-3),
    "Zeit in s,gx in deg/s,gy in deg/s,gz in deg/s": (",", 1.0),
    "Time [min],Gyro X (deg/s),Gyro Y (deg/s),Gyro Z (deg/s)": (",", 60.0),
    "Time,Gyro X,Gyro Y,Gyro Z\nh,deg/s,deg/s,deg/s": (",", 3600.0),
}


@pytest.mark.parametrize("head", NAMES_WITH_BLANKS)
def test_names_with_blanks_are_split_as_the_rows_are(tmp_path: Path, head: str) -> None:
    separator, times_s = NAMES_WITH_BLANKS[head]
    text = table(head, separator, times_s)
    if head.startswith("loop"):
        first, *rows = text.splitlines()
        text = "\n".join([first, *(f"{k}, {row}" for k, row in enumerate(rows))]) + "\n"
    assert is_right(stored(tmp_path, text))


@pytest.mark.parametrize("units", ["", "\ns;deg/s;deg/s;deg/s"])
def test_names_that_only_blanks_would_tell_apart_are_asked_for(tmp_path: Path, units: str) -> None:
    text = table(f"time_s;wx wy wz;b;c{units}", ";")
    told = refusal(tmp_path, text, units="dps")
    assert told.startswith(":1: nothing says which columns are the gyroscope's axes. Say it")
    assert "2  wx wy wz: mean" in told
    assert is_right(stored(tmp_path, text, units="dps", columns=["2", "3", "4"], time_column="1"))


@pytest.mark.parametrize("unit", ["weeks", "ticks", "10us"])
def test_a_unit_of_times_that_is_not_known_is_asked_for(tmp_path: Path, unit: str) -> None:
    in_row = f"Time,Gyro X,Gyro Y,Gyro Z\n{unit},deg/s,deg/s,deg/s"
    for head in (in_row, f"Time [{unit}],Gyro X (deg/s),Gyro Y (deg/s),Gyro Z (deg/s)"):
        told = refusal(tmp_path, table(head))
        assert f"the file says {unit}" in told
        assert "--time-unit ?" in told
        assert is_right(stored(tmp_path, table(head), time_unit="s"))
        assert is_right(stored(tmp_path, table(head), rate_hz=100.0))


def test_a_stated_unit_of_times_that_the_user_denies_is_an_error(tmp_path: Path) -> None:
    text = table("Time [min],Gyro X (deg/s),Gyro Y (deg/s),Gyro Z (deg/s)", times_s=60.0)
    assert "is in min by its name" in refusal(tmp_path, text, time_unit="s")


STATED = {
    "# Sample rate: 100 Hz": 1.0,
    "% fs = 100": 1.0,
    "Sampling Frequency,100 Hz": 1.0,
    "Sample Rate (Hz),100": 1.0,
    "# gyro range: 250 dps, ODR 100Hz": 1.0,
    "Update Rate: 0.1 kHz": 1.0,
    "OutputRate:,100Hz": 1.0,
    "# Sampling period: 10 ms": 1.0,
    "# dt = 0.01 s": 1.0,
    "# Accel rate: 1000 Hz\n# Gyro rate: 100 Hz": 1.0,
    "Sample rate: 100 Hz, GPS rate: 5 Hz": 1.0,
    '{"sample_rate_hz": 100, "unit": "none"}': 1.0,
}
"""Heads of texts that state a sampling rate of 100 Hz."""


@pytest.mark.parametrize("head", STATED)
def test_a_rate_in_plain_words_is_stated(tmp_path: Path, head: str) -> None:
    text = f"{head}\n" + table("gx_dps,gy_dps,gz_dps", times_s=None)
    assert is_right(stored(tmp_path, text))
    assert is_right(stored(tmp_path, text, rate_hz=100.0))
    told = refusal(tmp_path, text, rate_hz=200.0)
    assert "stands in the head, and --rate 200 says otherwise" in told
    assert stored(tmp_path, text, rate_hz=200.0, overrule=True).rate_hz == 200.0
    timed = f"{head}\n" + table("time_s,gx_dps,gy_dps,gz_dps", times_s=2.0)
    assert "the file states 100 Hz. Say which is right" in refusal(tmp_path, timed)


NOT_STATED = (
    "# Accelerometer rate: 1000 Hz\n# Magnetometer rate: 50 Hz",
    "# baud rate: 115200",
    "# cutoff frequency: 50 Hz",
    "# fs = 250",
    "# Recording interval: 60 s",
    "# frame rate: 30 Hz",
    "# LSM6DSO, 104 Hz",
    "# Rate: 50 Hz\n# Sample rate: 100 Hz",
)


@pytest.mark.parametrize("head", NOT_STATED)
def test_a_rate_of_something_else_or_of_two_is_asked_for(tmp_path: Path, head: str) -> None:
    text = f"{head}\n" + table("gx_dps,gy_dps,gz_dps", times_s=None)
    assert "--rate ?" in refusal(tmp_path, text)
    assert is_right(stored(tmp_path, text, rate_hz=100.0))


UNITS = {
    "# Units: deg/s": 1.0,
    "% gyro in deg/s": 1.0,
    "Gyro Unit,rad/s": np.pi / 180,
    "# Units: s, g, rad/s": np.pi / 180,
    "# Gyroscope (deg/min)": 60.0,
    "# Accelerometer units: g, gyroscope units: mrad/s": np.pi / 0.18,
    '{"rate_hz": 100, "units": "deg/h"}': 3600.0,
    "# scale: 131 LSB/(deg/s)": 131.0,
    "# gyro sensitivity 17.50 mdps/LSB": 1 / 0.0175,
}
"""Heads of texts that state a unit of the rates, and how many of this unit make 1 deg/s."""


@pytest.mark.parametrize("head", UNITS)
@pytest.mark.parametrize("names", ["gx,gy,gz\n", ""])
def test_a_unit_in_plain_words_is_stated(tmp_path: Path, head: str, names: str) -> None:
    per_dps = UNITS[head]
    rows = np.rint(GYRO_DPS * per_dps) if "/LSB" in head or "LSB/" in head else GYRO_DPS * per_dps
    text = f"{head}\n{names}" + "".join(",".join(f"{v:.9g}" for v in row) + "\n" for row in rows)
    how: dict[str, object] = {"rate_hz": 100.0} | ({} if names else {"columns": ["1", "2", "3"]})
    found = stored(tmp_path, text, **how)
    gyro_dps = found.whole().gyro / (found.lsb_per_dps or 1.0)
    assert np.allclose(gyro_dps, rows / per_dps, atol=2e-5)
    (answer,) = [one for one in found.reading if one.question == "unit"]
    assert answer.evidence == "stated"
    assert answer.why.startswith("the head: ")
    assert "by the head" in refusal(tmp_path, text, units="mdps", **how)
    assert stored(tmp_path, text, units="mdps", overrule=True, **how)


UNITS_OF_OTHERS = (
    "# Max rate [deg/s]",
    "# gyro bias: 0.5 dps",
    "# gyro noise density: deg/s",
    "# accelerometer scale: 16384 LSB/g",
    "# gyro range: 250 dps",
    "# Units: rad/s\n# gyro in deg/s and rad/s",
    "# gyro unit: rad/s\n# gyro unit: deg/s",
    "# scale: 131 LSB/dps",  # the numbers contradict this scale: they have fractions, so they are no counts
)


@pytest.mark.parametrize("head", UNITS_OF_OTHERS)
def test_a_unit_of_something_else_or_of_two_is_asked_for(tmp_path: Path, head: str) -> None:
    text = f"{head}\n" + table("gx,gy,gz", times_s=None)
    assert "--units ?" in refusal(tmp_path, text, rate_hz=100.0)
    assert is_right(stored(tmp_path, text, rate_hz=100.0, units="deg/s"))


def test_a_unit_in_the_head_and_one_in_the_names_contradict(tmp_path: Path) -> None:
    text = "# Units: rad/s\n" + table("time_s,gx_dps,gy_dps,gz_dps")
    assert 'gx_dps is in deg/s by its name or the row of units, and "Units: rad/s" stands' in refusal(
        tmp_path, text
    )
    assert is_right(stored(tmp_path, text, units="dps", overrule=True))


GYROFLOW = (
    "GYROFLOW IMU LOG\nversion,1.3\norientation,XYZ\ntscale,0.001\ngscale,0.000266\nascale,0.0004883\n"
    "t,gx,gy,gz,ax,ay,az\n"
)


def test_scales_in_a_head_hold_whatever_unit_is_given(tmp_path: Path) -> None:
    counts = np.rint(np.radians(GYRO_DPS) / 0.000266)
    rows = [f"{10 * k},{x:.0f},{y:.0f},{z:.0f},10,-20,2048\n" for k, (x, y, z) in enumerate(counts)]
    text = GYROFLOW + "".join(rows)
    found = stored(tmp_path, text).whole()
    assert np.allclose(found.gyro, np.degrees(counts * 0.000266))
    for how in ({"units": "rad/s"}, {"accel_units": "g"}, {"time_unit": "ms"}):
        again = stored(tmp_path, text, **how).whole()
        assert np.allclose(again.gyro, found.gyro)
        assert np.allclose(again.accel_ms2, found.accel_ms2)
        assert again.rate_hz == pytest.approx(100.0)
    assert ":7: gscale 0.000266 stands in the head: times that" in refusal(tmp_path, text, units="dps")
    assert "tscale 0.001 stands in the head" in refusal(tmp_path, text, time_unit="us")
    assert stored(tmp_path, text, units="dps", overrule=True).whole().gyro == pytest.approx(counts)


def test_seconds_in_two_columns_are_one_clock_beside_another(tmp_path: Path) -> None:
    """The program bagpy writes a topic of a ROS bag in this form. `Time` is the time of recording; `secs` and
    `nsecs` together are the time of the message.
    """
    head = (
        "Time,header.stamp.secs,header.stamp.nsecs,angular_velocity.x,angular_velocity.y,angular_velocity.z"
    )
    rows = [
        f"{1.6e9 + k / RATE_HZ + 0.001:.6f},{1_600_000_000 + k // 100},{k % 100 * 10_000_000},{x},{y},{z}\n"
        for k, (x, y, z) in enumerate(np.radians(GYRO_DPS))
    ]
    assert is_right(stored(tmp_path, f"{head}\n" + "".join(rows)))
    slow = [row.replace(row.partition(",")[0], f"{1.6e9 + k / 80:.6f}") for k, row in enumerate(rows)]
    assert "differ by a factor of 1.25" in refusal(tmp_path, f"{head}\n" + "".join(slow))


def test_dates_of_a_logger_are_not_in_its_unit_of_numbers(tmp_path: Path) -> None:
    names = ["Timestamp_FormattedUnix_CAL", *(f"Gyro_{axis}_CAL" for axis in "XYZ")]
    units = "yyyy/mm/dd hh:mm:ss.000,deg/s,deg/s,deg/s"
    rows = [
        f"2023/05/03 12:{k // 6000:02d}:{k / 100 % 60:06.3f},{x},{y},{z}"
        for k, (x, y, z) in enumerate(GYRO_DPS)
    ]
    text = "\n".join([",".join(f"Shimmer_B5A1_{name}" for name in names), units, *rows]) + "\n"
    assert is_right(stored(tmp_path, text))


@pytest.mark.parametrize("form", ["{:,.0f}", "{:,.1f}"])
@pytest.mark.parametrize("is_german", [True, False])
def test_numbers_with_signs_between_thousands_are_refused(tmp_path: Path, form: str, is_german: bool) -> None:
    """Numbers with a separator of thousands are refused. Otherwise 53,456 could be read as 53.456, a
    thousandth of its value.
    """
    signs = str.maketrans(",.", ".,") if is_german else {}
    separator = ";" if is_german else ","

    def number(value: float) -> str:
        text = form.format(value).translate(signs)
        return text if is_german else f'"{text}"'

    rows = [separator.join(map(number, [1e6 + 10 * k, *(1e5 * rates)])) for k, rates in enumerate(GYRO_DPS)]
    head = separator.join(("time_ms", "gx_mdps", "gy_mdps", "gz_mdps"))
    for how in ({}, {"rate_hz": 100.0}, {"columns": ["2", "3", "4"], "units": "mdps", "rate_hz": 100.0}):
        text = ("" if "columns" in how else f"{head}\n") + "\n".join(rows) + "\n"
        told = refusal(tmp_path, text, **how)
        assert "has signs between its thousands" in told
        assert "Write numbers without them: 1000010" in told


def test_addresses_and_decimal_signs_are_no_thousands(tmp_path: Path) -> None:
    rows = [f"192.168.001.100;{10 * k};{x};{y};{z}\n" for k, (x, y, z) in enumerate(GYRO_DPS)]
    assert is_right(stored(tmp_path, "host;time_ms;gx_dps;gy_dps;gz_dps\n" + "".join(rows)))
    whole = [f"{10 * k},100,200,{300 + k % 7}\n" for k in range(N)]
    assert stored(tmp_path, "time_ms,gx_dps,gy_dps,gz_dps\n" + "".join(whole)).samples == N


@pytest.mark.parametrize("sign", ["", ":"])
def test_an_accelerometer_on_other_lines_is_said_not_to_be_read(tmp_path: Path, sign: str) -> None:
    """Adafruit's examples print the accelerometer on separate lines."""
    text = "".join(
        f"Acceleration{sign} X: 0.20, Y: -0.30, Z: 9.80 m/s^2\nGyro X: {x}, Y: {y}, Z: {z} rad/s\n\n"
        for x, y, z in np.radians(GYRO_DPS)
    )
    found = stored(tmp_path, text, rate_hz=100.0)
    assert is_right(found)
    (answer,) = [one for one in found.reading if one.question == "accelerometer"]
    assert answer.value == "not read"
    assert answer.why.startswith("Acceleration X, Acceleration Y, Acceleration Z stand on other lines")


@pytest.mark.parametrize(("unit", "per_dps"), [("deg/s", 1.0), ("rad/s", np.pi / 180)])
def test_what_betaflights_decoder_converts_is_in_the_unit_of_its_names(
    tmp_path: Path, unit: str, per_dps: float
) -> None:
    names = [f"{name}[{k}] ({unit})" for name in ("gyroADC", "gyroUnfilt") for k in range(3)]
    rows = [
        f"{k}, {10_000 * k}, 0, 0, 0, {x:.9g}, {y:.9g}, {z:.9g}\n"
        for k, (x, y, z) in enumerate(GYRO_DPS * per_dps)
    ]
    text = ", ".join(["loopIteration, time (us)", *names]) + "\n" + "".join(rows)
    assert is_right(stored(tmp_path, text))
    assert f"is in {unit} by its name" in refusal(tmp_path, text, units="mdps")


@pytest.mark.parametrize(
    "head",
    [
        "# Sample rate: 100 Hz\n# Units: deg/s\ngx,gy,gz",
        "gx,gy,gz\n# Sample rate: 100 Hz\n# Units: deg/s",
        "Sampling Frequency,100 Hz\nGyro unit,deg/s\ngx,gy,gz",
        "# fs = 100\nBody rate X [deg/s],Body rate Y [deg/s],Body rate Z [deg/s]",
    ],
)
def test_live_text_is_understood_as_a_file_is(tmp_path: Path, head: str) -> None:
    data = table(head, times_s=None).encode()
    assert is_right(stored(tmp_path, data))
    reader = TextReader("stdin", How())
    values = [rows.values for k in range(0, len(data), 7) for rows in reader.feed(data[k : k + 7])]
    assert reader.chosen is not None
    assert reader.chosen.rate.hz == 100.0
    assert np.allclose(np.concatenate(values)[:, :3], GYRO_DPS)
