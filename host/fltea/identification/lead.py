"""Compose the first line of text on an axis: what its noise is, and the figures that most people want."""

from fltea.identification.axis_report import AxisReport
from fltea.identification.forecast import Now, integral, is_any_heading
from fltea.identification.load import GYRO_UNIT
from fltea.identification.quantities import quantities
from fltea.records.fit import Interval
from fltea.records.plus_minus import plus_minus, within
from fltea.records.quantity import shown_units
from fltea.records.units import HEADING_AFTER_S

UNDEFINED = "undefined"


def lead(axis: AxisReport) -> str:
    """Return a line of text with verdict, order if there is one, N, K, B, bias at the end, and heading.

    A figure that has neither a value nor a bound is left out.
    """
    r = axis.result
    found: list[str] = [r.verdict.kind]
    if r.order.alpha.value is not None:
        found += [f"α {interval(r.order.alpha)}", f"f {interval(r.order.f)}"]
    found += _level(axis)
    if axis.now is not None:
        found += _bias(axis.now, axis.unit, walks=r.level.K.value is not None)
    return " · ".join(found)


def _level(axis: AxisReport) -> list[str]:
    """Return N, K and B in the units of data sheets, each as a value or an upper bound."""
    known = quantities(axis.unit, axis.result.level, axis.allan, axis.now)
    units = shown_units(axis.unit)
    figures = (("N", known.N, units.N), ("K", known.K, units.K), ("B", known.B, units.B))
    return [
        f"{name} {figure.to(unit)}"
        for name, figure, unit in figures
        if figure.value is not None or figure.at_most is not None
    ]


def _bias(now: Now, unit: str, *, walks: bool) -> list[str]:
    """Return the bias, and the error of the heading that results from it.

    `walks`: whether the offset follows a random walk. If so, the bias is marked as that "at the end" of the
    recording.
    """
    end = f"({now.bias_s:g} s)" + (" at the end" if walks else "")
    if is_any_heading(now.heading_std, unit):
        ahead = "no heading left"
    else:
        what = "heading" if unit == GYRO_UNIT else "integral"
        ahead = f"{what} {within(now.heading_std, integral(unit))}"
    return [f"Bias{end} {plus_minus(now.bias, now.bias_std)} {unit}", f"{ahead} after {HEADING_AFTER_S} s"]


def interval(one: Interval) -> str:
    """Format a value with the ends of its interval; a value that is not known is called undefined."""
    if one.value is None or one.low is None or one.high is None:
        return UNDEFINED
    return f"{_number(one.value)} ({_number(one.low)}…{_number(one.high)})"


def _number(value: float) -> str:
    """Format a number with two or three significant digits; a number below a thousandth becomes 0."""
    return "0" if abs(value) < 5e-4 else f"{value:.2f}" if abs(value) < 10 else f"{value:.3g}"
