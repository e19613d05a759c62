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
import re
import struct
import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import asammdf
import h5py
import nptdms
import numpy as np
import openpyxl
import pyarrow as pa
import scipy.io
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.writer import Writer
from pyarrow import feather, parquet

HERE = Path(__file__).parents[1] / "recording/corpus"
N, RATE_HZ = 60, 100.0
TIMES_S = np.arange(N) / RATE_HZ
_random = np.random.default_rng(20231114)
GYRO_DPS = np.round(0.2 * _random.normal(size=(N, 3)) + [0.5, -0.3, 0.1], 3)
"""The angular rates [deg/s] that every file contains; each logger rounds them to its own precision."""
ACCEL_MS2 = np.round(0.02 * _random.normal(size=(N, 3)) + [0.1, -0.2, 9.81], 3)
RADS = np.radians(GYRO_DPS)

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


def ulog(forms: dict[str, str], topics: Iterable[tuple[str, int]], rows: Iterable[tuple[Any, ...]]) -> bytes:
    """Return a log of PX4, as docs.px4.io describes it ("ULog File Format").

    The log has header, flag bits, formats, subscriptions and data.

    `forms`: fields by message name. `topics`: message name and sensor number. `rows`: topic index, field
    types as letters of `struct`, and values.
    """

    def message(kind: str, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), ord(kind)) + body

    out = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0) + message("B", bytes(40))
    for name, form in forms.items():
        out += message("F", f"{name}:uint64_t timestamp;{form}".encode())
    for place, (name, number) in enumerate(topics):
        out += message("A", struct.pack("<BH", number, place) + name.encode())
    return out + b"".join(message("D", struct.pack(f"<HQ{code}", place, *row)) for place, code, *row in rows)


def px4() -> bytes:
    form = "float[3] gyro_rad;uint32_t gyro_integral_dt;float[3] accelerometer_m_s2;"
    rows = ((0, "3fI3f", 10_000 * k, *RADS[k], 10_000, *ACCEL_MS2[k]) for k in range(N))
    return ulog({"sensor_combined": form}, [("sensor_combined", 0)], rows)


IMU_FORM = "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"
DATAFLASH_LETTERS = {"a": "32h", "n": "4s", "N": "16s", "Z": "64s", "M": "B", "c": "h", "C": "H", "L": "i"}


def dataflash(forms: dict[str, tuple[str, str]], rows: Iterable[tuple[Any, ...]]) -> bytes:
    """Return a log of ArduPilot.

    `forms`: format and columns by message name. `rows`: values of each message, of which the first is the
    message name.
    """
    kinds = {"FMT": (0x80, "BBnNZ", "Type,Length,Name,Format,Columns")}
    kinds |= {name: (0x81 + k, *form) for k, (name, form) in enumerate(forms.items())}
    codes = {
        name: struct.Struct("<" + "".join(DATAFLASH_LETTERS.get(letter, letter) for letter in form))
        for name, (_, form, _) in kinds.items()
    }

    def message(name: str, *values: Any) -> bytes:
        return b"\xa3\x95" + bytes([kinds[name][0]]) + codes[name].pack(*values)

    heads = [
        message("FMT", kind, codes[name].size + 3, name.encode(), form.encode(), columns.encode())
        for name, (kind, form, columns) in kinds.items()
    ]
    return b"".join(heads) + b"".join(message(*row) for row in rows)


def ardupilot() -> bytes:
    rows = (("IMU", 10_000 * k, 0, *RADS[k], *ACCEL_MS2[k], 0, 0, 25.0, 1, 1, 1000, 1000) for k in range(N))
    return dataflash({"IMU": IMU_FORM}, rows)


def write_measurements() -> None:
    """Write files in measurement formats: TDMS of LabVIEW, and MDF, which is usual in vehicles."""
    with nptdms.TdmsWriter(HERE / "labview.tdms") as out:
        properties = {"wf_increment": 1 / RATE_HZ, "wf_start_offset": 0.0, "unit_string": "rad/s"}
        out.write_segment(
            [
                nptdms.ChannelObject("IMU", f"Gyro {axis}", RADS[:, i], properties)
                for i, axis in enumerate("XYZ")
            ]
        )
    with asammdf.MDF(version="4.10") as file:
        file.start_time = datetime.datetime(2023, 11, 14, tzinfo=datetime.UTC)
        file.append(
            [
                asammdf.Signal(RADS[:, i], TIMES_S, unit="rad/s", name=f"gyro_{axis}")
                for i, axis in enumerate("xyz")
            ],
            acq_name="imu",
        )
        file.append([asammdf.Signal(TIMES_S[:9], TIMES_S[:9], unit="m/s", name="speed")], acq_name="vehicle")
        file.save(HERE / "asam.mf4", overwrite=True)
    data = bytearray((HERE / "asam.mf4").read_bytes())
    written = data.index(b"##FH") + 40
    data[written : written + 8] = bytes(8)
    (HERE / "asam.mf4").write_bytes(data)


