"""Tests what files state next to their arrays, or in attributes: units, scales, and names of columns."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from fltea.recording.files import Stored
from fltea.recording.opening import open_recording
from fltea.settings.how import How

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

# --- scales and units ---


def test_attributes_of_netcdf_are_used(tmp_path: Path) -> None:
    counts = np.rint(GYRO * 1000).astype(np.int16)
    counts[5, 1] = -32768
    packed = {"scale_factor": 0.001, "add_offset": 0.25, "_FillValue": np.int16(-32768), "units": "degree/s"}
    whole = with_attributes(tmp_path, counts, packed).whole()
    assert whole.gyro == pytest.approx(np.delete(counts * 0.001 + 0.25, 5, axis=0))
    limits = {"units": "rad/s", "valid_range": [-2.0, 2.0]}
    beyond = (np.abs(GYRO) > 2).any(axis=1)
    found = with_attributes(tmp_path, GYRO, limits).whole()
    assert found.gyro == pytest.approx(np.degrees(GYRO[~beyond]))


@pytest.mark.parametrize(
    ("attributes", "reason"),
    [
        (
            {"scale": 0.0153},
            "gyro_x, gyro_y, gyro_z may have to be changed by gyro@scale 0.0153, and nothing says",
        ),
        ({"Offset": 0.5}, "changed by gyro@offset 0.5"),
        ({"ScaleFactor": 0.5}, "changed by gyro@scalefactor 0.5"),
        ({"conversion": 0.5}, "changed by gyro@conversion 0.5"),
        ({"conversion_factor": 2}, "changed by gyro@conversion_factor 2"),
        ({"scaling": 2}, "changed by gyro@scaling 2"),
        ({"slope": [1.0, 2.0]}, "changed by gyro@slope, which is not one number"),
        ({"LSB_per_dps": 131, "units": "deg/s"}, "changed by gyro@lsb_per_dps 131"),
        ({"scale_factor": [1.0, 2.0]}, "its scale_factor or add_offset is not one number"),
        ({"scale_factor": "two"}, "its scale_factor or add_offset is not one number"),
    ],
)
def test_a_scale_that_says_not_how_is_refused(
    attributes: dict[str, Any], reason: str, tmp_path: Path
) -> None:
    unit = {"units": "deg/s", **attributes}
    text = refusal(with_attributes, tmp_path, GYRO, unit)
    assert reason in text
    assert "scale_factor" in reason or text.partition("\n")[0].endswith("--units ? --overrule")
    assert "--overrule" in refusal(with_attributes, tmp_path, GYRO, attributes, units="dps")
    whole = with_attributes(tmp_path, GYRO, attributes, units="dps", overrule=True).whole()
    assert whole.gyro == pytest.approx(GYRO)


def test_a_scale_of_one_changes_nothing(tmp_path: Path) -> None:
    assert with_attributes(tmp_path, GYRO, {"scale": 1.0, "offset": 0.0, "units": "dps"}).samples == N


@pytest.mark.parametrize(
    "imu",
    [
        {"gyro": GYRO, "units": "rad/s"},
        {"gyro": GYRO, "gyro_unit": "rad/s"},
        {"gyro": GYRO, "units": {"gyro": "rad/s", "accel": "g"}},
    ],
    ids=["of the structure", "beside it", "by name"],
)
def test_texts_beside_arrays_tell_units(imu: dict[str, Any], tmp_path: Path) -> None:
    expected = np.degrees(GYRO)
    assert matlab(tmp_path, {"imu": {**imu, "fs": 100.0}}).whole().gyro == pytest.approx(expected)
    lists = {**imu, "gyro": GYRO.tolist(), "fs": 100.0}
    assert document(tmp_path, {"imu": lists}).whole().gyro == pytest.approx(expected)
    text = refusal(matlab, tmp_path, {"imu": {**imu, "fs": 100.0}}, units="dps")
    assert "rad/s" in text
    assert "--overrule" in text


def test_a_name_and_the_unit_beside_it_agree(tmp_path: Path) -> None:
    arrays = {"imu": {"gyro_dps": GYRO, "units": "rad/s", "fs": 100.0}}
    text = refusal(matlab, tmp_path, arrays)
    assert "gyro_x_dps is in dps by its name, and in rad/s by the unit beside it" in text
    assert matlab(tmp_path, arrays, units="dps", overrule=True).whole().gyro == pytest.approx(GYRO)


# --- what a file states about the columns of an array, and about their scale ---

TABLE = np.c_[TIMES_S, GYRO, GYRO[:, :1] + 9.81]
COLUMNS = {"columns": ["t", "gx", "gy", "gz", "ax"], "units": ["s", *["rad/s"] * 3, "m/s^2"]}


def beside(array: str, attributes: dict[str, Any], mark: str) -> dict[str, Any]:
    """Return facts about an array, such as its unit, under the names that they get in the file. If `mark` is
    "@", they become attributes of the array. If it is "_", they become arrays next to it.
    """
    return {f"{array}{mark}{name}": value for name, value in attributes.items()}


@pytest.mark.parametrize("read", [hdf5, npz])
def test_columns_of_an_array_have_the_names_and_units_that_are_stated(
    read: Callable[..., Stored], tmp_path: Path
) -> None:
    mark = "@" if read is hdf5 else "_"
    found = read(tmp_path, {"imu": TABLE, **beside("imu", COLUMNS, mark)})
    assert found.rate_hz == pytest.approx(100.0)
    assert found.whole().gyro == pytest.approx(np.degrees(GYRO))
    assert "rad/s" in refusal(read, tmp_path, {"imu": TABLE, **beside("imu", COLUMNS, mark)}, units="dps")


def test_cells_of_matlab_may_name_columns_and_units(tmp_path: Path) -> None:
    cells = {name: np.array(texts, object) for name, texts in COLUMNS.items()}
    found = matlab(tmp_path, {"rest": {"imu": TABLE, **beside("imu", cells, "_")}})
    assert found.whole().gyro == pytest.approx(np.degrees(GYRO))


@pytest.mark.parametrize("stated", [{"columns": ["z", "y", "x"]}, {"axes": "zyx"}, {"labels": "Z, Y, X"}])
@pytest.mark.parametrize("read", [hdf5, npz])
def test_the_order_of_axes_that_is_stated_is_followed(
    read: Callable[..., Stored], stated: dict[str, Any], tmp_path: Path
) -> None:
    mark = "@" if read is hdf5 else "_"
    arrays = {"gyro_dps": GYRO[:, ::-1], "t": TIMES_S, **beside("gyro_dps", stated, mark)}
    found = read(tmp_path, arrays)
    assert (found.axes, found.whole().gyro.tolist()) == (("x", "y", "z"), GYRO.tolist())


@pytest.mark.parametrize(
    ("stated", "reason"),
    [
        ({"units": ["deg/s", "rad/s", "rad/s"]}, "the columns of one sensor are in different units"),
        ({"units": ["rad/s", "rad/s"]}, "2 units (rad/s, rad/s) are stated for 3 columns"),
        ({"columns": ["x", "y"]}, "gyro@columns names 2 columns (x, y), and there are 3"),
        ({"axes": ["x", "-y", "-z"]}, "names axes with signs (x, -y, -z), which are not applied here"),
    ],
)
def test_what_is_stated_of_columns_and_does_not_fit_is_refused(
    stated: dict[str, Any], reason: str, tmp_path: Path
) -> None:
    how = {"units": "rad/s"} if "units" in stated and len(stated["units"]) != 3 else {}
    text = refusal(with_attributes, tmp_path, GYRO, {"units": "rad/s", **stated}, **how)
    assert reason in text
    assert "--overrule" in text


@pytest.mark.parametrize("read", [npz, matlab, document])
@pytest.mark.parametrize("name", ["gyro_scale", "gyro_scale_factor", "scale", "gyro_gain"])
def test_a_scale_beside_an_array_is_asked_for(read: Callable[..., Stored], name: str, tmp_path: Path) -> None:
    counts = np.rint(GYRO * 131)
    values = counts.tolist() if read is document else counts.astype(np.int16)
    arrays = {"gyro": values, name: 1 / 131, "gyro_units": "deg/s", "fs": 100.0}
    text = refusal(read, tmp_path, arrays)
    assert f"may have to be changed by {name} 0.00763359" in text
    assert text.partition("\n")[0].endswith("--units ? --overrule")
    assert "--units lsb:131" in text
    found = read(tmp_path, arrays, units="lsb:131", overrule=True)
    assert found.whole().gyro.tolist() == counts.tolist()
    assert found.lsb_per_dps == 131.0
    assert read(tmp_path, {**arrays, name: 1.0}).whole().gyro == pytest.approx(counts)
    each = [[1.0, 1.0, 1.0], [0.5, 0.5, 0.5], [1.0, 1.0, 0.5]]
    for scales, shown in zip(each, ("", f"{name} 0.5", f"{name}, which is not one number"), strict=True):
        three = {**arrays, name: scales if read is document else np.array(scales)}
        if shown:
            assert f"may have to be changed by {shown}" in refusal(read, tmp_path, three)
        else:
            assert read(tmp_path, three).samples == N


def test_an_offset_of_times_and_a_scale_of_others_change_no_rates(tmp_path: Path) -> None:
    others = {"time_offset": 5.0, "accel_scale": 0.5, "mic_gain": 3.0, "accel_lsb_per_g": 16384.0}
    assert npz(tmp_path, {"gyro_dps": GYRO, "t": TIMES_S, **others}).samples == N
    text = refusal(npz, tmp_path, {"gyro_dps": GYRO, "t": TIMES_S, "t_scale": 2.0})
    assert "t: t_scale 2 may change its numbers" in text


def test_counts_in_a_degree_per_second_are_a_unit(tmp_path: Path) -> None:
    arrays = {"gyro": np.rint(GYRO * 131).astype(np.int16), "t": TIMES_S}
    stated = hdf5(tmp_path, {**arrays, "gyro@LSB_per_dps": 131.0})
    assert stated.lsb_per_dps == 131.0
    assert next(str(one) for one in stated.reading if one.question == "unit").startswith("lsb:131 (stated")
    text = refusal(hdf5, tmp_path, {**arrays, "gyro@LSB_per_dps": 131.0}, units="lsb:65.5")
    assert "is in lsb:131 by its name or the row of units" in text


def test_an_archive_with_other_times_or_no_scale_is_read_as_any(tmp_path: Path) -> None:
    path = tmp_path / "rest.npz"
    np.savez(path, gyro_dps=GYRO, fs_hz=100.0, t=2 * TIMES_S)
    text = refusal(open_recording, path)
    assert "by its times the rate is 50 Hz, and the file states 100 Hz" in text
    np.savez(path, gyro_dps=GYRO, fs_hz=100.0, t=TIMES_S)
    assert open_recording(path).rate_hz == pytest.approx(100.0)
    counts = np.rint(GYRO * 131).astype(np.int16)
    np.savez(path, gyro_raw=counts, fs_hz=100.0)
    text = refusal(open_recording, path)
    assert "nothing says the unit of gyro_raw_x, gyro_raw_y, gyro_raw_z" in text
    found = open_recording(path, How(units="lsb:131"))
    assert (found.rate_hz, found.lsb_per_dps) == (100.0, 131.0)
    assert found.whole().gyro.tolist() == counts.tolist()


def test_times_in_the_group_of_columns_that_are_asked_for_are_not(tmp_path: Path) -> None:
    arrays = {"CAN/time": TIMES_S, "CAN/TurnRate": GYRO[:, 2], "CAN/TurnRate@units": "deg/s"}
    text = refusal(hdf5, tmp_path, arrays)
    assert text.partition("\n")[0].endswith("?: --columns ?,?,?")
    for name in ("CAN.TurnRate", "1"):
        found = hdf5(tmp_path, arrays, columns=[name])
        assert (found.rate_hz, found.samples) == (pytest.approx(100.0), N)


def test_attributes_without_a_value_and_axes_of_words_say_nothing(tmp_path: Path) -> None:
    arrays = {"gyro_dps": GYRO, "t": TIMES_S, "@title": h5py.Empty("S1"), "gyro_dps@units": h5py.Empty("S1")}
    assert hdf5(tmp_path, arrays).samples == N
    words = {"gyro_x_dps": np.array(["a"] * 60), "gyro_y_dps": GYRO[:60, 1], "fs": 100.0}
    assert "gyro_x_dps: holds text" in refusal(npz, tmp_path, words)


def test_a_series_of_nwb_is_scaled_as_its_schema_says(tmp_path: Path) -> None:
    data = {"conversion": 0.01, "offset": 0.5, "resolution": 0.001, "unit": "rad/s"}
    series = {"acquisition/gyro/data": np.rint(GYRO * 100), **beside("acquisition/gyro/data", data, "@")}
    series |= {"acquisition/gyro@neurodata_type": "TimeSeries", "acquisition/gyro/starting_time": 0.0}
    found = hdf5(tmp_path, {**series, "acquisition/gyro/starting_time@rate": 100.0})
    assert found.rate_hz == 100.0
    assert found.whole().gyro == pytest.approx(np.degrees(np.rint(GYRO * 100) * 0.01 + 0.5))


def test_units_of_a_group_are_of_all_that_is_in_it_but_its_times(tmp_path: Path) -> None:
    arrays = {"imu/raw/gyro": GYRO, "imu/raw/t": TIMES_S, "imu@units": "rad/s"}
    assert hdf5(tmp_path, arrays).whole().gyro == pytest.approx(np.degrees(GYRO))
    assert "rad/s" in refusal(hdf5, tmp_path, arrays, units="dps")
    fields = np.zeros(N, [("t", "f8"), ("gyro", "f8", 3)])
    fields["t"], fields["gyro"] = TIMES_S, GYRO
    found = hdf5(tmp_path, {"imu": fields, "imu@units": "rad/s"})
    assert found.whole().gyro == pytest.approx(np.degrees(GYRO))


@pytest.mark.parametrize(
    ("unit", "seconds"), [("minutes", 60), ("hours", 3600), ("days", 86400), ("min", 60), ("h", 3600)]
)
def test_times_in_longer_units_are_converted(unit: str, seconds: float, tmp_path: Path) -> None:
    for stated in (unit, f"{unit} since 2024-05-01"):
        found = hdf5(tmp_path, {"gyro_dps": GYRO, "t": TIMES_S / seconds, "t@units": stated})
        assert found.rate_hz == pytest.approx(100.0)
    text = refusal(hdf5, tmp_path, {"gyro_dps": GYRO, "t": TIMES_S, "t@units": "fortnights"})
    assert "what the times of t count (the file says fortnights)" in text


def test_arrays_of_structures_of_matlab_73_are_sensors(tmp_path: Path) -> None:
    path = tmp_path / "rest.h5"
    with h5py.File(path, "w") as file:
        for k, values in enumerate((GYRO, OTHER[:N])):
            file[f"#refs#/{k}"] = values
        file["#refs#/fs"] = 100.0
        file["imu/gyro_dps"] = np.array([[file["#refs#/0"].ref], [file["#refs#/1"].ref]], h5py.ref_dtype)
        file["imu/fs"] = np.array([[file["#refs#/fs"].ref]] * 2, h5py.ref_dtype)
        file["imu"].attrs["MATLAB_class"] = np.bytes_("struct")
    text = refusal(open_here, "hdf5", path)
    assert "which gyroscope is meant of imu(1) (300 rows), imu(2) (300 rows)" in text
    found = open_here("hdf5", path, topic="imu(2)")
    assert (found.rate_hz, found.whole().gyro.tolist()) == (100.0, OTHER[:N].tolist())
