#!/usr/bin/env bash
# library: vqf 2.1.2
# expected: the filter estimates the bias of a gyroscope at rest and during motion. Its parameter biasClip, 2 °/s
#   unless given, limits the estimate, and tells rest from a slow, even turn
#   (https://vqf.readthedocs.io/en/latest/ref_cpp_params.html). So one expects 2.0 for a bias of 2.1.
# seen: up to 2 °/s the bias is found to a thousandth; at 2.1 °/s nothing of it is. Rest is not detected, the estimate
#   of the vertical axis stays 0, and the heading turns by all 2.1 °/s, 126 ° in a minute.
# matters: data sheets of MEMS gyroscopes allow ±5 to ±20 °/s at zero rate, so whether the filter works at all depends
#   on the single sensor. One that is warm may pass the limit in use.
# fltea: gives the bias of a record at rest whatever its size, with its σ, and tells what is left of it after an hour;
#   who subtracts that first, as the option `--corrected` does, stays within the filter's limit.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check vqf==2.1.2 numpy==2.4.6

"$folder/venv/bin/python" - <<'PY'
import numpy as np
from vqf import VQF

RATE_HZ, SECONDS = 100, 60
estimates = {}
for bias_dps in (1.0, 1.9, 2.1, 5.0):
    rng = np.random.default_rng(1)
    n = RATE_HZ * SECONDS
    gyro = np.deg2rad(rng.normal([0, 0, bias_dps], 0.05, (n, 3)))
    accel = rng.normal([0, 0, 9.81], 0.01, (n, 3))
    found = VQF(1 / RATE_HZ).updateBatch(gyro, accel)
    w, z = found["quat6D"][:, 0], found["quat6D"][:, 3]
    turned_deg = np.rad2deg(np.unwrap(2 * np.arctan2(z, w)))[-1]
    estimates[bias_dps] = np.rad2deg(found["bias"][-1, 2])
    rest = bool(found["restDetected"][-1])
    print(f"bias {bias_dps} deg/s: estimate {estimates[bias_dps]:.3f}, rest {rest}, heading {turned_deg:.1f} deg")
assert abs(estimates[1.9] - 1.9) < 0.01 and abs(estimates[2.1]) < 0.01, "no longer so"
PY
