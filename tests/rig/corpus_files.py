"""Write the binary files of tests/recording/corpus: the same 60 samples at rest, at 100 Hz, in each format.

The library of each format writes its files. The text files are kept as loggers print them (see README.md in
that folder). Run this file with `.venv/bin/python` in the clone.
"""

import bz2
import csv
import datetime
import gzip
import io
import json
import lzma
import math
import re
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import asammdf
import h5py
import nptdms
import numpy as np
import openpyxl
import pyarrow as pa
import scipy.io
from pyarrow import feather, parquet

from tests.rig.foxglove_files import write_mcap
from tests.rig.log_files import IMU_FORM, dataflash, ulog

HERE = Path(__file__).parents[1] / "recording/corpus"
N, RATE_HZ = 60, 100.0
TIMES_S = np.arange(N) / RATE_HZ
_random = np.random.default_rng(20231114)
GYRO_DPS = np.round(0.2 * _random.normal(size=(N, 3)) + [0.5, -0.3, 0.1], 3)
"""The angular rates [deg/s] that every file contains; each logger rounds them to its own precision."""
ACCEL_MS2 = np.round(0.02 * _random.normal(size=(N, 3)) + [0.1, -0.2, 9.81], 3)
RADS = np.radians(GYRO_DPS)

Columns = dict[str, Any]
"""Content of a file by name: arrays, texts and single numbers. NaN stands for a missing value."""


class Example(NamedTuple):
    """How the example file of a format is made. The tests also write other columns by `write`.

    `file`: name of the example file.
    `write`: writes columns to a file, with the library of the format.
    `columns`: columns of the example file.
    `gyro`: name of one gyroscope column.
    `fixed`: why the format cannot hold other columns; "" if it can.
    `is_even`: whether files of the format have columns of the same length only, and no single numbers.
    `never_missing`: why no value can be missing in such a file; "" if one can.
    """

    file: str
    write: Callable[[Path, Columns], None]
    columns: Columns
    gyro: str
    fixed: str = ""
    is_even: bool = False
    never_missing: str = ""


def listed(values: Any, missing: Any = None) -> Any:
    """Return an array or a number as values of Python, with `missing` in place of NaN."""
    found = np.asarray(values).tolist()
    return [missing if one != one else one for one in found] if isinstance(found, list) else found


def rows_of(columns: Columns, missing: Any = None) -> list[tuple[Any, ...]]:
    """Return columns of the same length as rows."""
    return list(zip(*(listed(values, missing) for values in columns.values()), strict=True))


RATES_HZ = {
    **dict.fromkeys(("gopro.csv", "gopro_zxy.csv"), 200.0),
    "arduino_simple_gyroscope.txt": 104.0,
    "coarse_clock.csv": 7500.0,
    "xsens_dot.csv": 60.0,
}
"""Sampling rates [Hz] of loggers that have a fixed rate other than 100 Hz, by the name of their file."""
COARSE_DPS = {
    **dict.fromkeys(("mavlink_bare_raw.csv", "mavlink_bare_scaled.csv"), 0.03),
    **dict.fromkeys(("mavlink_raw_imu.csv", "mavlink_scaled_imu2.csv"), 0.03),
    "arduino_simple_gyroscope.txt": 0.0051,
    "betaflight_unfiltered.csv": 0.051,
    "gyroflow.gcsv": 0.002,
    "i2cdevlib_raw.txt": 0.5 / 131,
}
"""Half a quantisation step [deg/s] of loggers that round coarsely, by the name of their file."""


def text(name: str) -> bytes:
    return (HERE / name).read_bytes()


def archive(files: dict[str, bytes]) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, data in files.items():
            packed.writestr(zipfile.ZipInfo(name), data)
    return out.getvalue()


def timeless(book: io.BytesIO) -> bytes:
    """Return an Excel workbook in which the times of writing are replaced, so that the file is the same at
    each run.
    """
    with zipfile.ZipFile(book) as parts:
        files = {name: parts.read(name) for name in parts.namelist()}
    files["docProps/core.xml"] = re.sub(
        rb">[^<>]*Z</dcterms", b">2023-11-14T00:00:00Z</dcterms", files["docProps/core.xml"]
    )
    return archive(files)


