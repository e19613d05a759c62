"""Makes the files of tests/recording/corpus: one rest of 60 samples at 100 Hz, as each logger writes it.

Files of binary kinds are written by the libraries of their programs. Text is typed after what the loggers
print; where that is said stands before each. Run it by `.venv/bin/python` in the clone.
"""

import bz2
import gzip
import io
import json
import lzma
import struct
import zipfile
from datetime import UTC, datetime, timedelta
from pathlib import Path

import h5py
import numpy as np
import openpyxl
import pyarrow as pa
import scipy.io
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.writer import Writer
from pyarrow import feather, parquet

HERE = Path(__file__).parents[1] / "recording/corpus"
N, RATE_HZ = 60, 100.0
BEGIN = datetime(2023, 11, 14, 22, 13, 20, tzinfo=UTC)
TIMES_S = np.arange(N) / RATE_HZ
_random = np.random.default_rng(20231114)
GYRO_DPS = np.round(0.2 * _random.normal(size=(N, 3)) + [0.5, -0.3, 0.1], 3)
"""What every file says, as precisely as its logger does."""
ACCEL_MS2 = np.round(0.02 * _random.normal(size=(N, 3)) + [0.1, -0.2, 9.81], 3)
RADS = np.radians(GYRO_DPS)
STAMPS = [BEGIN + timedelta(milliseconds=10 * k) for k in range(N)]
CLOCK = [f"{stamp:%H:%M:%S}.{stamp.microsecond // 1000:03}" for stamp in STAMPS]


def rows(line, head: str = "") -> bytes:
    """A head, and a line for each sample."""
    return (head + "".join(line(k) for k in range(N))).encode()


def numbers(values, form: str = ".5f", between: str = ",") -> str:
    return between.join(format(value, form) for value in values)


def with_commas(k: int) -> str:
    return numbers(GYRO_DPS[k], ".3f", ";").replace(".", ",")


OURS = "time_s,gyro_x_dps,gyro_y_dps,gyro_z_dps\n"
PLAIN = rows(lambda k: f"{TIMES_S[k]:.2f},{numbers(GYRO_DPS[k], '.3f')}\n", OURS)
PHYPHOX = [
    "Time (s)",
    "Gyroscope x (rad/s)",
    "Gyroscope y (rad/s)",
    "Gyroscope z (rad/s)",
    "Absolute (rad/s)",
]

