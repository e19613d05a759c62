"""Tests units of rates, and .npz files: all content is kept, and errors name the file and the reason."""

import math
from pathlib import Path

import numpy as np
import pytest
from fltea.recording.npz_file import open_npz
from fltea.recording.units import parse_units
from fltea.records.errors import UsageError
from fltea.records.records import Estimate
from fltea.settings.limits import Limits

from tests.rig.host_support import QUICK, fltea_here, strict_records
from tests.rig.text_files import refusal, refused, stored

# --- units ---


@pytest.mark.parametrize(("value", "units"), [("1e200", "dps"), ("-2e6", "dps"), ("1e300", "rad/s")])
def test_rates_that_no_gyroscope_has_are_left_out(value: str, units: str, tmp_path: Path) -> None:
    found = stored(tmp_path, f"gx\n1\n{value}\n2\n", units=units, rate_hz=100.0)
    assert found.whole().seq.tolist() == [0, 2]  # type: ignore[union-attr]
    assert ":3: the first of 1 rows (of 3) with more than 1e+06 deg/s" in found.notes[0].text
    reason = refusal(tmp_path, f"gx\n{value}\n{value}\n", columns=["gx"], units=units, rate_hz=100.0)
    assert reason.startswith(":2: more than 1e+06 deg/s")


@pytest.mark.parametrize(
    ("units", "value", "dps"),
    [
        ("deg/s", 3, 3.0),
        ("°/s", 3, 3.0),
        ("dps", 3, 3.0),
        ("mdps", 1500, 1.5),
        ("rad/s", math.pi, 180.0),
        ("lsb:16.4", 164, 164),
    ],
)
def test_units(units: str, value: float, dps: float, tmp_path: Path) -> None:
    found = stored(tmp_path, f"gx\n{value}\n", columns=["gx"], units=units, rate_hz=100.0).whole()
    # the values stay counts, and their scale is given separately
    assert found.gyro[0, 0] == pytest.approx(dps)
    assert found.lsb_per_dps == (16.4 if units == "lsb:16.4" else None)


@pytest.mark.parametrize("units", ["", "deg", "rps", "lsb", "lsb:", "lsb:0", "lsb:-1", "lsb:nan", "lsb:x"])
def test_unknown_unit_tells_the_known_ones(units: str) -> None:
    with pytest.raises(UsageError, match=r"deg/s, °/s, dps, mdps, rad/s, .*or lsb:N"):
        parse_units(units)


# --- npz ---

GOOD = {"gyro_raw": np.arange(12, dtype=np.int16).reshape(4, 3), "fs_hz": 100.0, "lsb_per_dps": 16.4}


def npz_file(tmp_path: Path, **changes: object) -> Path:
    path = tmp_path / "rest.npz"
    arrays = {name: value for name, value in {**GOOD, **changes}.items() if value is not None}
    np.savez(path, **arrays)
    return path


def test_npz_of_counts(tmp_path: Path) -> None:
    times_s = [5.0, 5.1, 5.1, 5.2]
    path = npz_file(tmp_path, t_host_s=times_s, accel_raw=np.ones((4, 3)), temp_c=np.array("?"))
    found = open_npz(path).whole()
    assert found.gyro.tolist() == GOOD["gyro_raw"].tolist()
    assert (found.rate_hz, found.lsb_per_dps) == (100.0, 16.4)
    assert found.device_s.tolist() == [0, 0.01, 0.02, 0.03]
    assert found.host_s.tolist() == times_s
    assert found.accel.shape == (4, 3)


def test_npz_of_rates_and_numbers_in_brackets(tmp_path: Path) -> None:
    """If an .npz file has rates in deg/s, it needs no scale. A single number, such as the sampling rate, may
    be an array of length one.
    """
    rates = {"gyro_dps": np.ones((2, 1)), "fs_hz": np.array([99.0])}
    found = open_npz(npz_file(tmp_path, gyro_raw=None, lsb_per_dps=None, **rates)).whole()
    assert (found.rate_hz, found.lsb_per_dps, found.gyro.shape) == (99.0, None, (2, 1))


