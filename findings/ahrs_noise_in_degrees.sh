#!/usr/bin/env bash
# library: AHRS 0.4.0
# expected: ahrs.Sensors simulates gyroscopes in rad/s unless in_degrees is set, and gyr_noise is the standard deviation
#   of their noise, scaled to the unit of the data (https://ahrs.readthedocs.io/en/latest/sensors.html). So one expects
#   that gyr_noise=0.01 with data in rad/s gives noise of 0.01 rad/s.
# seen: gyr_noise is in deg/s whatever the data are in: the noise is 0.000175 rad/s, 57 times less. Without gyr_noise
#   each axis has noise of its own chance size, of several deg/s, in data that one takes for ideal.
# matters: simulated records of known noise are what estimators are tried on: one that is right seems to be wrong by
#   57.3, and one that takes the unit wrongly, too, seems to be right.
# fltea: names the unit of every parameter of a simulation, and asks for the unit of every array.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check AHRS==0.4.0 numpy==2.4.6

"$folder/venv/bin/python" - <<'PY'
import numpy as np
from ahrs import QuaternionArray, Sensors

still = QuaternionArray(np.tile([1.0, 0.0, 0.0, 0.0], (20_000, 1)))


def noise_of(**options):
    sensors = Sensors(quaternions=still, freq=200.0, rng=np.random.default_rng(1), **options)
    return np.asarray(sensors.gyroscopes).std(axis=0)


radians, degrees = noise_of(gyr_noise=0.01), noise_of(gyr_noise=0.01, in_degrees=True)
unasked = np.rad2deg(noise_of())
print("gyr_noise=0.01, data in rad/s:", radians.round(6), "rad/s")
print("gyr_noise=0.01, data in deg/s:", degrees.round(6), "deg/s")
print("gyr_noise not given:          ", unasked.round(2), "deg/s")
assert np.allclose(radians, np.deg2rad(0.01), rtol=0.05) and np.allclose(degrees, 0.01, rtol=0.05), "no longer so"
assert unasked.max() > 1, "no longer so"
PY
