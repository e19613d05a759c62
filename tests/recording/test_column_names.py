"""Tests what names of columns mean: axes of which sensor, in which unit, and which are times."""

import pytest
from fltea.recording.column_names import (
    accel_axis_of,
    accel_unit_of,
    axes_in_units,
    axis_of,
    counts_unknown,
    is_time,
    named_axis,
    rate_unit_of,
    time_scale_of,
    time_unit_of,
    times_in,
    unit_in,
)

GYROSCOPES = {
    "gyro z (deg/h)": "deg/h",
    "gz [dps]": "deg/s",
    "[dps] gz": "deg/s",
    "wz(°/s)": "deg/s",
    "gyro_z_mrad_s": "mrad/s",
    "gyro_z_rad_per_sec": "rad/s",
    "gyro_z_mDPS": "mdeg/s",
    "GyroZ[rad s^-1]": "rad/s",
    "w_RS_S_z [rad s^-1]": "rad/s",
    "gyr_z_dph": "deg/h",
    "Gyroscope z (rad/s)": "rad/s",
    "Gyro Z deg/s": "deg/s",
    "Angular velocity Z(°/s)": "deg/s",
    "rotation_rate_z(radians/s)": "rad/s",
    "rotationRateZ(rad/s)": "rad/s",
    "motionRotationRateZ(rad/s)": "rad/s",
    "gyroRotationZ(rad/s)": "rad/s",
    "gyro_rad[2]": "rad/s",
    "gyro_z_rads": "rad/s",
    "z-axis (deg/s)": "deg/s",
    "Z (deg/s)": "deg/s",
    "AsZ(°/s)": "deg/s",
    "gz{deg/s}": "deg/s",
    "gz <dps>": "deg/s",
    "gz in deg/s": "deg/s",
    "gyroADC[2] (deg/s)": "deg/s",
    "z_dps": "deg/s",
    "RAW_IMU.zgyro": None,
    "SCALED_IMU2.zgyro": None,
    "Shimmer_0000_Gyro_Z_CAL": None,
    "Shimmer_A7B3_Gyro_Z_CAL": None,
    "lsm6dsox_gyro_z": None,
    "gyroUnfilt[2]": None,
    "gyro_dps.z": "deg/s",
    "imu.gyro_rad_s.Z": "rad/s",
    "Gyroscope (rad/s) Z": "rad/s",
    "gyro_mdps_z": "mdeg/s",
    "gyro z (raw)": None,
    "gyro_z [LSB]": None,
    **dict.fromkeys(
        ("Gyr_Z", "GyrZ", "GZ", "zgyro", "z_gyro", "gyroZ", "avelZ", "IMU.GyrZ", "GYRO-Z", "gyro0.z"), None
    ),
}


@pytest.mark.parametrize("name", GYROSCOPES)
def test_names_of_a_gyroscopes_axis(name: str) -> None:
    assert (axis_of(name), rate_unit_of(name)) == ("z", GYROSCOPES[name])
    assert accel_axis_of(name) is None


OTHERS = [
    *(
        "gyro_x [rad]",
        "gyro_x_rad",
        "gyro_x_deg",
        "gyro_x_g",
        "gx [g]",
        "gx (m/s²)",
        "x [local_flux]",
        "mag_x (uT)",
    ),
    *(
        "roll (deg/s)",
        "AngleX(°)",
        "euler x (deg)",
        "x angle (deg/s)",
        "bias_x (dps)",
        "x (rads)",
        "x",
        "x (deg)",
    ),
    *(
        "std_gyro_x",
        "std0_gyro_x",
        "alpha_gyro_x",
        "gyro_x_dps_std",
        "gFx",
        "rotation_x",
        "gain",
        "gyro_x" * 20,
    ),
]


@pytest.mark.parametrize("name", OTHERS)
def test_names_of_something_else_or_that_leave_a_doubt(name: str) -> None:
    assert axis_of(name) is None


ACCELEROMETERS = {
    "accelerationY(g)": 9.80665,
    "accelerometerAccelerationY(G)": 9.80665,
    "AccY(g)": 9.80665,
    "y-axis (g)": 9.80665,
    "acc_y_mg": 9.80665e-3,
    "ay [g]": 9.80665,
    "a_RS_S_y [m s^-2]": 1.0,
    "acc_y_m_s2": 1.0,
    "a_y_m_per_s2": 1.0,
    "accelerometer_m_s2[1]": 1.0,
    "acc y [m/(s^2)]": 1.0,
    **dict.fromkeys(
        ("yacc", "RAW_IMU.yacc", "AccY", "Acc_Y", "accSmooth[1]", "Shimmer_0000_Accel_LN_Y_CAL"), None
    ),
}