TEXTS: dict[str, bytes] = {
    # Arduino's serial plotter: docs.arduino.cc, "Using the Serial Plotter Tool": label:value, commas between
    "plotter.txt": rows(lambda k: "gx:{:.3f},gy:{:.3f},gz:{:.3f}\r\n".format(*GYRO_DPS[k])),
    # Arduino's serial monitor with time stamps switched on: "22:13:20.000 -> "
    "arduino_monitor.txt": rows(
        lambda k: f"{CLOCK[k]} -> {numbers(GYRO_DPS[k], '.3f')}\n", f"{CLOCK[0]} -> gx,gy,gz\n"
    ),
    # Adafruit_MPU6050, examples/basic_readings: three lines a reading
    "adafruit_mpu6050.txt": rows(
        lambda k: (
            "Acceleration X: {:.2f}, Y: {:.2f}, Z: {:.2f} m/s^2\n".format(*ACCEL_MS2[k])
            + "Rotation X: {:.5f}, Y: {:.5f}, Z: {:.5f} rad/s\nTemperature: 36.53 degC\n\n".format(*RADS[k])
        ),
        "Adafruit MPU6050 test!\nMPU6050 Found!\nGyro range set to: +- 500 deg/s\n\n",
    ),
    # Adafruit_LSM6DS, examples/adafruit_lsm6dsox_test
    "adafruit_lsm6ds.txt": rows(
        lambda k: (
            "\t\tTemperature 24.51 deg C\n\t\tAccel X: {:.2f} \tY: {:.2f} \tZ: {:.2f} m/s^2 \n".format(
                *ACCEL_MS2[k]
            )
            + "\t\tGyro X: {:.5f} \tY: {:.5f} \tZ: {:.5f} radians/s \n\n".format(*RADS[k])
        )
    ),
    # SparkFun_ICM-20948, examples/Example1_Basics: printScaledAGMT
    "sparkfun_icm20948.txt": rows(
        lambda k: (
            "Scaled. Acc (mg) [ {:08.2f}, {:08.2f}, {:08.2f} ]".format(*(ACCEL_MS2[k] / 9.80665e-3))
            + ", Gyr (DPS) [ {:09.3f}, {:09.3f}, {:09.3f} ]".format(*GYRO_DPS[k])
            + ", Mag (uT) [ 00012.30, -00004.50, 00040.10 ], Tmp (C) [ 00025.55 ]\n"
        )
    ),
    # Adafruit_BNO055, examples/read_all_data: a line a quantity, of which some are no gyroscope
    "bno055.txt": rows(
        lambda k: (
            "Orient:\tx= 359.94 |\ty= 0.06 |\tz= -0.13\n"
            + "Gyro:\tx= {:.5f} |\ty= {:.5f} |\tz= {:.5f}\n".format(*RADS[k])
            + "Linear:\tx= 0.01 |\ty= 0.02 |\tz= 0.00\nCalibration: Sys=0 Gyro=3 Accel=0 Mag=0\n--\n"
        )
    ),
    # i2cdevlib, MPU6050_raw: a label, accelerometer and gyroscope in counts
    "i2cdevlib_raw.txt": rows(
        lambda k: (
            "a/g:\t"
            + numbers(np.rint([*(ACCEL_MS2[k] / 9.80665 * 16384), *(GYRO_DPS[k] * 131)]), ".0f", "\t")
            + "\n"
        )
    ),
    # phyphox, export as CSV (Comma, decimal point): phyphox.org/wiki
    "phyphox.csv": rows(
        lambda k: f"{TIMES_S[k]:.9E},{numbers([*RADS[k], np.linalg.norm(RADS[k])], '.9E')}\n",
        ",".join(f'"{name}"' for name in PHYPHOX) + "\n",
    ),
    # Sensor Logger (phones), Gyroscope.csv of its archive: github.com/tszheichoi/awesome-sensor-logger
    "Gyroscope.csv": rows(
        lambda k: (
            f"{1_700_000_000_000_000_000 + k * 10_000_000},{TIMES_S[k]:.4f},{numbers(RADS[k][::-1], '.6f')}\n"
        ),
        "time,seconds_elapsed,z,y,x\n",
    ),
    "sensor_logger.json": json.dumps(
        [{"sensor": "Metadata", "version": "3", "device name": "phone"}]
        + [
            {
                "sensor": sensor,
                "time": str(1_700_000_000_000_000_000 + k * 10_000_000),
                "seconds_elapsed": f"{TIMES_S[k]:.4f}",
                **{axis: f"{v:.6f}" for axis, v in zip("xyz", values[k], strict=True)},
            }
            for k in range(N)
            for sensor, values in (("Accelerometer", ACCEL_MS2), ("Gyroscope", RADS))
        ]
    ).encode(),
    # Excel of a country with decimal commas; it shows whole seconds unless a format is set for the column
    "excel_dates.csv": rows(
        lambda k: f"{STAMPS[k]:%d.%m.%Y %H:%M:%S},{STAMPS[k].microsecond // 1000:03};{with_commas(k)}\r\n",
        "Zeit;gx [deg/s];gy [deg/s];gz [deg/s]\r\n",
    ),
    "excel_seconds.csv": rows(
        lambda k: f"{STAMPS[k]:%d.%m.%Y %H:%M:%S};{with_commas(k)}\r\n",
        "Zeit;gx [deg/s];gy [deg/s];gz [deg/s]\r\n",
    ),
    "excel_unicode.txt": rows(
        lambda k: f"{TIMES_S[k]:.2f}\t{numbers(GYRO_DPS[k], '.3f', chr(9))}\r\n", OURS.replace(",", "\t")
    )
    .decode()
    .encode("utf-16"),
    "iso_dates.csv": rows(
        lambda k: f"{STAMPS[k]:%Y-%m-%dT%H:%M:%S.%f}Z,{numbers(GYRO_DPS[k], '.3f')}\n",
        "timestamp," + OURS[7:],
    ),
    "us_dates.csv": rows(
        lambda k: f"{STAMPS[k]:%m/%d/%Y %I:%M:%S.%f %p},{numbers(GYRO_DPS[k], '.3f')}\n",
        "timestamp," + OURS[7:],
    ),
    # pandas.json_normalize of messages of sensor_msgs/Imu
    "ros_sec_nanosec.csv": rows(
        lambda k: f"{1_700_000_000 + k // 100},{k % 100 * 10_000_000},{numbers(RADS[k], '.6f')}\n",
        "header.stamp.sec,header.stamp.nanosec,angular_velocity.x,angular_velocity.y,angular_velocity.z\n",
    ),
    # blackbox_decode of Betaflight: names with blanks behind the commas, times in µs
    "betaflight.csv": rows(
        lambda k: f"{k}, {k * 10_000}, 3, {numbers(GYRO_DPS[k], '.3f', ', ')}, 12, 8, 2050\n",
        "loopIteration, time (us), axisP[0], gyroADC[0], gyroADC[1], gyroADC[2], "
        "accSmooth[0], accSmooth[1], accSmooth[2]\n",
    ),
    # an ESP32 that prints objects of JSON
    "esp32.txt": rows(
        lambda k: (
            json.dumps({"ms": 10 * k, "gyro": dict(zip("xyz", GYRO_DPS[k].tolist(), strict=True))}) + "\n"
        )
    ),
    "no_header.csv": rows(lambda k: f"{10 * k},{numbers(GYRO_DPS[k], '.3f')}\n"),
    "other_names.csv": rows(
        lambda k: f"{10 * k},{numbers(GYRO_DPS[k], '.3f')}\n", "counter,roll,pitch,yaw\n"
    ),
    "coarse_clock.csv": rows(lambda k: f"{k // 8},{numbers(GYRO_DPS[k], '.3f')}\n", "time_ms," + OURS[7:]),
    "betaflight.bbl": b"H Product:Blackbox flight data recorder by Nicholas Sherlock\nH Data version:2\n"
    + bytes(64),
    "ardupilot.bin": b"\xa3\x95\x80\x80\x59FMT\0" + bytes(64),
    "old_excel.xls": bytes.fromhex("d0cf11e0a1b11ae1") + bytes(64),
}