def packed() -> dict[str, bytes]:
    """Return compressed and archived text files, and the beginnings of files that the program must refuse."""
    plain = text("plain.csv")
    phone = {"Accelerometer.csv": b"time,seconds_elapsed,z,y,x\n", "Gyroscope.csv": text("Gyroscope.csv")}
    blackbox = b"H Product:Blackbox flight data recorder by Nicholas Sherlock\nH Data version:2\n"
    return {
        "plain.csv.gz": gzip.compress(plain, mtime=0),
        "plain.csv.bz2": bz2.compress(plain),
        "plain.csv.xz": lzma.compress(plain),
        "phyphox.zip": archive({"Raw Data.csv": text("phyphox.csv"), "meta/device.csv": b"property,value\n"}),
        "sensor_logger.zip": archive({**phone, "Metadata.csv": b"version\n3\n"}),
        "betaflight.bbl": blackbox + bytes(64),
        "old_excel.xls": bytes.fromhex("d0cf11e0a1b11ae1") + bytes(64),
    }


def printed() -> bytes:
    """Return the output of `fltea run --samples` for the samples of the corpus, without estimates."""
    hello = {"class": "hello", "source": "rest", "host_ns": 0, "rate_hz": RATE_HZ, "sampling_mode": "timer"}
    samples = (
        {
            "class": "sample",
            "seq": k,
            "device_us": 10_000 * k,
            "host_ns": 10_000_000 * k,
            "epoch": 1,
            "gyro_dps": GYRO_DPS[k].tolist(),
        }
        for k in range(N)
    )
    return b"".join(json.dumps(record).encode() + b"\n" for record in (hello, *samples))


def records(path: Path, columns: Columns) -> None:
    """Write JSON: one object for each row. Columns that differ in length become lists in one object."""
    lists = {name: listed(values) for name, values in columns.items()}
    rows = rows_of(columns) if len({np.shape(values) for values in columns.values()}) == 1 else []
    content = [dict(zip(columns, row, strict=True)) for row in rows] or lists
    path.write_text(json.dumps(content, separators=(",", ":")))


def workbook(path: Path, columns: Columns) -> None:
    """Write an Excel workbook as phyphox does: names and samples in the first of two sheets."""
    book = openpyxl.Workbook()
    sheet = book.active
    sheet.title = "Raw Data"
    sheet.append([*columns])
    for row in rows_of(columns):
        sheet.append(row)
    book.create_sheet("Metadata Device").append(["property", "value"])
    saved = io.BytesIO()
    book.save(saved)
    path.write_bytes(timeless(saved))


def arrow_table(columns: Columns) -> pa.Table:
    return pa.table({name: pa.array(values, from_pandas=True) for name, values in columns.items()})


def hdf5(path: Path, columns: Columns) -> None:
    with h5py.File(path, "w", track_order=True) as file:
        for name, values in columns.items():
            owner, _, attribute = name.partition("@")
            if attribute:
                file[owner].attrs[attribute] = values
            else:
                file[name] = listed(values) if np.asarray(values).dtype.kind == "U" else values


def matlab(path: Path, columns: Columns) -> None:
    """Write a file of MATLAB 5. A name with a point, such as `imu.gyro`, is a field of a structure."""
    variables: dict[str, Any] = {}
    for name, values in columns.items():
        of, _, field = name.rpartition(".")
        (variables.setdefault(of, {}) if of else variables)[field] = values
    scipy.io.savemat(path, variables)
    with path.open("r+b") as raw:
        # the time of writing is left out, so that the file is always the same
        raw.write(b"MATLAB 5.0 MAT-file Platform: posix".ljust(116))


def px4(path: Path, columns: Columns) -> None:
    form = "float[3] gyro_rad;uint32_t gyro_integral_dt;float[3] accelerometer_m_s2;"
    rows = ((0, "3fI3f", time_us, *gyro, dt_us, *accel) for time_us, gyro, dt_us, accel in rows_of(columns))
    path.write_bytes(ulog({"sensor_combined": form}, [("sensor_combined", 0)], rows))


