"""Write a report on identified recordings: one self-contained HTML page, and its pictures as SVG.

Verdicts, N, B and K, and the pictures of the noise are visible at once. Reasons, FLTEA and the rest stand in
sections that a click opens.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from html import escape
from pathlib import Path

from fltea.documents.html_page import html_page, table, table_of
from fltea.identification import comparison, figures, findings
from fltea.identification.axis_report import AxisReport, FileReport
from fltea.identification.forecast_tables import forecast_tables
from fltea.identification.lead import lead
from fltea.records.whole_file import whole_file

PAGE = "report.html"
WITHHELD = "No forecast, comparison with a data sheet or file for another program is made from bad data."


def write(folder: Path, reports: Sequence[FileReport]) -> list[Path]:
    """Write the page of the report and its pictures; return the files, the page first.

    Nothing is written if no axis of any recording was identified.

    Raises:
        FlteaError: a file cannot be written.
    """
    if not any(isinstance(axis, AxisReport) for report in reports for axis in report.axes.values()):
        return []
    written: list[Path] = []
    sections = []
    for report, prefix in zip(reports, _prefixes(reports), strict=True):
        pictures: dict[str, dict[str, str]] = {}
        for name, axis in report.axes.items():
            if isinstance(axis, AxisReport) and axis.curves is not None:
                pictures[name] = figures.draw(name, axis)
        for name, drawn in pictures.items():
            for kind, svg in drawn.items():
                written.append(folder / f"{prefix}_{name}_{kind}.svg")
                with whole_file(written[-1]) as file:
                    file.write(svg.encode())
        sections.append("".join(_section(report, pictures)))
    page = folder / PAGE
    with whole_file(page) as file:
        file.write(_page(reports, sections).encode())
    return [page, *written]


def _prefixes(reports: Sequence[FileReport]) -> list[str]:
    """Return for each recording how the names of its files begin; equal beginnings get a number."""
    found: list[str] = []
    for report in reports:
        stem = re.sub(r"[^A-Za-z0-9_.-]+", "_", Path(report.name).stem).strip("._") or "recording"
        name, number = stem, 2
        while name in found:
            name, number = f"{stem}-{number}", number + 1
        found.append(name)
    return found


def _page(reports: Sequence[FileReport], sections: list[str]) -> str:
    title = "Noise identified" + (f": {Path(reports[0].name).name}" if len(reports) == 1 else "")
    summary = _summary(reports) if len(reports) > 1 else ""
    return html_page(title, summary + "".join(sections), "<code>fltea identify --report</code>")


def _summary(reports: Sequence[FileReport]) -> str:
    """Return the figures of all recordings side by side, with failures and differences as sentences."""
    failed = [
        f'<p class="bad">{escape(Path(report.name).name)}: {escape(str(report.failure))}</p>'
        for report in reports
        if report.failure is not None
    ]
    tables = []
    for name, headings, lines in comparison.rows(reports):
        cells = ["".join(f"<td>{escape(text.strip())}</td>" for text in line) for line in lines]
        tables.append(f"<h3>{escape(name)}</h3>{table_of(cells, headings)}")
    sentences = [f"<p>{escape(text)}</p>" for text in comparison.said(reports)]
    return "".join([*failed, *tables, *sentences])


def _section(report: FileReport, pictures: dict[str, dict[str, str]]) -> Iterator[str]:
    yield f'<section><h2>{escape(report.name)}</h2><p class="faint">{escape(findings.heading(report))}</p>'
    if report.failure is not None:
        yield f'<p class="bad">{escape(str(report.failure))}</p></section>'
        return
    good = {name: axis for name, axis in report.axes.items() if isinstance(axis, AxisReport)}
    for axes, data_check in findings.data_checks(report):
        if data_check.severity == "bad":
            said = escape(f"{axes}{axes and ': '}{data_check.text} {data_check.remedy}")
            yield f'<p class="verdict bad">{said} {WITHHELD}</p>'
    for name, axis in report.axes.items():
        if isinstance(axis, AxisReport):
            text = escape(axis.result.verdict.text)
            yield f'<p class="verdict"><b>{name}: {escape(lead(axis))}.</b> {text}</p>'
        else:
            yield f'<p class="verdict"><b>{name}</b>: <span class="bad">{escape(axis.error)}</span></p>'
    for axes_of_one in findings.by_sensor(good):
        yield _table(axes_of_one, findings.level_rows)
    yield from _sentences(findings.sheets(good))
    yield _data_checks(report)
    if good:
        tables = [_table(axes_of_one, findings.rows) for axes_of_one in findings.by_sensor(good)]
        yield _folded("All figures", [*tables, *_sentences(findings.remarks(good))])
    if answers := findings.reading(report):
        yield _folded("How the file was read", [table(answers, kinds=("word", "text"))])
    for name, axis in good.items():
        yield from _axis(name, axis, pictures.get(name, {}))
    yield "</section>"


def _axis(name: str, axis: AxisReport, drawn: dict[str, str]) -> Iterator[str]:
    """Yield the pictures of the noise with their meaning, then sections that a click opens.

    These sections tell the reasons for verdict and forecast, and what FLTEA estimates.
    """
    yield f'<h3 class="axis">{name}</h3>'
    if axis.forecast is not None:
        yield f"<p>{escape(axis.forecast.text)}</p>"
    yield _figures(axis, drawn, figures.SEEN)
    rows = (
        (rule.question, "yes" if rule.answer else "no", rule.figure) for rule in axis.result.verdict.rules
    )
    why = [table(rows, kinds=("text", "", "text"))]
    if axis.reproduction is not None:
        why += _sentences([axis.reproduction.text])
    yield _folded("How the verdict came about", [*why, _figures(axis, drawn, figures.WHY)])
    if tables := [table(rows, headings) for headings, rows in forecast_tables(axis)]:
        yield _folded("How the forecast was judged", tables)
    settings = f'<p class="faint">{escape(findings.settings(axis))}</p>'
    yield _folded("FLTEA", [settings, _figures(axis, drawn, figures.FLTEA)])


def _figures(axis: AxisReport, drawn: dict[str, str], kinds: Sequence[str]) -> str:
    """Return the pictures of the given kinds as HTML, except kinds that were not drawn."""
    found = [
        f"<figure>{drawn[kind]}<figcaption><b>{escape(figures.TITLES[kind][0])}.</b> "
        f"{escape(figures.meaning(kind, axis))}</figcaption></figure>"
        for kind in kinds
        if kind in drawn
    ]
    return f'<div class="figures">{"".join(found)}</div>' if found else ""


def _folded(title: str, parts: Iterable[str]) -> str:
    return f"<details><summary>{title}</summary>{''.join(parts)}</details>"


def _sentences(those: Iterable[str]) -> list[str]:
    return [f"<p>{escape(text)}</p>" for text in those]


def _table(axes: dict[str, AxisReport], rows_of: Callable[[AxisReport], list[findings.Row]]) -> str:
    rows = ([label, *values] for label, values in findings.side_by_side(axes, rows_of))
    return table(rows, ["", *axes], ["th"])


def _data_checks(report: FileReport) -> str:
    rows: list[Sequence[str]] = []
    rows += [
        (data_check.severity, axes or "all", data_check.text, data_check.remedy)
        for axes, data_check in findings.data_checks(report)
    ]
    rows += [("", "", text) for text in findings.doubts(report)]
    return "<h3>Data checks</h3>" + table(rows, kinds=("word", "", "text", "text")) if rows else ""
