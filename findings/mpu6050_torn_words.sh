#!/usr/bin/env bash
# library: mpu6050-raspberrypi 1.2
# expected: the chip's registers hold still during one burst read; who reads byte by byte has to make sure by the data
#   ready interrupt that the bytes are of one sample (InvenSense RM-MPU-6000A rev. 4.2, section 4.19). So one expects
#   the driver to read a number of two bytes in one transfer.
# seen: it reads the high byte and the low byte in two transfers, with no look at the interrupt. At 100 kHz a transfer
#   takes 0.4 ms, so at 1,000 samples a second two in five numbers have bytes of two samples. That matters where the high
#   byte changes: around 0, which is where a good gyroscope rests, between 0 and -1. Jumps of ±256 LSB come out, ±1.95 deg/s.
# matters: noise of 0.05 deg/s becomes one of 0.86 deg/s, white to the eye: N is 17 times too large. A larger bias hides it,
#   so of two equal sensors one seems to be bad.
# fltea: reads all axes in one burst, and finds such jumps of 256 LSB in recordings of others ("torn reads").
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check mpu6050-raspberrypi==1.2 numpy==2.4.6

# In the place of a bus: a chip that measures 1,000 times a second, whatever is read of it.
cat >"$folder/smbus.py" <<'PY'
import numpy as np

TRANSFER_S, SAMPLE_S, FIRST = 0.4e-3, 1e-3, 0x43  # GYRO_XOUT_H
BIAS_LSB = 0.0
SIGMA_LSB = 0.05 * 131


class SMBus:
    def __init__(self, bus):
        self._now_s, self._rng, self._sample, self._counts = 0.0, np.random.default_rng(1), -1, [0, 0, 0]

    def write_byte_data(self, address, register, value):
        self._now_s += TRANSFER_S

    def read_byte_data(self, address, register):
        self._now_s += TRANSFER_S
        while self._sample < int(self._now_s / SAMPLE_S):
            self._sample += 1
            self._counts = np.rint(self._rng.normal(BIAS_LSB, SIGMA_LSB, 3)).astype(int).tolist()
        word = self._counts[(register - FIRST) // 2] & 0xFFFF if register >= FIRST else 0
        return word >> 8 if (register - FIRST) % 2 == 0 else word & 0xFF
PY

PYTHONPATH="$folder" "$folder/venv/bin/python" - <<'PY'
import numpy as np
import smbus
from mpu6050 import mpu6050

found = {}
for bias_lsb in (0.0, 100.0):
    smbus.BIAS_LSB = bias_lsb
    sensor = mpu6050(0x68)
    rates = np.array([sensor.get_gyro_data()["x"] for _ in range(20_000)])
    found[bias_lsb] = rates.std()
    jumps = np.mean(np.abs(rates - bias_lsb / 131) > 1)
    print(f"bias {bias_lsb / 131:.2f} deg/s, noise 0.05: read {found[bias_lsb]:.3f} deg/s, {jumps:.1%} are off by 256 LSB")
assert found[0.0] > 10 * found[100.0] and abs(found[100.0] - 0.05) < 0.005, "no longer so"
PY
