"""List all published figures, and the numeric fields of records that no output shows, with the reasons."""

from collections.abc import Iterator

from fltea.records.device_fit import DeviceAxisFit
from fltea.records.estimate import AxisEstimate, DeviceAxisEstimate
from fltea.records.fit import AxisFit
from fltea.records.records import (
    Corrected,
    DeviceEstimates,
    Epoch,
    Error,
    Gap,
    Hello,
    Motion,
    Placed,
    Sample,
    Stats,
    Step,
)
from fltea.records.stats import AxisStats, DeviceEstimatorStats
from fltea.sinks.figures import of_axis, of_device, of_filters, of_fit, of_link
from fltea.sinks.figures.figure import Cells, Figure, Row, Rows, Section, Seen, lookup

FIGURES: tuple[Figure, ...] = tuple(
    figure for module in (of_link, of_fit, of_axis, of_filters, of_device) for figure in module.FIGURES
)
"""All published figures, in the order of the page's rows and of Home Assistant's entities."""

EVENT = "the record reports an event, which people see as a sentence"
_OF_MODEL = "people who compare the device's fit with this computer's read the record itself"
_SAME_FIT = "the newest fit has the same number in a record of its own"

WITHOUT_FIGURES: dict[type, str] = {
    Placed: "the numbers only say to which sample a record belongs",
    Hello: "it says once what the device is; the page shows all, and `fltea_device_info` the identity",
    Corrected: "the record is for programs that integrate every sample",
    Gap: EVENT,
    Step: EVENT,
    Motion: EVENT,
    Epoch: EVENT,
    Error: EVENT,
}
"""Types of records whose numbers are not published as figures, each with the reason."""

UNSHOWN: dict[tuple[type, str], str] = {
    (Stats, "fit_period_s"): "the number is a setting, which only says how often a fit comes",
    (Sample, "flags"): "the number is a property of one sample, and one sample in a thousand says nothing",
    (AxisStats, "Q_in_use"): "it is computed from the newest fit",
    (AxisStats, "tuned"): "it only says whether a fit found an order, with which the filters were tuned",
    (AxisStats, "tracker.K"): "the value of the fit, with its verdict, is shown; this value is for checks",
    (DeviceEstimatorStats, "fit_every"): "it is a setting of the device",
    (DeviceEstimatorStats, "longest_slice_us"): "longest_axis_seconds limits it while the device keeps up",
    (AxisEstimate, "alpha"): _SAME_FIT,
    (AxisEstimate, "f"): _SAME_FIT,
    (AxisEstimate, "innovation"): "it changes with every sample, so one value in a thousand says nothing",
    (DeviceEstimates, "comparable"): "each axis says whether it is comparable, and why not",
    (DeviceAxisEstimate, "age"): "the number is for the comparison with this computer's estimate",
    (DeviceAxisEstimate, "fltea.alpha_std"): "this computer's, which it should equal, is shown",
    (DeviceAxisEstimate, "fltea.f_std"): "this computer's, which it should equal, is shown",
    (DeviceAxisEstimate, "fltea.state"): "its difference from this computer's is shown",
    (DeviceAxisEstimate, "fltea.innovation"): "it changes with every sample",
    (DeviceAxisEstimate, "fltea.settled"): "the words that say why estimates are not comparable say it",
    (DeviceAxisEstimate, "tracker_state"): "the device's bias, which includes it, is shown",
    (DeviceAxisEstimate, "tracker_state_std"): "the deviation of the device's bias is shown",
    (AxisFit, "low_pass"): "the text of the verdict says it",
    (AxisFit, "high_pass"): "the text of the verdict says it",
    **{
        (DeviceAxisFit, field): _OF_MODEL
        for field in (
            "number", "age", "ordinates", "evaluations", "searched", "tuned", "ratio_white",
            "ratio_relaxation", "f", "s2", "R", "alpha_of_bins",
        )
    },
}  # fmt: skip
"""Numbers that no place shows. The key holds the type of a record, or of a part of a record, and the path to
the number. The value is the reason why it is not shown.
"""


def rows(section: Section, seen: Seen) -> Iterator[Cells]:
    """Yield the rows of a section of the live page. `seen`: the records to show."""
    for figure in FIGURES:
        match figure.page:
            case Row() as row if row.section == section:
                value = lookup(seen.record(figure.kind), figure.field)
                if value is not None:
                    yield [row.label, row.text(value), row.level(value)]
                elif row.absent is not None:
                    yield [row.label, row.absent, "plain"]
            case Rows() as own if own.section == section:
                yield from own.make(seen)
