"""Show results as tables in a terminal."""

from collections.abc import Sequence

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from fltea.identification import comparison, findings
from fltea.identification.axis_report import AxisReport, Failure, FileReport
from fltea.identification.data_checks import DataCheck
from fltea.identification.forecast_tables import forecast_tables
from fltea.identification.lead import lead
from fltea.records.visible import visible_lines

COLOURS = {"bad": "bold red", "warning": "yellow", "note": "dim"}


def show(console: Console, report: FileReport, first: bool = True, *, details: bool = False) -> None:
    """Show one recording: verdicts, forecasts and data checks; with `details` also a table of all figures."""
    if not first:
        console.print()
    console.print(_shown(report.name, style="bold"), _shown(findings.heading(report)), soft_wrap=True)
    if report.failure is not None:
        console.print(_shown(str(report.failure), style="red"))
        return
    good = {name: axis for name, axis in report.axes.items() if isinstance(axis, AxisReport)}
    found = findings.data_checks(report)
    # Show the data checks that are marked bad before the verdict, since they would be overlooked after it.
    _data_checks(console, [one for one in found if one[1].severity == "bad"])
    for name, axis in report.axes.items():
        console.print(_verdict(name, axis))
    for name, axis in good.items():
        if axis.forecast is not None:
            _forecast(console, name, axis, axis.forecast.text)
    for line in findings.sheets(good):
        console.print(_shown(line))
    if details:
        for question, answer in findings.reading(report):
            console.print(_shown(f"{question}: {answer}"))
        _details(console, good)
    for line in dict.fromkeys(axis.allan_reason for axis in good.values() if axis.allan_reason):
        console.print(_shown(f"{line[0].upper()}{line[1:].removesuffix('.')}."))
    _data_checks(console, [one for one in found if one[1].severity != "bad"])
    for doubt in findings.doubts(report):
        console.print(_shown(doubt))


def _data_checks(console: Console, data_checks: Sequence[tuple[str, DataCheck]]) -> None:
    for where, data_check in data_checks:
        text = _shown(f"{data_check.severity}: ", style=COLOURS[data_check.severity])
        plain = "default not dim not bold"
        text.append_text(_shown(f"{where}: " if where else "", style=plain))
        text.append_text(_shown(f"{data_check.text} {data_check.remedy}", style=plain))
        console.print(text)


def _details(console: Console, good: dict[str, AxisReport]) -> None:
    for axes in findings.by_sensor(good):
        table = Table("", *axes, box=box.SIMPLE_HEAD, pad_edge=False)
        for label, values in findings.side_by_side(axes):
            table.add_row(*(_shown(text) for text in (label, *values)))
        console.print(table)
    if good:
        for line in dict.fromkeys(findings.method(axis.result) for axis in good.values()):
            console.print(_shown(f"{line}."))
        for line in findings.remarks(good):
            console.print(_shown(line))


def _forecast(console: Console, name: str, axis: AxisReport, text: str) -> None:
    console.print(_shown(f"{name}, forecast: {text}"))
    for headings, rows in forecast_tables(axis):
        table = Table(*headings, box=box.SIMPLE_HEAD, pad_edge=False)
        for row in rows:
            table.add_row(*map(_shown, row))
        console.print(table)


def _verdict(name: str, axis: AxisReport | Failure) -> Text:
    if isinstance(axis, Failure):
        return _shown(f"{name}: {axis.error}", style="red")
    text = _shown(f"{name}: {lead(axis)}", style="bold")
    return text.append(f"\n  {visible_lines(axis.result.verdict.text)}", style="not bold")


def summary(console: Console, reports: Sequence[FileReport]) -> None:
    """Show the figures of all recordings side by side, in a table for each axis, and their differences."""
    for name, headings, lines in comparison.rows(reports):
        table = Table(box=box.SIMPLE_HEAD, pad_edge=False, title_justify="left")
        table.title = _shown(name, style="bold")
        for heading in headings:
            table.add_column(_shown(heading), overflow="fold")
        for line in lines:
            table.add_row(*map(_shown, line))
        console.print(table)
    for text in comparison.said(reports):
        console.print(_shown(text))


def _shown(text: str, style: str = "") -> Text:
    """Return text from files in a form in which no control character reaches the terminal."""
    return Text(visible_lines(text), style=style)
