"""What is found out about the axes of a recording, or why nothing is."""

from dataclasses import dataclass, field

import msgspec

from fltea.identification.axis import AxisResult
from fltea.identification.curves import Curves
from fltea.identification.data_checks import DataCheck
from fltea.identification.data_sheet import SheetComparison, compare
from fltea.identification.forecast import Forecast, Now
from fltea.identification.forecast_judge import Learned
from fltea.identification.left_out import NOTHING, LeftOut
from fltea.identification.load import GYRO_UNIT, Loaded
from fltea.identification.navigation_filter import NavigationFilter
from fltea.identification.noise_model import AxisModel
from fltea.identification.reproduction import Reproduction
from fltea.identification.sensor_events import BiasCourse, BiasStep, MotionSpan
from fltea.identification.tracked_system import OffsetWalkFound
from fltea.records.errors import FlteaError
from fltea.spectrum.allan_curve import Allan


class Failure(msgspec.Struct, frozen=True):
    """The reason why there is no result."""

    error: str


class AxisReport(msgspec.Struct, frozen=True):
    """The results of one axis; allan and reproduction may be None for `allan_reason`.

    There are curves only if figures are wanted.
    """

    unit: str
    lsb: float | None
    result: AxisResult
    model: AxisModel
    allan: Allan | None
    reproduction: Reproduction | None
    allan_reason: str
    data_checks: tuple[DataCheck, ...]
    curves: Curves | None
    now: Now | None = None
    """The bias at the end of the recording."""
    forecast: Forecast | None = None
    sheet: SheetComparison | None = None
    """Only where a data sheet was named."""
    walk: OffsetWalkFound | None = None
    """Whether the offset walks."""
    filter: NavigationFilter | None = None
    """What a plain Kalman filter is built from."""
    tracked: Learned | None = None
    """The system that bias, forecast, filter and simulation are made of; None if no filter can work with the
    noise."""
    bias_steps: tuple[BiasStep, ...] = ()
    motion: tuple[MotionSpan, ...] = ()
    """of the sensor; samples in motion are in no other figure"""
    course: BiasCourse | None = None
    """The bias over time."""
    left_out: LeftOut = NOTHING
    """What the figures leave out."""
    withheld: str = ""
    """Why there is no `now`, forecast, comparison or file for other programs: what is bad, and what to do."""


@dataclass
class FileReport:
    """The results of one recording, or the failure why it could not be read."""

    name: str
    recording: Loaded | None = None
    failure: FlteaError | None = None
    axes: dict[str, AxisReport | Failure] = field(default_factory=dict)

    def compare_with(self, part: str) -> None:
        """Compare the axes of a gyroscope with the data sheet of `part`."""
        for name, axis in self.axes.items():
            if isinstance(axis, AxisReport) and axis.unit == GYRO_UNIT and self.recording is not None:
                if axis.withheld:
                    continue
                low_pass = self.recording.hello.gyro_dlpf_hz
                found = compare(part, axis.result.level, axis.result.rate_hz, axis.lsb, low_pass)
                self.axes[name] = msgspec.structs.replace(axis, sheet=found)
