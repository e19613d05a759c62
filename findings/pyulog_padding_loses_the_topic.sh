#!/usr/bin/env bash
# library: pyulog 1.3.0, numpy 2.1.3
# expected: a format of ULog may end in a field called `_padding0`, and whether a logger writes that last field is left
#   to it (https://docs.px4.io/main/en/dev_log/ulog_file_format.html, section "F: Format Message"): both are read.
# seen: of the log that holds the padding all messages of the topic are left out, and the topic is not listed. The
#   flag `file_corruption` is set; nothing is raised or printed.
# matters: a log of a gyroscope by another logger than PX4's own looks empty, or damaged, though each of its bytes is
#   as documented. Where both kinds of messages stand in one log, the record has a hole and no word of it.
# fltea: goes through the messages of a log itself before pyulog reads them, and hands them over without padding.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pyulog==1.3.0 numpy==2.1.3

"$folder/venv/bin/python" - <<'PY'
import io
import struct

from pyulog import ULog

FORMAT = b"sensor_gyro:uint64_t timestamp;float x;float y;float z;uint8_t[4] _padding0;"


def message(kind: bytes, body: bytes) -> bytes:
    return struct.pack("<H", len(body)) + kind + body


def log(padding: bytes) -> ULog:
    data = bytes.fromhex("554c6f67011235") + b"\x01" + bytes(8)
    data += message(b"B", bytes(40)) + message(b"F", FORMAT)
    data += message(b"A", struct.pack("<BH", 0, 0) + b"sensor_gyro")
    for k in range(1000):
        data += message(b"D", struct.pack("<HQ3f", 0, 5000 * k, 0.01, 0.02, 0.03) + padding)
    return ULog(io.BytesIO(data))


read = {}
for name, padding in (("without", b""), ("with", bytes(4))):
    found = log(padding)
    read[name] = sum(len(one.data["timestamp"]) for one in found.data_list)
    print(f"{name} its padding: {read[name]} of 1000 messages, file_corruption = {found.file_corruption}")
assert read == {"without": 1000, "with": 0}, "no longer so"
PY
