"""Files as people have them, one of each logger: what they hold, and what a refusal advises, is followed."""

import re
import shlex

import numpy as np
import pytest
from corpus_files import ACCEL_MS2, GYRO_DPS, HERE, RATE_HZ, N
from fltea.archive.info import as_text, summarise
from fltea.records.errors import UsageError
from fltea.records.events import RawBlock
from fltea.records.records import Hello
from fltea.settings.how import How
from fltea.sources.replay import ReplaySource
from fltea.sources.text_events import TextEvents

READ = {
    **dict.fromkeys(("plain.csv", "plain.csv.gz", "plain.csv.bz2", "plain.csv.xz"), ""),
    **dict.fromkeys(("phyphox.csv", "phyphox.zip", "phyphox.xlsx"), ""),
    **dict.fromkeys(("Gyroscope.csv", "sensor_logger.zip", "sensor_logger.json"), ""),
    **dict.fromkeys(("excel_dates.csv", "excel_unicode.txt", "iso_dates.csv", "us_dates.csv"), ""),
    **dict.fromkeys(("pandas.parquet", "pandas.feather", "numpy.npz", "h5py.h5"), ""),
    **dict.fromkeys(("pandas_fixed.h5", "pandas_table.h5"), ""),
    **dict.fromkeys(("matlab.mat", "matlab73.mat", "px4.ulg", "json.mcap", "protobuf.mcap"), ""),
    **dict.fromkeys(("adafruit_mpu6050.txt", "adafruit_lsm6ds.txt", "sparkfun_icm20948.txt"), "--rate 100"),
    "excel_seconds.csv": "--rate 100",
    "coarse_clock.csv": "--rate 7500",
    "ros_sec_nanosec.csv": "--units rad/s",
    **dict.fromkeys(("betaflight.csv", "esp32.txt", "arduino_monitor.txt"), "--units dps"),
    "plotter.txt": "--units dps --rate 100",
    "bno055.txt": "--units dps --rate 100",
    "i2cdevlib_raw.txt": "--columns 5,6,7 --rate 100 --units lsb:131",
    "no_header.csv": "--columns 2,3,4 --time-column 1 --time-unit ms --units dps",
    "other_names.csv": "--columns roll,pitch,yaw --time-column counter --time-unit ms --units dps",
}
"""By the name of a file, the options that its refusals advise, one after the other, until it is read."""

RATES_HZ = {"coarse_clock.csv": 7500.0}
IN_RADS = {"bno055.txt"}
"""Which nothing in the file says, so that the advice, deg/s, is wrong, and a person has to know it."""
ERROR_DPS = {"i2cdevlib_raw.txt": 0.5 / 131}

FOREIGN = {
    "betaflight.bbl": r"is a Betaflight blackbox log\..*blackbox_decode \S*betaflight\.bbl",
    "ardupilot.bin": r"is an ArduPilot DataFlash log\..*mavlogdump\.py --format csv --types IMU \S*\.bin",
    "old_excel.xls": r"is a file of an old Excel.*libreoffice --headless --convert-to csv \S*old_excel\.xls",
}

NOT_LIVE = "Gyroscope.csv", "excel_unicode.txt"
"""The first says by its name what it is; the second is UTF-16, which nobody sends line by line."""
LIVE = [name for name in READ if name.endswith((".txt", ".csv")) and name not in NOT_LIVE]

OPTION = r"--(?:rate|units|time-unit) [^\s.,;]\S*(?<![.,;)])"


def advised(text: str) -> list[str]:
    """The options that a refusal names for this file."""
    _, found, options = text.partition("Probably this reads it; check which columns are the gyroscope's: ")
    return shlex.split(options) if found else shlex.split(re.findall(OPTION, text)[0])


def how_of(options: list[str]) -> How:
    given = dict(zip(options[::2], options[1::2], strict=True))
    columns, rate = given.get("--columns"), given.get("--rate")
    return How(
        columns=columns.split(",") if columns else None,
        units=given.get("--units"),
        rate_hz=float(rate) if rate else None,
        time_column=given.get("--time-column"),
        time_unit=given.get("--time-unit"),  # type: ignore[arg-type]
    )


def read(name: str) -> tuple[list[str], ReplaySource]:
    """Open a file, and do what each refusal says until there is none."""
    options: list[str] = []
    for _ in range(3):
        try:
            return options, ReplaySource(HERE / name, how=how_of(options))
        except UsageError as error:
            options += advised(str(error))
    raise AssertionError(options)


@pytest.mark.parametrize("name", READ)
def test_a_file_of_each_logger_is_read_as_its_refusals_advise(name: str) -> None:
    options, source = read(name)
    assert " ".join(options) == READ[name]
    events = list(source.events())
    (hello,) = [event for event in events if isinstance(event, Hello)]
    blocks = [event for event in events if isinstance(event, RawBlock)]
    gyro = np.concatenate([block.gyro for block in blocks]) / (hello.gyro_lsb_per_dps or 1.0)
    assert hello.rate_hz == pytest.approx(RATES_HZ.get(name, RATE_HZ), rel=1e-6)
    truth = np.radians(GYRO_DPS) if name in IN_RADS else GYRO_DPS
    assert gyro == pytest.approx(truth, abs=ERROR_DPS.get(name, 6e-4))
    accel = [block.accel for block in blocks if block.accel is not None]
    if accel:
        assert np.concatenate(accel) == pytest.approx(ACCEL_MS2, abs=6e-3)
    text = as_text(summarise([HERE / name], 100, how=how_of(options)))
    assert f"samples    {N}, 0 lost in 0 gaps" in text
    assert not re.search(r"None|\bnan\b|\\x", text)


@pytest.mark.parametrize("name", FOREIGN)
def test_what_is_not_read_is_called_by_its_name(name: str) -> None:
    with pytest.raises(UsageError, match=FOREIGN[name]):
        ReplaySource(HERE / name)


@pytest.mark.parametrize("name", LIVE)
def test_live_text_gives_the_same_samples(name: str) -> None:
    data, how = (HERE / name).read_bytes(), how_of(shlex.split(READ[name]))
    live = TextEvents("stdin:", how, fatal=False)
    live.open(0, within_line=False)
    events = [event for k in range(0, len(data), 997) for event in live.feed(data[k : k + 997], 0)]
    gyro = np.concatenate([event.gyro for event in [*events, *live.finish(0)] if isinstance(event, RawBlock)])
    stored = ReplaySource(HERE / name, how=how)
    assert gyro.tolist() == [
        row for e in stored.events() if isinstance(e, RawBlock) for row in e.gyro.tolist()
    ]


@pytest.mark.parametrize("name", ["no_header.csv", "i2cdevlib_raw.txt"])
def test_a_column_that_no_gyroscope_gives_is_refused(name: str) -> None:
    wrong = {
        "no_header.csv": (
            How(columns=["1", "2", "3"], rate_hz=100.0, units="dps"),
            "column '1' rises from each of its 60 rows",
        ),
        "i2cdevlib_raw.txt": (
            How(columns=["4"], rate_hz=100.0, units="dps"),
            "beyond 4000 deg/s in 60 of 60 rows",
        ),
    }
    how, reason = wrong[name]
    with pytest.raises(UsageError, match=reason) as caught:
        ReplaySource(HERE / name, how=how)
    better = advised(str(caught.value))
    assert ReplaySource(HERE / name, how=how_of([*better])) if "--columns" in better else "lsb:131" in better