def ardupilot(path: Path, columns: Columns) -> None:
    path.write_bytes(dataflash({"IMU": IMU_FORM}, (("IMU", *row) for row in rows_of(columns, math.nan))))


def tdms(path: Path, columns: Columns) -> None:
    """Write a file of LabVIEW. A name such as `IMU/Gyro X@unit_string` is a property of a channel."""
    facts = {name: values for name, values in columns.items() if np.ndim(values) == 0}
    channels = []
    for name, values in columns.items():
        if name not in facts:
            group, _, channel = name.rpartition("/")
            said = {key.partition("@")[2]: one for key, one in facts.items() if key.startswith(f"{name}@")}
            values = listed(values) if np.asarray(values).dtype.kind == "U" else np.asarray(values)
            channels.append(nptdms.ChannelObject(group or "rest", channel, values, said))
    plain = {name: one for name, one in facts.items() if "@" not in name}
    with nptdms.TdmsWriter(path) as out:
        out.write_segment([*([nptdms.GroupObject("rest", plain)] if plain else []), *channels])


def measurements(path: Path, columns: Columns) -> None:
    """Write ASAM MDF, which is usual in vehicles: groups of channels with a clock `t` each, such as `imu.t`.

    A missing value is marked in the invalidation bits.
    """
    groups: dict[str, list[asammdf.Signal]] = {}
    for name, values in columns.items():
        group, _, channel = name.partition(".")
        if "@" not in name and channel != "t":
            none = np.isnan(values)
            unit, times_s = columns[f"{name}@unit"], columns[f"{group}.t"]
            bits = asammdf.signal.InvalidationArray(none) if none.any() else None
            one = asammdf.Signal(values, times_s, unit=unit, name=channel, invalidation_bits=bits)
            groups.setdefault(group, []).append(one)
    with asammdf.MDF(version="4.10") as file:
        file.start_time = datetime.datetime(2023, 11, 14, tzinfo=datetime.UTC)
        for group, signals in groups.items():
            file.append(signals, acq_name=group)
        file.save(path, overwrite=True)
    data = bytearray(path.read_bytes())
    written = data.index(b"##FH") + 40
    data[written : written + 8] = bytes(8)
    path.write_bytes(data)


AXES = {f"gyro_{axis}_dps": GYRO_DPS[:, i] for i, axis in enumerate("xyz")}
STAMPED = {"when": (np.arange(N) * 10_000_000).astype("M8[ns]"), **AXES}
PHYPHOX = next(csv.reader([text("phyphox.csv").decode().splitlines()[0]]))
IMU_REST = {"EG": 0, "EA": 0, "T": 25.0, "GH": 1, "AH": 1, "GHz": 1000, "AHz": 1000}
OF_SENSOR = "its messages have fields of their own"

