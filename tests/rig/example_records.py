"""Records in which every field has a value of its own, for the tests of what outputs make of them."""

from fltea.records.records import (
    ACCEL_UNIT,
    AxisEstimate,
    AxisStats,
    DeviceStatus,
    LinkStats,
    SampleStats,
    Stats,
)

GOOD = AxisEstimate(0.412, 0.031, -2.125, 0.25, 0.1234, -0.0567, True, 0.312, "not rejected")
INVALID = AxisEstimate(None, None, None, None, None, None, False)
STATS = Stats(
    epoch=3,
    host_ns=9_500_000_000,
    rate_hz=99.5,
    clock_ppm=-62.5,
    startup_remaining=123,
    link=LinkStats(51, 41, {"crc": 2, "cobs": 3}, 4, 6, 7, 1),
    samples=SampleStats(delivered=1234, lost=56, gaps=70, duplicates=8, before_hello=9),
    axes={
        "gyro_x": AxisStats(0.1, 0.02, 5, {"order_box": 13, "held": 1}, 0.25, 1.5),
        "accel_z": AxisStats(0.1, 0.02, 2, {}, unit=ACCEL_UNIT),
    },
    board=DeviceStatus(11, 12, 14, 15, 16, "user"),
    device="due",
)