NOT_FINITE = np.array([[0.0] * 3, [0, 1, 2], [0, np.nan, 0], [0, 0, 0]])
BAD_NPZ = {
    "no gyro": ({"gyro_raw": None}, "has no gyro_raw or gyro_dps", "it holds fs_hz, lsb_per_dps"),
    "no rate": ({"fs_hz": None}, "has no fs_hz"),
    "no scale": ({"lsb_per_dps": None}, "has no lsb_per_dps"),
    "nothing": (dict.fromkeys(GOOD), "has no fs_hz, gyro_raw or gyro_dps", "nothing"),
    "one dimension": ({"gyro_raw": np.ones(4)}, "gyro_raw has the shape (4,)"),
    "four axes": ({"gyro_raw": np.ones((4, 4))}, "gyro_raw has the shape (4, 4)"),
    "no axes": ({"gyro_raw": np.ones((4, 0))}, "gyro_raw has the shape (4, 0)"),
    "no rows": ({"gyro_raw": np.ones((0, 3))}, "gyro_raw has no rows"),
    "NaN": ({"gyro_raw": NOT_FINITE}, "gyro_raw is not finite in row 2"),
    "text": ({"gyro_raw": np.array([["a", "b"]])}, "gyro_raw does not hold numbers"),
    "NaN rate": ({"fs_hz": np.nan}, "fs_hz is not finite"),
    "zero rate": ({"fs_hz": 0.0}, "fs_hz has to be one positive number"),
    "two rates": ({"fs_hz": [1.0, 2.0]}, "fs_hz has to be one positive number"),
    "negative scale": ({"lsb_per_dps": -131.0}, "lsb_per_dps has to be one positive number"),
    "few times": ({"t_host_s": np.ones(3)}, "t_host_s has the shape (3,)", "(4,) is needed"),
    "times in a column": ({"t_host_s": np.ones((4, 1))}, "t_host_s has the shape (4, 1)"),
    "one time": ({"t_host_s": 3.0}, "t_host_s has the shape ()"),
    "times backwards": ({"t_host_s": [0.0, 0.02, 0.01, 0.03]}, "t_host_s runs backwards in row 2"),
    "times of another rate": (
        {"t_host_s": [0.0, 1, 2, 3]},
        "t_host_s spans 3 s, but 4 samples at fs_hz = 100",
    ),
    "too large": ({"gyro_raw": np.array([[1.0], [1e9]])}, "gyro_raw is more than 1e+06 deg/s in row 1"),
    "infinite time": ({"t_host_s": np.array([0, 1, np.inf, 3])}, "t_host_s is not finite in row 2"),
    "device times that stand": ({"time_s": np.zeros(4)}, "time_s does not increase in row 1"),
    "few device times": ({"time_s": np.arange(3.0)}, "time_s has the shape (3,); (4,) is needed"),
    "NaN as a number": ({"time_s": np.arange(4.0), "seq": [np.nan] * 4}, "seq is not finite in row 0"),
    "numbers without times": (
        {"time_s": np.arange(4) / 100, "seq": [0, 1, 102, 103], "epoch": np.zeros(4, int)},
        "seq skips samples for which time_s leaves no time in row 2",
    ),
    "accel in a row": ({"accel_raw": np.ones(4)}, "accel_raw has the shape (4,)", "(4, 3) is needed"),
    "NaN accel": ({"accel_raw": NOT_FINITE}, "accel_raw is not finite in row 2"),
    "pickled objects": (
        {"gyro_raw": np.array([[1, None]], dtype=object)},
        "cannot be read as .npz",
        "pickled objects",
    ),
    "text in numbers": ({"gyro_raw": np.array([["1", "2"]])}, "gyro_raw does not hold numbers"),
    "complex": ({"gyro_raw": np.array([[1j, 2]])}, "gyro_raw does not hold numbers"),
}


@pytest.mark.parametrize("name", BAD_NPZ)
def test_bad_npz(name: str, tmp_path: Path) -> None:
    changes, *words = BAD_NPZ[name]
    reason = refused(npz_file(tmp_path, **changes), open_npz)
    assert reason.startswith(":"), reason
    for word in words:
        assert word in reason


def test_what_the_names_say_is_stated(tmp_path: Path) -> None:
    found = open_npz(npz_file(tmp_path, accel_raw=np.ones((4, 3)), accel_lsb_per_g=16384.0))
    assert [f"{one.question}: {one}" for one in found.reading] == [
        "columns: gyro_raw as x, y, z (stated: its name)",
        "unit: lsb:16.4 (stated: lsb_per_dps)",
        "clock: 100 Hz (stated: fs_hz)",
        "accelerometer: accel_raw (stated: accel_lsb_per_g)",
    ]
    plain = open_npz(npz_file(tmp_path, gyro_raw=None, lsb_per_dps=None, gyro_dps=np.ones((4, 2))))
    assert [str(one) for one in plain.reading][:2] == [
        "gyro_dps as x, y (stated: its name)",
        "deg/s (stated: gyro_dps)",
    ]


