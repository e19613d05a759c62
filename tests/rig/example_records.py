"""Records in which every field has a distinct value, for the tests of outputs."""

from typing import Any

from fltea.records.estimate import AxisEstimate, FlteaEstimate
from fltea.records.fit import Interval
from fltea.records.records import ACCEL_UNIT, GYRO_UNIT, Motion, Stats, Step
from fltea.records.stats import AxisStats, BiasCheck, DeviceStatus, LinkStats, SampleStats, TrackerStats

OF_FILTERS = "alpha", "alpha_std", "f", "f_std", "state", "innovation", "valid", "settled"


def axis_estimate(*of_filters: Any, unit: str = GYRO_UNIT, **known: Any) -> AxisEstimate:
    """Return an example of an estimate of one axis.

    `of_filters`: values that the filters estimate, in the order of `OF_FILTERS`. `known`: values of other
    fields.
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
    fltea = FlteaEstimate(**dict(zip(OF_FILTERS, of_filters, strict=False)))
    return AxisEstimate(**(given | known), unit=unit, fltea=fltea)


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
    checked={1: BiasCheck(pieces=310, rms=1.04), 10: BiasCheck(pieces=31, rms=0.93)},
    bias_for_s=2.5,
)
STEP = Step(
    seq=700,
    epoch=3,
    device_us=7_000_000,
    host_ns=7_000_000_000,
    axis="gyro_x",
    unit=GYRO_UNIT,
    size=0.1037,
    size_std=0.0112,
    found_after=31,
    device="due",
)
MOVES = Motion(
    seq=800,
    epoch=3,
    device_us=8_000_000,
    host_ns=8_000_000_000,
    begins=True,
    by="accel",
    samples=None,
    largest=None,
    device="due",
)
RESTS = Motion(
    seq=1000,
    epoch=3,
    device_us=10_000_000,
    host_ns=10_000_000_000,
    begins=False,
    by="accel",
    samples=200,
    largest=12.34,
    device="due",
)
STATS = Stats(
    epoch=3,
    host_ns=9_500_000_000,
    rate_hz=99.5,
    clock_ppm=-62.5,
    startup_remaining=123,
    link=LinkStats(
        bytes=51,
        frames=41,
        bad_frames={"crc": 2, "cobs": 3},
        unknown_type=4,
        refused=6,
        overflow_bytes=7,
        reconnects=1,
    ),
    sample_counts=SampleStats(delivered=1234, lost=56, gaps=70, duplicates=8, before_hello=9, rate_differs=3),
    axes={
        "gyro_x": AxisStats(
            bias=0.1,
            R_in_use=0.02,
            restarts=5,
            interventions={"order_box": 13, "held": 1},
            innovation_lag1=0.25,
            innovation_nis=1.5,
            tracker=TRACKER,
        ),
        "accel_z": AxisStats(bias=0.1, R_in_use=0.02, restarts=2, interventions={}, unit=ACCEL_UNIT),
    },
    board=DeviceStatus(
        i2c_errors=11,
        bus_recoveries=12,
        sensor_reinits=14,
        overruns=15,
        dropped_frames=16,
        reset_cause="user",
    ),
    device="due",
)
