#!/usr/bin/env bash
# library: allantools 2024.6
# expected: gradev is the overlapping Allan deviation that resists gaps, which are NaN in the data, of phases or of
#   frequencies; its notes prefer phases (https://allantools.readthedocs.io/en/latest/functions.html, gradev). A
#   gyroscope's rates are frequencies. So one expects one sample of 80,000 to be left out.
# seen: rates are summed to phases first, and a sum that holds a NaN stays NaN. gradev takes what came before the first
#   missing sample and says nothing; its counts alone tell. Of a record with a gap after 5 % the other 95 % are lost.
#   oadev, adev and hdev give NaN for every tau. Missing samples at the ends are cut off and do no harm.
# matters: recordings of hours have gaps, and long taus are what they are made for: the deviation at 100 s, where a bias
#   drifts, comes from a twentieth of the record, or from chance.
# fltea: numbers the samples around what is missing, and takes the record on both sides of it.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check allantools==2024.6 numpy==2.4.6

"$folder/venv/bin/python" - <<'PY'
import contextlib
import io

import allantools
import numpy as np

RATE_HZ, N = 100.0, 80_000
rng = np.random.default_rng(3)
rates = rng.normal(0, 0.1, N) + np.cumsum(rng.normal(0, 3e-4, N))
gap = rates.copy()
gap[N // 20] = np.nan


def deviations(of, data, **options):
    with contextlib.redirect_stdout(io.StringIO()):  # it prints its preference at each call
        return of(data, rate=RATE_HZ, taus=[1, 10], **{"data_type": "freq", **options})


taus, whole, _, counts = deviations(allantools.gradev, rates)
_, rest, _, few = deviations(allantools.gradev, gap)
_, before, _, _ = deviations(allantools.gradev, rates[: N // 20])
_, overlapping, _, _ = deviations(allantools.oadev, gap)
for k, tau in enumerate(taus):
    print(f"tau {tau:g} s: whole {whole[k]:.5f} of {counts[k]:.0f}, one missing {rest[k]:.5f} of {few[k]:.0f}, "
          f"the first twentieth {before[k]:.5f}; oadev {overlapping[k]:g}")
assert np.allclose(rest, before, rtol=1e-6) and few[0] < counts[0] / 19 and np.isnan(overlapping).all(), "no longer so"
PY
