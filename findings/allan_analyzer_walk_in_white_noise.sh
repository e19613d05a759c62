#!/usr/bin/env bash
# library: allan-variance-analyzer 1.0.4
# expected: the tool finds noise density and random walk of a gyroscope by the Allan deviation and writes them as Kalibr's
#   imu.yaml (https://pypi.org/project/allan-variance-analyzer/). The random walk is where a line of slope +1/2 fits,
#   which takes a part of the curve that rises (IEEE Std 952-1997, annex C). White noise has none: one expects 0, or no
#   figure.
# seen: the line of slope +1/2 is laid through the whole curve, whatever its slope. White noise gives a random walk in
#   proportion to its density, and the figure depends on the longest averaging time that is asked for: 4.6 times as much
#   up to 200 s as up to 1,000 s of the same record.
# matters: the figure looks like one of a data sheet, and a filter that believes it lets the bias wander: of a gyroscope
#   with 0.3 deg/√h and no drift, by 5.6 deg/h after an hour. It is also the figure
#   that a sensor with a true walk below it gets.
# fltea: gives a random walk only where the spectrum shows one, else null; in an imu.yaml by --imu-yaml a figure that the
#   recording does not show is a comment with the reason.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check allan-variance-analyzer==1.0.4 numpy==2.4.6 scipy==1.17.1

cd "$folder"
printf 'imu_rate: 100\nmeasure_rate: 100\n' >rate.yaml
MPLBACKEND=Agg HOME="$folder" venv/bin/python - 2>log <<'PY' || { cat log >&2; exit 1; }
import contextlib
import io
from pathlib import Path

import numpy as np
import yaml
from allan_variance_analyzer import AllanVarianceAnalyzer

RATE_HZ, HOURS = 100, 3
walks = {}
for density_deg, longest_s in ((0.005, 1000), (0.010, 1000), (0.005, 200)):
    density = np.deg2rad(density_deg)
    white = np.random.default_rng(1).normal(0, density * RATE_HZ**0.5, (RATE_HZ * 3600 * HOURS, 6))
    with contextlib.redirect_stdout(io.StringIO()):
        AllanVarianceAnalyzer("rate.yaml", ".", period_max=longest_s)(white)
    found = yaml.safe_load(Path("imu.yaml").read_text())
    walk = walks[density_deg, longest_s] = found["gyroscope_random_walk"]
    hour = np.rad2deg(walk * 3600**0.5) * 3600
    print(f"white, {density:.2e} rad/s/√Hz, up to {longest_s} s: density {found['gyroscope_noise_density']:.2e}, "
          f"walk {walk:.2e} rad/s²/√Hz: {hour:.1f} deg/h after an hour")
first, twice, short = walks.values()
assert first > 0 and 1.8 < twice / first < 2.2 and short / first > 2, "no longer so"
PY
