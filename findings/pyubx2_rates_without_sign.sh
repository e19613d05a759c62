#!/usr/bin/env bash
# library: pyubx2 1.4.0
# expected: u-blox receivers with an inertial sensor send its rates in UBX-ESF-MEAS, as 24 bits with a sign, in deg/s
#   times 2^12 (u-blox interface descriptions, section "ESF measurement data"; also
#   http://docs.ros.org/en/kinetic/api/ublox_msgs/html/msg/EsfMEAS.html). So one divides the parsed dataField by 4096.
# seen: the parsed field has no sign: +0.3 deg/s is right, -0.1 deg/s comes as 4095.9. Nothing names the type or scale.
# matters: a gyroscope at rest jumps between 0 and 4096 deg/s with the sign of its noise. Who knows of two's complement
#   sees it at once; but an axis whose bias is larger than its noise is either right or a constant too large,
#   so that its noise looks right, and its bias is 4096 deg/s off.
# fltea: does not read UBX. In a table of such values a column that is mostly beyond 4000 deg/s is refused: no gyroscope
#   at rest gives that.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pyubx2==1.4.0

"$folder/venv/bin/python" - <<'PY'
import struct

from pyubx2 import GET, UBXMessage

TYPES = {"x": 14, "y": 13, "z": 5}
RATES = {"x": 0.3, "y": -0.1, "z": -0.2}
payload = struct.pack("<IHH", 1000, len(RATES) << 11, 0)
for axis, rate in RATES.items():
    payload += struct.pack("<I", (round(rate * 4096) & 0xFFFFFF) | TYPES[axis] << 24)
message = UBXMessage("ESF", "ESF-MEAS", GET, payload=payload)
parsed = {}
for k, (axis, rate) in enumerate(RATES.items(), 1):
    assert getattr(message, f"dataType_{k:02}") == TYPES[axis]
    parsed[axis] = getattr(message, f"dataField_{k:02}") / 4096
    print(f"{axis}: sent {rate:+.4f} deg/s, parsed {parsed[axis]:+.4f}")
assert abs(parsed["x"] - 0.3) < 1e-3 and abs(parsed["y"] - (4096 - 0.1)) < 1e-3, "no longer so"
PY