def write_mcap() -> None:
    """Write MCAP files in Foxglove's encodings, JSON and protobuf, with the format's own library."""
    pool, field = descriptor_pb2.FileDescriptorSet(), descriptor_pb2.FieldDescriptorProto
    file = pool.file.add(name="imu.proto", package="robot", syntax="proto3")
    vector = file.message_type.add(name="Vector3")
    for number, axis in enumerate("xyz", 1):
        vector.field.add(name=axis, number=number, type=field.TYPE_DOUBLE, label=field.LABEL_OPTIONAL)
    imu = file.message_type.add(name="Imu")
    imu.field.add(name="timestamp_us", number=1, type=field.TYPE_UINT64, label=field.LABEL_OPTIONAL)
    for number, name in ((2, "angular_velocity"), (3, "linear_acceleration")):
        imu.field.add(
            name=name,
            number=number,
            type=field.TYPE_MESSAGE,
            label=field.LABEL_OPTIONAL,
            type_name=".robot.Vector3",
        )
    known = descriptor_pool.DescriptorPool()
    known.Add(file)
    message = message_factory.GetMessageClass(known.FindMessageTypeByName("robot.Imu"))
    schema = json.dumps({"type": "object", "properties": {"angular_velocity": {"type": "object"}}}).encode()
    for encoding, schema_encoding, text in (
        ("json", "jsonschema", schema),
        ("protobuf", "protobuf", pool.SerializeToString()),
    ):
        with (HERE / f"{encoding}.mcap").open("wb") as out:
            writer = Writer(out)
            writer.start()
            channel = writer.register_channel(
                "/imu", encoding, writer.register_schema("robot.Imu", schema_encoding, text)
            )
            for k in range(N):
                gyro, accel = (
                    dict(zip("xyz", values[k].tolist(), strict=True)) for values in (RADS, ACCEL_MS2)
                )
                content = {"angular_velocity": gyro, "linear_acceleration": accel}
                if encoding == "json":
                    data = json.dumps(
                        {"stamp": {"sec": 1_700_000_000, "nsec": 10_000_000 * k}, **content}
                    ).encode()
                else:
                    data = message(timestamp_us=10_000 * k, **content).SerializeToString()
                writer.add_message(channel, 1_700_000_000_000_000_000 + 10_000_000 * k, data, 0)
            writer.finish()


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


def write_libraries() -> None:
    """Write all files of binary formats."""
    axes = {f"gyro_{axis}_dps": GYRO_DPS[:, i] for i, axis in enumerate("xyz")}
    stamps = {"when": pa.array([10_000_000 * k for k in range(N)], pa.timestamp("ns"))}
    parquet.write_table(pa.table({**stamps, **axes}), HERE / "pandas.parquet")
    feather.write_feather(pa.table({**stamps, **axes}), HERE / "pandas.feather")
    with h5py.File(HERE / "h5py.h5", "w", track_order=True) as file:
        file["imu/gyro"], file["imu/t"] = RADS, TIMES_S
        file["imu/gyro"].attrs["units"] = "rad/s"
    # the layout that RoNIN's README describes
    with h5py.File(HERE / "ronin.h5", "w", track_order=True) as file:
        file["synced/time"], file["synced/gyro"], file["synced/acce"] = TIMES_S + 25_000.5, RADS, ACCEL_MS2
        file["synced/gyro_uncalib"] = np.add(RADS, [0.01, -0.02, 0.03])
        file["pose/tango_pos"] = np.zeros((N, 3))
    scipy.io.savemat(
        HERE / "matlab.mat", {"imu": {"gyro_dps": GYRO_DPS, "accel_ms2": ACCEL_MS2}, "fs": RATE_HZ}
    )
    with (HERE / "matlab.mat").open("r+b") as raw:
        raw.write(
            b"MATLAB 5.0 MAT-file Platform: posix".ljust(116)
        )  # The time of writing is left out, so that the file is always the same.
    with h5py.File(HERE / "matlab73.mat", "w", userblock_size=512, track_order=True) as file:
        file["gyro_dps"], file["t"] = GYRO_DPS.T, TIMES_S[np.newaxis]
    with (HERE / "matlab73.mat").open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + struct.pack("<HH", 0x0200, 0x4D49))
    write_mcap()
    write_measurements()
    np.savez(HERE / "numpy.npz", gyro_dps=GYRO_DPS, t=TIMES_S)
    np.savez(HERE / "fltea.npz", gyro_dps=GYRO_DPS, fs_hz=RATE_HZ)
    np.save(HERE / "numpy.npy", GYRO_DPS)
    book = openpyxl.Workbook()
    sheet = book.active
    sheet.title = "Raw Data"
    sheet.append(next(csv.reader([text("phyphox.csv").decode().splitlines()[0]])))
    for k in range(N):
        sheet.append([TIMES_S[k], *RADS[k], float(np.linalg.norm(RADS[k]))])
    book.create_sheet("Metadata Device").append(["property", "value"])
    saved = io.BytesIO()
    book.save(saved)
    (HERE / "phyphox.xlsx").write_bytes(timeless(saved))


def made_without_libraries() -> dict[str, bytes]:
    """Return the example files that are put together from bytes or text."""
    return {**packed(), "px4.ulg": px4(), "ardupilot.bin": ardupilot(), "fltea.ndjson": printed()}


if __name__ == "__main__":
    for name, data in made_without_libraries().items():
        (HERE / name).write_bytes(data)
    write_libraries()