def test_numbers_that_lack_samples_take_their_time(tmp_path: Path) -> None:
    seq = np.array([0, 1, 102, 103])
    assert open_npz(npz_file(tmp_path, time_s=seq / 100, seq=seq, epoch=np.zeros(4, int))).samples == 4
    begins = npz_file(tmp_path, time_s=np.arange(4) / 100, seq=seq, epoch=np.array([0, 0, 1, 1]))
    assert open_npz(begins).samples == 4


def test_what_is_not_needed_is_not_read(tmp_path: Path) -> None:
    """An array that is not needed is not read, however large it is, or if unpickling it would run code."""
    beside = {"note": np.array({"a": 1}, dtype=object), "large": np.zeros(1 << 20)}
    path = npz_file(tmp_path, **beside)
    assert open_npz(path, Limits(max_mb=0.001)).whole().gyro.tolist() == GOOD["gyro_raw"].tolist()


@pytest.mark.parametrize("data", [b"", b"hello", b"\x93NUMPY", b"PK\x03\x04" + bytes(50), None])
def test_other_files_are_no_npz(data: bytes | None, tmp_path: Path) -> None:
    path = tmp_path / "rest.npz"
    with path.open("wb") as file:
        np.save(file, GOOD["gyro_raw"]) if data is None else file.write(data)
    assert "cannot be read as .npz (it is no zip archive" in refused(path, open_npz)


def test_damaged_npz_is_told_as_such(tmp_path: Path) -> None:
    """Reading an .npz file in which any one byte is changed gives a usage error or the original samples. A
    truncated file gives a usage error.
    """
    path = tmp_path / "rest.npz"
    gyro = np.random.default_rng(1).integers(-99, 99, (8, 1))
    np.savez_compressed(path, **{**GOOD, "gyro_raw": gyro})
    whole = path.read_bytes()
    bad = 0
    for place in range(len(whole)):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0xFF]) + whole[place + 1 :])
        try:
            found = open_npz(path).whole()
        except UsageError:
            bad += 1
        else:
            assert (found.gyro == gyro).all()
    assert bad > len(whole) / 2
    for end in range(0, len(whole) - 1, 17):
        path.write_bytes(whole[:end])
        assert "cannot be read" in refused(path, open_npz)


def test_real_recordings(recordings: Path) -> None:
    long = open_npz(recordings / "mpu6050_sunsided_10min.npz").whole()
    assert (long.gyro.shape, long.lsb_per_dps) == ((65067, 3), 131.0)
    assert long.rate_hz == pytest.approx(99.32, abs=0.01)
    short = open_npz(recordings / "mpu6050_tomisuarez_100s.npz").whole()
    assert (short.gyro.shape, short.accel.shape, short.host_s) == ((9986, 3), (9986, 3), None)
    # standard deviations [deg/s] that were published with the recordings
    assert (long.gyro / 131).std(axis=0) == pytest.approx([0.126, 0.091, 0.113], abs=6e-4)
    assert (short.gyro / 131).std(axis=0) == pytest.approx([0.075, 0.112, 0.094], abs=6e-4)


def test_scale_of_the_accelerometer_makes_its_axes_usable(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    path = tmp_path / "rest.npz"
    counts = {"gyro_raw": rng.integers(-9, 9, (90, 3)), "accel_raw": rng.integers(-99, 99, (90, 3))}
    np.savez(path, **counts, lsb_per_dps=16.4, fs_hz=100.0, accel_lsb_per_g=16384.0)
    found = fltea_here(
        "run", "-s", f"replay:{path}", "--once", *QUICK, "--channels", "accel_y", "--set", "accel.startup=50"
    )
    assert found.returncode == 0
    last = [r for r in strict_records(found.stdout) if isinstance(r, Estimate)][-1]
    assert [*last.axes] == ["accel_y"]
    assert last.axes["accel_y"].fltea.valid
    assert last.axes["accel_y"].unit == "m/s^2"
    np.savez(path, **counts, lsb_per_dps=16.4, fs_hz=100.0)
    told = fltea_here("run", "-s", f"replay:{path}", "--once", *QUICK, "--channels", "accel_y,gyro_x")
    assert "no_axis: the setting 'channels' asks for accel_y, which" in told.stderr
    np.savez(path, **counts, lsb_per_dps=16.4, fs_hz=100.0, accel_lsb_per_g=0.0)
    assert (
        "accel_lsb_per_g has to be one positive number"
        in fltea_here("run", "-s", f"replay:{path}", "--once").stderr
    )