def archive(files: dict[str, bytes]) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, data in files.items():
            packed.writestr(zipfile.ZipInfo(name), data)
    return out.getvalue()


PACKED = {
    "plain.csv": PLAIN,
    "plain.csv.gz": gzip.compress(PLAIN, mtime=0),
    "plain.csv.bz2": bz2.compress(PLAIN),
    "plain.csv.xz": lzma.compress(PLAIN),
    "phyphox.zip": archive({"Raw Data.csv": TEXTS["phyphox.csv"], "meta/device.csv": b"property,value\n"}),
    "sensor_logger.zip": archive(
        {
            "Accelerometer.csv": b"time,seconds_elapsed,z,y,x\n",
            "Gyroscope.csv": TEXTS["Gyroscope.csv"],
            "Metadata.csv": b"version\n3\n",
        }
    ),
}


def ulog() -> bytes:
    """A log of PX4: docs.px4.io, "ULog File Format": head, flag bits, a format, a subscription, data."""

    def message(kind: str, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), ord(kind)) + body

    form = b"sensor_combined:uint64_t timestamp;float[3] gyro_rad;uint32_t gyro_integral_dt;"
    form += b"float[3] accelerometer_m_s2;"
    out = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0) + message("B", bytes(40)) + message("F", form)
    out += message("A", struct.pack("<BH", 0, 0) + b"sensor_combined")
    for k in range(N):
        out += message("D", struct.pack("<HQ3fI3f", 0, 10_000 * k, *RADS[k], 10_000, *ACCEL_MS2[k]))
    return out


def write_mcap() -> None:
    """Foxglove's own encodings: the library of the format, with a schema of JSON and one of protobuf."""
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


def write_libraries() -> None:
    """The files of binary kinds."""
    axes = {f"gyro_{axis}_dps": GYRO_DPS[:, i] for i, axis in enumerate("xyz")}
    stamps = {"when": pa.array([10_000_000 * k for k in range(N)], pa.timestamp("ns"))}
    parquet.write_table(pa.table({**stamps, **axes}), HERE / "pandas.parquet")
    feather.write_feather(pa.table({**stamps, **axes}), HERE / "pandas.feather")
    with h5py.File(HERE / "h5py.h5", "w", track_order=True) as file:
        file["imu/gyro"], file["imu/t"] = RADS, TIMES_S
        file["imu/gyro"].attrs["units"] = "rad/s"
    scipy.io.savemat(
        HERE / "matlab.mat", {"imu": {"gyro_dps": GYRO_DPS, "accel_ms2": ACCEL_MS2}, "fs": RATE_HZ}
    )
    with h5py.File(HERE / "matlab73.mat", "w", userblock_size=512, track_order=True) as file:
        file["gyro_dps"], file["t"] = GYRO_DPS.T, TIMES_S[np.newaxis]
    with (HERE / "matlab73.mat").open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + struct.pack("<HH", 0x0200, 0x4D49))
    write_mcap()
    np.savez(HERE / "numpy.npz", gyro_dps=GYRO_DPS, t=TIMES_S)
    book = openpyxl.Workbook()
    sheet = book.active
    sheet.title = "Raw Data"
    sheet.append(PHYPHOX)
    for k in range(N):
        sheet.append([TIMES_S[k], *RADS[k], float(np.linalg.norm(RADS[k]))])
    book.create_sheet("Metadata Device").append(["property", "value"])
    book.save(HERE / "phyphox.xlsx")


if __name__ == "__main__":
    for name, data in {**TEXTS, **PACKED, "px4.ulg": ulog()}.items():
        (HERE / name).write_bytes(data)
    write_libraries()
