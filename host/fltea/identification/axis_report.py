"""The results of a recording's axes, or the reason why there are no results."""

from dataclasses import dataclass, field

import msgspec

from fltea.identification.axis import AxisResult
from fltea.identification.curves import Curves
from fltea.identification.data_checks import DataCheck
from fltea.identification.data_sheet import SheetComparison, compare
from fltea.identification.forecast import Forecast, Now
from fltea.identification.forecast_judge import FittedSystem
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
    """The reason why there is no result for an axis or a recording."""

    error: str


# Why more than 12 attributes: each is one field of the published report.
class AxisReport(msgspec.Struct, frozen=True):
    """The results of one axis.

    If `allan` or `reproduction` is None, `allan_reason` says why.

    `curves` is None unless pictures are wanted.
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
    """The comparison with a data sheet; None unless a data sheet was named."""
    walk: OffsetWalkFound | None = None
    """The answer to the question whether the offset follows a random walk."""
    filter: NavigationFilter | None = None
    """The parameters of a plain Kalman filter for this axis."""
    tracked: FittedSystem | None = None
    """The state-space system from which bias, forecast, filter and simulation are computed.

    None if no Kalman filter works with the noise.
    """
    bias_steps: tuple[BiasStep, ...] = ()
    motion: tuple[MotionSpan, ...] = ()
    """Time spans in which the whole sensor moved. No figure of the noise uses samples of these spans."""
    course: BiasCourse | None = None
    """The bias over time."""
    left_out: LeftOut = NOTHING
    """Samples in motion and steps of the bias that the figures leave out."""
    withheld: str = ""


"""Why `now`, `forecast`, `sheet` and files for other programs are withheld.

    The text names the fault in the data and its remedy; it is empty if the data are good.
"""


@dataclass
class FileReport:
    """The results of one recording, or the reason why it could not be read."""

    name: str
    recording: Loaded | None = None
    failure: FlteaError | None = None
    axes: dict[str, AxisReport | Failure] = field(default_factory=dict)

    def compare_with(self, part: str) -> None:
        """Compare each gyroscope axis with the data sheet of `part`."""
        for name, axis in self.axes.items():
            if isinstance(axis, AxisReport) and axis.unit == GYRO_UNIT and self.recording is not None:
                if axis.withheld:
                    continue
                low_pass = self.recording.hello.gyro_dlpf_hz
                found = compare(part, axis.result.level, axis.result.rate_hz, axis.lsb, low_pass)
                self.axes[name] = msgspec.structs.replace(axis, sheet=found)
