"""Records that the tests of outputs write."""

import msgspec
from fltea.records.estimate import AxisEstimate
from fltea.records.records import Epoch, Error, Estimate, EstimatorInfo, Fit

from tests.rig import example_records
from tests.rig.example_records import GOOD, INVALID
from tests.rig.fit_support import FRACTIONAL, UNDECIDED, WHITE
from tests.rig.host_support import hello

HELLO = hello(
    source="serial:/dev/ttyACM0", sensor="MPU-9250", gyro_range_dps=2000.0, firmware_version="0.1.0"
)
EPOCH = Epoch(
    3,
    "gap",
    700,
    7_000_000,
    7,
    8,
    EstimatorInfo("triple", "host", "direct", "off", 3000, 500, (), ()),
)
STATS, STEP, MOVES, RESTS = (
    msgspec.structs.replace(one, device=None)
    for one in (example_records.STATS, example_records.STEP, example_records.MOVES, example_records.RESTS)
)
ERROR = Error("silent", "nothing [bold]came[/bold] for [5 s]", 1)


def estimate(host_ns: int = 0, **axes: AxisEstimate) -> Estimate:
    return Estimate(701, 3, 7_010_000, host_ns, "triple", axes or {"gyro_x": GOOD, "gyro_y": INVALID})


FIT = Fit(701, 3, 7_010_000, 0, 702, {"gyro_x": FRACTIONAL, "gyro_y": UNDECIDED, "gyro_z": WHITE})
