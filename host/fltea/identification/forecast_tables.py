"""Make tables of the predicted and the observed standard deviations of heading and bias."""

from fltea.identification.axis_report import AxisReport
from fltea.identification.forecast import angle

FORECAST_HEADINGS = ("heading after", "predicted", "seen", "within 95 %", "pieces", "")
BIAS_HEADINGS = ("σ", "N/√T", "predicted", "seen", "within 95 %", "pieces", "")


def forecast_rows(axis: AxisReport) -> list[tuple[str, ...]]:
    """Return the predicted and the observed error of the heading for each time, as rows of a table.

    The column headings of the table are `FORECAST_HEADINGS`.
    """
    if axis.forecast is None:
        return []
    return [
        (
            f"{one.t_s:g} s",
            angle(one.said, axis.unit),
            angle(one.seen, axis.unit),
            f"{100 * one.within:.0f} %",
            f"{one.pieces}",
            "fails" if one.fails else "holds",
        )
        for one in axis.forecast.judged
    ]


def bias_rows(axis: AxisReport) -> list[tuple[str, ...]]:
    """Return the predicted and the observed error of Bias(T) for each time, as rows of a table.

    The column headings of the table are `BIAS_HEADINGS`. Values are in the unit of the axis.
    """
    if axis.forecast is None:
        return []
    return [
        (
            f"{one.t_s:g} s",
            *(f"{std:.2g}" for std in (one.bias_std, one.noise_std, one.said, one.seen)),
            f"{100 * one.within:.0f} %",
            f"{one.pieces}",
            "fails" if one.fails else "holds",
        )
        for one in axis.forecast.bias
    ]


def forecast_tables(axis: AxisReport) -> list[tuple[tuple[str, ...], list[tuple[str, ...]]]]:
    """Return headings and rows of the tables on heading and bias, without empty tables."""
    of_bias = (f"Bias in {axis.unit}, for", *BIAS_HEADINGS)
    tables = (FORECAST_HEADINGS, forecast_rows(axis)), (of_bias, bias_rows(axis))
    return [(headings, rows) for headings, rows in tables if rows]
