"""Tests tables with several sensors, scales and sampling rates. A label belongs to the array of its name, a
list of values belongs to columns by position, and a sampling rate belongs to a group of columns.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from fltea.recording.files import Stored
from fltea.recording.groups import gyroscopes_in
from fltea.recording.readers.file_facts import rate_of
from hypothesis import given
from hypothesis import strategies as st

from tests.rig.table_support import (
    GYRO,
    OTHER,
    TIMES_S,
    N,
    document,
    hdf5,
    matlab,
    npz,
    open_here,
    refusal,
    with_attributes,
)

# --- labels by name, values by position ---


def three(x: Any, y: Any, z: Any) -> dict[str, Any]:
    return {"gyro_x_dps": x, "gyro_y_dps": y, "gyro_z_dps": z}


BAD_X = {
    "one sample shorter": GYRO[1:, 0],
    "text": np.array([b"0.1"] * N),
    "complex": GYRO[:, 0] * 1j,
    "three dimensions": np.zeros((N, 2, 2)),
}


@pytest.mark.parametrize("name", BAD_X)
def test_an_axis_that_cannot_be_used_is_named_and_no_other_moves_up(name: str, tmp_path: Path) -> None:
    arrays = three(BAD_X[name], GYRO[:, 1], GYRO[:, 2])
    for read in (hdf5, npz, matlab):
        if name == "text" and read is matlab:
            continue  # MATLAB files hold a text as a table of letters
        text = refusal(read, tmp_path, arrays, rate_hz=100.0)
        assert "gyro_x_dps" in text
        assert ("differ in length" if name == "one sample shorter" else "not one number in each row") in text
    found = npz(tmp_path, arrays, rate_hz=100.0, columns=["gyro_y_dps", "gyro_z_dps"])
    assert (found.axes, found.whole().gyro.tolist()) == (("y", "z"), GYRO[:, 1:].tolist())


def test_null_in_json_is_a_missing_number_of_its_axis(tmp_path: Path) -> None:
    columns = three(*GYRO.T.tolist())
    columns["gyro_x_dps"][7] = None
    by_row = {name: {str(k): value for k, value in enumerate(values)} for name, values in columns.items()}
    split = {"columns": [*columns], "data": list(zip(*columns.values(), strict=True))}
    for content in (columns, by_row, split):
        whole = document(tmp_path, content, rate_hz=100.0).whole()
        assert whole.gyro.tolist() == np.delete(GYRO, 7, axis=0).tolist()
        assert 7 not in whole.seq.tolist()
    columns["gyro_y_dps"][3] = "no number"
    rows = [list(row) for row in zip(*GYRO.T.tolist(), strict=True)]
    found = document(tmp_path, rows, rate_hz=100.0, units="dps", columns=["1", "2", "3"])
    assert found.whole().gyro.tolist() == GYRO.tolist()
    text = refusal(document, tmp_path, columns, rate_hz=100.0)
    assert "gyro_y_dps: holds 'no number', not one number in each row" in text


def test_axes_of_different_units_are_refused(tmp_path: Path) -> None:
    arrays = {"gyro_x_dps": GYRO[:, 0], "gyro_y_rad_s": GYRO[:, 1], "gyro_z_dps": GYRO[:, 2]}
    text = refusal(npz, tmp_path, arrays, rate_hz=100.0)
    assert "different units" in text
    assert "gyro_y_rad_s in rad/s" in text


def test_four_columns_of_an_array_are_no_axes(tmp_path: Path) -> None:
    array = np.c_[TIMES_S, GYRO]
    text = refusal(npz, tmp_path, {"gyro": array}, units="dps", rate_hz=100.0)
    assert "nothing says which columns are the gyroscope's axes" in text
    columns = ["gyro#2", "gyro#3", "gyro#4"]
    found = npz(tmp_path, {"gyro": array}, units="dps", columns=columns, time_column="gyro#1", time_unit="s")
    assert found.whole().gyro.tolist() == GYRO.tolist()


def test_fields_of_a_table_keep_their_names(tmp_path: Path) -> None:
    table = np.zeros(N, [("t_ms", "<u4"), ("gyro_dps", "<f8", 3), ("acc", "<f8", 2)])
    table["t_ms"], table["gyro_dps"] = TIMES_S * 1e3, GYRO
    assert npz(tmp_path, {"rest": table}).whole().gyro.tolist() == GYRO.tolist()


def test_what_only_matlab_reads_is_called_so(tmp_path: Path) -> None:
    cells = np.empty(3, object)
    cells[:] = [GYRO[:, 0], "a", 1.0]
    text = refusal(matlab, tmp_path, {"gyro_dps": cells}, rate_hz=100.0)
    assert "gyro_dps is a cell array; write it as numbers: cell2mat" in text
    assert "__globals__" not in text
    path = tmp_path / "rest.h5"
    with h5py.File(path, "w") as file:
        file["imu"] = np.zeros((6, 1), np.uint32)
        file["imu"].attrs.update({"MATLAB_class": np.bytes_("timetable"), "MATLAB_object_decode": 3})
    assert "is a timetable of MATLAB's, which only MATLAB reads; there, writetimetable" in refusal(
        open_here, "hdf5", path
    )


# --- several sensors ---

SENSORS = {"left/gyro": GYRO, "left/t": TIMES_S, "right/gyro": OTHER, "right/t": np.arange(2 * N) / 200}


def test_one_of_several_groups_is_chosen_and_never_a_mixture(tmp_path: Path) -> None:
    text = refusal(hdf5, tmp_path, SENSORS, units="dps", time_unit="s")
    assert "which gyroscope is meant of left (300 rows), right (600 rows)" in text
    assert text.endswith("--units dps --time-unit s --sensor ?")
    for topic, values, rate_hz in (("left", GYRO, 100.0), ("/right", OTHER, 200.0)):
        found = hdf5(tmp_path, SENSORS, units="dps", topic=topic)
        assert found.whole().gyro.tolist() == values.tolist()
        assert (found.rate_hz, found.topic) == (pytest.approx(rate_hz), topic.strip("/"))
        assert str(found.reading[0]) == f"{topic.strip('/')} (given: --sensor)"
    parts = {name.replace("/", "_"): value for name, value in SENSORS.items()}
    structures = {
        side: {"gyro": parts[f"{side}_gyro"], "t": parts[f"{side}_t"]} for side in ("left", "right")
    }
    assert matlab(tmp_path, structures, units="dps", topic="left").whole().gyro.tolist() == GYRO.tolist()


def test_columns_by_name_are_of_any_group_but_of_one_length(tmp_path: Path) -> None:
    names = [f"right.gyro_{axis}" for axis in "xyz"]
    found = hdf5(tmp_path, SENSORS, units="dps", columns=names, time_column="right.t", time_unit="s")
    assert found.whole().gyro.tolist() == OTHER.tolist()
    mixed = ["left.gyro_x", *names[1:]]
    text = refusal(hdf5, tmp_path, SENSORS, units="dps", columns=mixed, rate_hz=100.0)
    assert "differ in length (left.gyro_x 300, right.gyro_y 600, right.gyro_z 600)" in text


def test_a_calibration_is_no_second_sensor(tmp_path: Path) -> None:
    arrays = {"imu/gyro": GYRO, "calibration/gyro": np.eye(3)}
    assert hdf5(tmp_path, arrays, units="dps", rate_hz=100.0).samples == N


def test_an_accelerometer_of_another_length_is_named_as_unread(tmp_path: Path) -> None:
    found = hdf5(tmp_path, {"imu/gyro": GYRO, "imu/accel": GYRO[::2]}, units="dps", rate_hz=100.0)
    assert "imu.accel_x, imu.accel_y, imu.accel_z: not read" in found.notes[0].text


@given(st.lists(st.sampled_from(["left", "imu0", "raw", "a"]), max_size=3), st.sampled_from("xyz"))
def test_groups_are_the_path_before_the_axis(path: list[str], axis: str) -> None:
    for leaf in (f"gyro_{axis}", f"angular_velocity.{axis}", f"g{axis}"):
        groups = gyroscopes_in([".".join([*path, leaf]), ".".join([*path, "accel_x"])])
        assert groups == {".".join(path): [0]}


# --- sampling rates of groups ---


def rates(folder: Path, read: Callable[..., Stored], **scalars: float) -> Stored:
    """Write a file with a gyroscope in the group `imu` and with sampling rates at the given paths, and read
    it. In `scalars`, a path has "_" in place of "/".
    """
    tree: dict[str, Any] = {"imu": {"gyro_dps": GYRO}, "mic": {"sound": OTHER[:, 0]}}
    for path, rate_hz in scalars.items():
        group, _, name = path.rpartition("_")
        (tree[group] if group else tree)[name] = rate_hz
    if read is matlab:
        return matlab(folder, tree)
    flat = {
        (f"{name}/{key}" if isinstance(value, dict) else name): inner
        for name, value in tree.items()
        for key, inner in (value.items() if isinstance(value, dict) else [(name, value)])
    }
    if read is hdf5:
        return hdf5(folder, flat)
    if read is npz:
        return npz(folder, {name.replace("/", "."): value for name, value in flat.items()})
    lists = {
        name: {key: np.asarray(inner).tolist() for key, inner in value.items()}
        if isinstance(value, dict)
        else value
        for name, value in tree.items()
    }
    return document(folder, lists)


@pytest.mark.parametrize("read", [hdf5, matlab, npz, document])
def test_the_rate_of_the_group_counts(read: Callable[..., Stored], tmp_path: Path) -> None:
    assert rates(tmp_path, read, imu_fs=200.0, mic_fs=44100.0).rate_hz == 200.0
    assert rates(tmp_path, read, mic_fs=44100.0, imu_fs=200.0, fs=50.0).rate_hz == 200.0
    assert rates(tmp_path, read, mic_fs=44100.0, fs=50.0).rate_hz == 50.0
    assert "nothing says the rate" in refusal(rates, tmp_path, read, mic_fs=44100.0)
    text = refusal(rates, tmp_path, read, imu_fs=200.0, imu_odr=400.0)
    assert "which of the rates [Hz] that are stated" in text
    assert "imu.fs 200, imu.odr 400" in text


def test_a_rate_is_checked_against_times_and_the_user(tmp_path: Path) -> None:
    arrays = {"gyro_dps": GYRO, "t": TIMES_S, "fs": 102.0}
    text = refusal(npz, tmp_path, arrays)
    assert "fs says 102 Hz, and the times of t say 100 Hz" in text
    assert npz(tmp_path, arrays, overrule=True).rate_hz == pytest.approx(100.0)
    assert npz(tmp_path, {**arrays, "fs": 100.4}).rate_hz == pytest.approx(100.0)
    plain = {"gyro_dps": GYRO, "fs": 100.0}
    assert "fs says 100 Hz, and --rate says 200 Hz" in refusal(npz, tmp_path, plain, rate_hz=200.0)
    assert npz(tmp_path, plain, rate_hz=200.0, overrule=True).rate_hz == 200.0


def test_attributes_of_hdf5_are_rates_too(tmp_path: Path) -> None:
    arrays = {"imu/gyro_dps": GYRO, "mic/sound": OTHER[:, 0], "mic@sampling_rate": 44100.0}
    assert hdf5(tmp_path, {**arrays, "imu@Sampling Rate": 200.0}).rate_hz == 200.0
    assert hdf5(tmp_path, {**arrays, "@fs": 50.0}).rate_hz == 50.0
    assert with_attributes(tmp_path, GYRO, {"sample_rate": 100, "units": "deg/s"}).rate_hz == pytest.approx(
        100
    )
    assert "gyro@sample_rate says 98 Hz" in refusal(
        with_attributes, tmp_path, GYRO, {"sample_rate": 98}, units="dps"
    )


@pytest.mark.parametrize(
    ("name", "value", "unit", "rate_hz"),
    [
        ("imu.Fs", 200, "", 200.0),
        ("fs_kHz", 1.6, "", 1600.0),
        ("imu.gyro@sampling frequency", "104", "", 104.0),
        ("sample_period_us", 500, "", 2000.0),
        ("fs", 2, "kHz", 2000.0),
        ("fs", 2, "bananas", None),
        ("dt", 0.01, "", None),
        ("dt", 0.01, "s", 100.0),
        ("dt", "10 ms", "", 100.0),
        ("gyro@sampling_frequency", "100 Hz", "", 100.0),
        ("gyro@sampling_frequency", b"1.6kHz", "", 1600.0),
        ("SampleRate", "2e3 [Hz]", "", 2000.0),
        ("fs_hz", "0.1 kHz", "", None),
        ("fs", "fast", "", None),
        ("fs", "100 bananas", "", None),
        ("gyro@wf_increment", 0.01, "", 100.0),
        ("gyro@wf_increment", 10, "ms", 100.0),
        ("gyro@wf_increment", 10, "samples", None),
        ("fs", 0, "", None),
        ("fs", float("nan"), "", None),
        ("heart_rate", 70, "", None),
    ],
)
def test_names_of_rates(name: str, value: Any, unit: str, rate_hz: float | None) -> None:
    found = rate_of(name, value, unit)
    assert found is None if rate_hz is None else found == pytest.approx(rate_hz)


def test_texts_that_are_dates_are_times(tmp_path: Path) -> None:
    texts = [f"2024-05-01T00:00:{t:09.6f}" for t in TIMES_S]
    for read, kind in ((npz, "U"), (hdf5, "S")):
        found = read(tmp_path, {"gyro_dps": GYRO, "when": np.array(texts, kind)})
        assert found.rate_hz == pytest.approx(100.0)
        assert found.whole().device_s == pytest.approx(TIMES_S)
