"""Records in which every field has a distinct value, for the tests of outputs."""

from typing import Any

from fltea.records.estimate import AxisEstimate, FlteaEstimate
from fltea.records.fit import Interval
from fltea.records.records import ACCEL_UNIT, GYRO_UNIT, Motion, Stats, Step
from fltea.records.stats import AxisStats, BiasCheck, DeviceStatus, LinkStats, SampleStats, TrackerStats


def axis_estimate(*of_filters: Any, unit: str = GYRO_UNIT, **known: Any) -> AxisEstimate:
    """Return an example of an estimate of one axis. `of_filters`: the figures from the paper's filters.

    `known`: values of other fields.
    """
    given = {
        "verdict": "fractional",
        "alpha": Interval(0.51, 0.42, 0.6),
        "f": Interval(-1.2, -2.5, -0.7),
        "bias": 0.2345,
        "bias_std": 0.0123,
        "state": 0.1345,
        "state_std": 0.0113,
        "innovation": -0.0432,
        "moving": False,
        "null_p": None,
        "whiteness": None,
    }
    return AxisEstimate(**(given | known), unit=unit, fltea=FlteaEstimate(*of_filters))


GOOD = axis_estimate(
    0.412, 0.031, -2.125, 0.25, 0.1234, -0.0567, True, True, null_p=0.312, whiteness="not rejected"
)
UNKNOWN = dict.fromkeys(("verdict", "bias", "bias_std", "state", "state_std", "innovation"))
INVALID = axis_estimate(*[None] * 6, False, alpha=Interval(), f=Interval(), **UNKNOWN)
TRACKER = TrackerStats(
    model="white",
    nis=1.02,
    lag1=0.03,
    holds=True,
    moved=17,
    restarts=0,
    heading_std={1: 0.014, 60: 0.26},
    bias=0.234,
    bias_std=0.012,
    steps=3,
    moving=True,
    checked={1: BiasCheck(310, 1.04), 10: BiasCheck(31, 0.93)},
    bias_for_s=2.5,
)
STEP = Step(700, 3, 7_000_000, 7_000_000_000, "gyro_x", GYRO_UNIT, 0.1037, 0.0112, 31, device="due")
MOVES = Motion(800, 3, 8_000_000, 8_000_000_000, True, "accel", None, None, device="due")
RESTS = Motion(1000, 3, 10_000_000, 10_000_000_000, False, "accel", 200, 12.34, device="due")
STATS = Stats(
    epoch=3,
    host_ns=9_500_000_000,
    rate_hz=99.5,
    clock_ppm=-62.5,
    startup_remaining=123,
    link=LinkStats(51, 41, {"crc": 2, "cobs": 3}, 4, 6, 7, 1),
    sample_counts=SampleStats(delivered=1234, lost=56, gaps=70, duplicates=8, before_hello=9, rate_differs=3),
    axes={
        "gyro_x": AxisStats(0.1, 0.02, 5, {"order_box": 13, "held": 1}, 0.25, 1.5, tracker=TRACKER),
        "accel_z": AxisStats(0.1, 0.02, 2, {}, unit=ACCEL_UNIT),
    },
    board=DeviceStatus(11, 12, 14, 15, 16, "user"),
    device="due",
)