EXAMPLES = {
    "xlsx": Example(
        "phyphox.xlsx",
        workbook,
        dict(
            zip(
                PHYPHOX,
                (TIMES_S, *RADS.T, [math.sqrt(x * x + y * y + z * z) for x, y, z in RADS.tolist()]),
                strict=True,
            )
        ),
        PHYPHOX[2],
        fixed="its cells are read as text, which is falsified as text",
    ),
    "json": Example("records.json", records, {"time_s": TIMES_S, **AXES}, "gyro_y_dps"),
    "arrays": Example(
        "numpy.npz",
        lambda path, columns: np.savez(path, **columns),
        {"gyro_dps": GYRO_DPS, "t": TIMES_S},
        "gyro_dps",
    ),
    "parquet": Example(
        "pandas.parquet",
        lambda path, columns: parquet.write_table(arrow_table(columns), path),
        STAMPED,
        "gyro_y_dps",
        is_even=True,
    ),
    "feather": Example(
        "pandas.feather",
        lambda path, columns: feather.write_feather(arrow_table(columns), path),
        STAMPED,
        "gyro_y_dps",
        is_even=True,
    ),
    "hdf5": Example(
        "h5py.h5",
        hdf5,
        {"imu/gyro": RADS, "imu/t": TIMES_S, "imu/gyro@units": "rad/s"},
        "imu/gyro",
    ),
    "mat": Example(
        "matlab.mat",
        matlab,
        {"imu.gyro_dps": GYRO_DPS, "imu.accel_ms2": ACCEL_MS2, "fs": RATE_HZ},
        "imu.gyro_dps",
    ),
    "ulg": Example(
        "px4.ulg",
        px4,
        {
            "timestamp": 10_000 * np.arange(N),
            "gyro_rad": RADS,
            "gyro_integral_dt": np.full(N, 10_000),
            "accelerometer_m_s2": ACCEL_MS2,
        },
        "gyro_rad",
        fixed=OF_SENSOR,
    ),
    "ardupilot": Example(
        "ardupilot.bin",
        ardupilot,
        {
            "TimeUS": 10_000 * np.arange(N),
            "I": np.zeros(N, int),
            **{f"Gyr{axis}": RADS[:, i] for i, axis in enumerate("XYZ")},
            **{f"Acc{axis}": ACCEL_MS2[:, i] for i, axis in enumerate("XYZ")},
            **{name: np.full(N, value) for name, value in IMU_REST.items()},
        },
        "GyrY",
        fixed=OF_SENSOR,
    ),
    "tdms": Example(
        "labview.tdms",
        tdms,
        {
            key: value
            for i, axis in enumerate("XYZ")
            for key, value in {
                f"IMU/Gyro {axis}": RADS[:, i],
                f"IMU/Gyro {axis}@wf_increment": 1 / RATE_HZ,
                f"IMU/Gyro {axis}@wf_start_offset": 0.0,
                f"IMU/Gyro {axis}@unit_string": "rad/s",
            }.items()
        },
        "IMU/Gyro Y",
    ),
    "mf4": Example(
        "asam.mf4",
        measurements,
        {
            "imu.t": TIMES_S,
            **{f"imu.gyro_{axis}": RADS[:, i] for i, axis in enumerate("xyz")},
            **{f"imu.gyro_{axis}@unit": "rad/s" for axis in "xyz"},
            "vehicle.t": TIMES_S[:9],
            "vehicle.speed": TIMES_S[:9],
            "vehicle.speed@unit": "m/s",
        },
        "imu.gyro_y",
        fixed="each of its groups has a clock and each channel a unit",
    ),
}
"""The example of each format that has a `reader`, by the key of the format in `FORMATS`."""


def write_libraries() -> None:
    """Write all files of binary formats."""
    for one in EXAMPLES.values():
        one.write(HERE / one.file, one.columns)
    # the layout that RoNIN's README describes
    synced = {"time": TIMES_S + 25_000.5, "gyro": RADS, "acce": ACCEL_MS2}
    synced["gyro_uncalib"] = np.add(RADS, [0.01, -0.02, 0.03])
    others = {"pose/tango_pos": np.zeros((N, 3))}
    hdf5(HERE / "ronin.h5", {f"synced/{name}": values for name, values in synced.items()} | others)
    with h5py.File(HERE / "matlab73.mat", "w", userblock_size=512, track_order=True) as file:
        file["gyro_dps"], file["t"] = GYRO_DPS.T, TIMES_S[np.newaxis]
    with (HERE / "matlab73.mat").open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + struct.pack("<HH", 0x0200, 0x4D49))
    write_mcap(HERE, RADS, ACCEL_MS2)
    np.savez(HERE / "fltea.npz", gyro_dps=GYRO_DPS, fs_hz=RATE_HZ)
    np.save(HERE / "numpy.npy", GYRO_DPS)


def made_without_libraries() -> dict[str, bytes]:
    """Return the example files that are put together from bytes or text."""
    return {**packed(), "fltea.ndjson": printed()}


if __name__ == "__main__":
    for name, data in made_without_libraries().items():
        (HERE / name).write_bytes(data)
    write_libraries()
