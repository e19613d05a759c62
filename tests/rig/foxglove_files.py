"""Writes bags as Foxglove's programs do: MCAP with messages of JSON and protobuf."""

import json
from pathlib import Path

from fltea.recording.sample_times import Floats
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.writer import Writer


def write_mcap(folder: Path, rads: Floats, accel_ms2: Floats) -> None:
    """Write MCAP files in Foxglove's encodings, JSON and protobuf, with the format's own library.

    `rads`, `accel_ms2`: (n, 3) samples at 100 Hz.
    """
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
        with (folder / f"{encoding}.mcap").open("wb") as out:
            writer = Writer(out)
            writer.start()
            channel = writer.register_channel(
                "/imu", encoding, writer.register_schema("robot.Imu", schema_encoding, text)
            )
            for k in range(len(rads)):
                gyro, accel = (
                    dict(zip("xyz", values[k].tolist(), strict=True)) for values in (rads, accel_ms2)
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
