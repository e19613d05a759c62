#!/usr/bin/env bash
# library: mne 1.13.2, pyEDFlib 0.1.42
# expected: EDF keeps for every channel its own rate and its physical dimension (https://www.edfplus.info/specs/edf.html,
#   header), so wearables write gyroscopes in deg/s beside an EEG or ECG. mne.io.read_raw_edf brings channels of other
#   rates to one (its option `exclude` avoids that), and to_data_frame scales EEG to microvolts unless told otherwise
#   (https://mne.tools/stable/generated/mne.io.read_raw_edf.html, …/mne.io.Raw.html). So one expects deg/s to be kept as
#   such, or a warning.
# seen: a gyroscope with 50 samples a second beside an EEG with 256 becomes a channel of type "eeg", its unit "n/a", at
#   256 Hz, without a warning. get_data gives deg/s under the name of volts; to_data_frame gives a million times as much.
#   The samples between are drawn: above 25 Hz there is next to nothing.
# matters: who takes the table has N a million times too large, or, where he takes that out, a gyroscope at 256 Hz whose
#   spectrum ends at 25 Hz as if the sensor had a filter, and five times as many samples as were measured.
# fltea: does not read EDF, and asks for the unit of such a table; a spectrum that ends below half the rate is called
#   filtered, not white. pyEDFlib reads each channel with its own rate and dimension.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"${PYTHON:-python3}" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check mne==1.13.2 pyEDFlib==0.1.42 pandas==3.1.1 numpy==2.4.6

cd "$folder"
HOME="$folder" venv/bin/python -W error - <<'PY'
import mne
import numpy as np
from pyedflib import FILETYPE_EDF, EdfReader, EdfWriter

SECONDS = 60
rng = np.random.default_rng(1)
gyro_dps = rng.normal(0, 0.05, 50 * SECONDS)
channels = [("EEG Fpz", "uV", 256, 500.0, rng.normal(0, 20, 256 * SECONDS)), ("Gyro X", "deg/s", 50, 1.0, gyro_dps)]
with EdfWriter("rest.edf", 2, file_type=FILETYPE_EDF) as file:
    file.setSignalHeaders([
        dict(label=label, dimension=unit, sample_frequency=rate, physical_max=most, physical_min=-most,
             digital_max=32767, digital_min=-32768, transducer="", prefilter="")
        for label, unit, rate, most, _ in channels
    ])
    file.writeSamples([values for *_, values in channels])
with EdfReader("rest.edf") as file:
    unit, rate_hz = file.getPhysicalDimension(1), file.getSampleFrequency(1)
print(f"in the file: {unit} at {rate_hz:g} Hz, deviation {gyro_dps.std():.4f}")

raw = mne.io.read_raw_edf("rest.edf", preload=True, verbose="warning")
kind, unit_read = raw.get_channel_types(["Gyro X"])[0], raw._orig_units["Gyro X"]
values = raw.get_data("Gyro X")[0]
power = np.abs(np.fft.rfft(values)) ** 2
below = power[np.fft.rfftfreq(len(values), 1 / raw.info["sfreq"]) < 25].sum() / power.sum()
print(f"read: {kind} in {unit_read} at {raw.info['sfreq']:g} Hz, deviation {values.std():.4f}, {below:.2%} below 25 Hz")
table = raw.to_data_frame()["Gyro X"].std()
print(f"as a table: deviation {table:.1f}")
assert (kind, raw.info["sfreq"]) == ("eeg", 256) and below > 0.99 and abs(table / gyro_dps.std() / 1e6 - 1) < 0.01, "no longer so"
PY
