"""Make the part of the live table about the estimates that a device makes itself."""

from collections.abc import Mapping

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from fltea.records.device_fit import DeviceAxisFit
from fltea.records.estimate import WhyNot
from fltea.records.plus_minus import plus_minus
from fltea.records.records import DeviceEstimates
from fltea.records.why_not import not_comparable
from fltea.sinks.page.answer import figure_of
from fltea.sinks.words import apart, in_deviations, quantity, signed


def grid(*titles: RenderableType) -> Table:
    """Return a table with `titles` as its first row, and without lines between the rows."""
    rows = Table.grid(padding=(0, 2))
    rows.add_row(*titles)
    return rows


def estimates(record: DeviceEstimates) -> list[RenderableType]:
    """Return the device's estimates and biases.

    Where they can be compared with this computer's, return also the differences.
    """
    return [_orders(record), *_not_compared(record), *_biases(record)]


def _orders(record: DeviceEstimates) -> Table:
    """Return a table with the device's α and f, and their differences from this computer's α and f.

    The compared estimates are those after the same sample.
    """
    rows = grid("", "device's α", "minus the host's", "device's f", "minus the host's")
    for name, axis in record.axes.items():
        if not axis.fltea.valid:
            rows.add_row(name, "not valid")
            continue
        alpha, f = (_difference(d) for d in (axis.alpha_difference, axis.f_difference))
        rows.add_row(name, quantity(axis.fltea.alpha, "", 3), alpha, quantity(axis.fltea.f, "", 3), f)
    return rows


def _biases(record: DeviceEstimates) -> list[RenderableType]:
    """Return a table with the biases by the device's own fit, and their differences from this computer's."""
    rows = grid("", "device's bias", "minus the host's", "")
    for name, axis in record.axes.items():
        if axis.tracker_bias is not None:
            difference, std = axis.tracker_bias_difference, axis.tracker_bias_std
            bias = plus_minus(axis.tracker_bias, std)
            rows.add_row(name, bias, _difference(difference), in_deviations(difference, std))
    return [rows] if rows.row_count > 1 else []


def fits(by_axis: Mapping[str, DeviceAxisFit]) -> Table:
    """Return a table with the device's own fits.

    It also has the difference of their α from that of this computer's fits.
    """
    rows = grid("", "device's fit", "α, 95 %", "minus the host's", "in half-widths")
    for name, fit in by_axis.items():
        order = figure_of(fit.alpha)
        halves = "" if fit.half_widths is None else f"{fit.half_widths:+.2f}"
        difference = "" if fit.alpha_difference is None else signed(fit.alpha_difference)
        alpha = order.text if order else "undefined"
        rows.add_row(name, f"{fit.verdict}, {fit.samples:,} samples", alpha, difference, halves)
    return rows


def _not_compared(record: DeviceEstimates) -> list[RenderableType]:
    """Return lines of text that say why the device's estimates are not compared with this computer's.

    There is one line for each reason. It names the axes to which the reason applies.
    """
    axes: dict[WhyNot, list[str]] = {}
    for name, axis in record.axes.items():
        if axis.fltea.valid and axis.why_not is not None:
            axes.setdefault(axis.why_not, []).append(name)
    return [Text(f"{', '.join(names)}: {not_comparable(why)}") for why, names in axes.items()]


def _difference(value: float | None) -> str:
    return "" if value is None else apart(value)