@pytest.mark.parametrize("name", ACCELEROMETERS)
def test_names_of_an_accelerometers_axis(name: str) -> None:
    assert accel_axis_of(name) == "y"
    ms2 = ACCELEROMETERS[name]
    assert accel_unit_of(name) == (None if ms2 is None else pytest.approx(ms2))
    assert axis_of(name) is None


def test_a_unit_beside_a_name_counts_as_one_in_it() -> None:
    assert (axis_of("X", "deg/s"), accel_axis_of("X", "deg/s")) == ("x", None)
    assert (axis_of("X", "m/s^2"), accel_axis_of("X", "m/s^2")) == (None, "x")
    assert (axis_of("gyro_x", "rad"), axis_of("gyro_x", "parrots"), axis_of("gyro_x", "-")) == (
        None,
        "x",
        "x",
    )


TIMES = {
    **dict.fromkeys(("time_s", "T [s]", "header.stamp.secs", "seconds_elapsed"), "s"),
    **dict.fromkeys(("t [ms]", "millis"), "ms"),
    **dict.fromkeys(("Timestamp(µs)", "TimeUS", "RAW_IMU.time_usec"), "us"),
    "timestampNs": "ns",
    **dict.fromkeys(("t", "Time", "SampleTimeFine", "field.header.stamp", "deviceTime", "Zeit"), None),
    "Shimmer_0000_Timestamp_Unix_CAL": None,
}


@pytest.mark.parametrize("name", TIMES)
def test_names_of_times(name: str) -> None:
    assert is_time(name)
    assert time_unit_of(name) == TIMES[name]


LONG_TIMES = {"Time [min]": 60, "elapsed_minutes": 60, "t (h)": 3600, "Time (days)": 86_400, "Zeit in s": 1}


@pytest.mark.parametrize("name", LONG_TIMES)
def test_names_of_times_in_minutes_and_more(name: str) -> None:
    assert is_time(name)
    assert time_scale_of(name) == ("s", LONG_TIMES[name])


def test_a_unit_of_times_that_nobody_knows_is_told_apart_from_a_clock() -> None:
    clocks = ["Time (UTC)", "time [hh:mm:ss]", "Timestamp (+0200)", "ChipTime()", "Time [s]", "time", "ms"]
    assert [counts_unknown(name, "") for name in clocks] == [""] * len(clocks)
    assert [counts_unknown("Time", unit) for unit in ("s", "", "ticks", "10us")] == ["", "", "ticks", "10us"]
    assert counts_unknown("Time [weeks]", "") == "weeks"


RATES = {
    "Drehrate {} [°/s]": "XYZ",
    "Angular velocity around {} (rad/s)": "xyz",
    "{} rate [deg/hr]": "XYZ",
    "{} (rad/s)": "pqr",
    "{} rate (deg/s)": ("Roll", "Pitch", "Yaw"),
}


@pytest.mark.parametrize("form", RATES)
def test_three_columns_called_alike_in_a_unit_of_rates_are_axes(form: str) -> None:
    names = ["t", *(form.format(letter) for letter in RATES[form])]
    assert axes_in_units(names, []) == {"x": 1, "y": 2, "z": 3}
    assert axes_in_units(names[:3], []) == {}
    assert axes_in_units([*names, names[1]], []) == {}
    assert axes_in_units([*names, *(f"other {name}" for name in names[1:])], []) == {}
    assert axes_in_units([f"setpoint {name}" for name in names], []) == {}
    bare = [name.partition("[")[0].partition("(")[0] for name in names]
    assert (axes_in_units(bare, []), axes_in_units(bare, ["s", *["deg"] * 3])) == ({}, {})
    assert axes_in_units(bare, ["s", *["deg/s"] * 3]) == {"x": 1, "y": 2, "z": 3}


def test_temperatures_and_scales_are_no_times() -> None:
    names = ["T(°)", "T [°C]", "temp", "tscale", "t_g", "cts", "gyro_s", "time [deg]", "time_s_max"]
    assert [name for name in names if is_time(name)] == []
    assert times_in(["timestamp", "TimeUS", "T", "gx"]) == ["timestamp", "TimeUS"]
    assert times_in(["T", "gx"]) == ["T"]


def test_arrays_have_names_of_their_axes() -> None:
    found = [named_axis(name, 1) for name in ("gyro_dps", "gyro", "Gyro (rad/s)", "gyro_rad_s", "accel_ms2")]
    assert found == ["gyro_y_dps", "gyro_y", "Gyro_y [rad/s]", "gyro_y_rad_s", "accel_y_ms2"]
    assert [unit_in(name) for name in ("gyro_y_rad_s", "Gyro_y [rad/s]", "x (foo)", "x")] == [
        "rad_s",
        "rad/s",
        "foo",
        "",
    ]
