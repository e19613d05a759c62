#!/usr/bin/env bash
# library: icm20948 1.0.0
# expected: set_gyro_sample_rate(rate) sets the sample rate in Hz; the chip divides 1125 Hz by a whole number
#   (TDK DS-000189, register GYRO_SMPLRT_DIV). So one expects the nearest rate that there is, or to be told.
# seen: the divider is cut to a whole number, not rounded, so the rate is never below what is asked for and up to twice as
#   high: 562.5 Hz for 400, 375 for 300, 225 for 200, and 102.27 for its own default of 100. For less than 4.4 Hz the
#   number does not fit into the register's byte. Nothing returns or prints the rate that was set.
# matters: whoever takes the rate asked for as the rate of the record has N too large by √(562.5/400) = 1.19, and every
#   time constant by 1.41; polled by a computer's clock, chip and poll beat, and samples are left out or read twice.
# fltea: takes the rate from times, if the recording has them, and tells where a given rate contradicts them.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check icm20948==1.0.0

"$folder/venv/bin/python" - <<'PY'
from icm20948 import ICM20948

BANK_SELECT, GYRO_SMPLRT_DIV, WHO_AM_I, MAGNETOMETER = 0x7F, 0x00, 0x00, 0x09
INTERNAL_HZ = 1125.0


class Bus:
    """A chip that answers with its name and keeps what is written."""

    def __init__(self):
        self.bank, self.written = 0, {}

    def write_byte_data(self, address, register, value):
        if register == BANK_SELECT:
            self.bank = value >> 4
        self.written[self.bank, register] = value

    def read_byte_data(self, address, register):
        if (self.bank, register) == (0, WHO_AM_I):
            return 0xEA
        if self.bank == 0 and register == 0x3B:  # what came from the magnetometer: its name, then "reset is done"
            return MAGNETOMETER if self.written.get((3, 0x04)) == 0x01 else 0x00
        return self.written.get((self.bank, register), 0)


bus = Bus()
sensor = ICM20948(i2c_bus=bus)
rates = {}
for asked_hz in (100, 125, 200, 300, 400, 1125):
    sensor.set_gyro_sample_rate(asked_hz)
    rates[asked_hz] = INTERNAL_HZ / (1 + bus.written[2, GYRO_SMPLRT_DIV])
    print(f"asked for {asked_hz} Hz, set {rates[asked_hz]:.2f} Hz, {rates[asked_hz] / asked_hz:.3f} times as much")
assert rates[400] == 562.5 and rates[125] == 125.0 and rates[1125] == 1125.0, "no longer so"
PY
