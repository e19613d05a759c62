"""Functions that MkDocs calls in `make docs`.

These functions insert the parts of pages that are generated from the code, and write equations as MathML.

A line such as `<!-- generated: settings -->` in a page is replaced by a generated part.
"""

import html
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import latex2mathml.converter
from fltea.records.kinds import ERROR_KINDS
from fltea.sinks.figures.table import FIGURES
from fltea.sinks.metrics.families import Families
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files

from tools.gen_protocol import tables
from tools.site_chips import chips
from tools.site_outputs import outputs
from tools.site_records import records, schema
from tools.site_settings import cell, code, settings

EQUATION = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)
GENERATED = re.compile(r"^<!-- generated: (\w+) -->$", re.MULTILINE)


def commands() -> str:
    """Return a section for each command with all its options, as Typer writes it.

    Two parts of Typer's page are left out: the title, and the list of commands, in which Typer cuts off the
    summaries.
    """
    write = [sys.executable, "-m", "typer", "fltea.cli.app", "utils", "docs", "--name", "fltea"]
    page = subprocess.run(write, check=True, capture_output=True, encoding="utf-8").stdout
    return re.sub(r"^# .*\n|^\*\*Commands\*\*:\n(?:\n|\* .*\n)+", "", page, flags=re.MULTILINE)


def metrics() -> str:
    """Return a table of all metrics.

    For each metric, the table has the labels, the field of the records that the metric shows, and other
    outputs that show this field.
    """
    by_name = {figure.metric_name: figure for figure in FIGURES}
    rows = []
    for family in Families({}, {}, list).collect():
        name = family.name + {"counter": "_total", "info": "_info"}.get(family.type, "")
        labels = ", ".join(code(label) for label in getattr(family, "_labelnames", ()))
        figure = by_name.get(name)
        field, places = (code(figure.path), ", ".join(figure.places)) if figure else ("", "")
        words = cell(family.documentation)
        rows.append(f"| {code(name)} | {family.type} | {labels} | {words} | {field} | {places} |")
    head = "| metric | kind | labels | what | field of the records | seen also in |"
    return "\n".join([head, "|---|---|---|---|---|---|", *rows])


def errors() -> str:
    """Return a table of all kinds of errors, with the remedy for each."""
    rows = (f"| {code(name)} | {kind.meaning} | {kind.remedy} |" for name, kind in ERROR_KINDS.items())
    return "\n".join(["| kind | what happened | what to do |", "|---|---|---|", *rows])


def messages() -> str:
    """Return a table of bytes for each message of the protocol."""
    return tables(Path(__file__).parents[1])


PARTS: dict[str, Callable[[], str]] = {
    "chips": chips,
    "commands": commands,
    "errors": errors,
    "messages": messages,
    "outputs": outputs,
    "records": records,
    "settings": settings,
    "metrics": metrics,
}


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the JSON schema of the records to the site."""
    files.append(File.generated(config, "reference/records.schema.json", content=schema()))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Insert the generated parts into a page."""
    return GENERATED.sub(_part, markdown)


def _part(asked: re.Match[str]) -> str:
    if asked[1] not in PARTS:
        raise PluginError(f"there is no generated part '{asked[1]}'; there are: {', '.join(PARTS)}")
    return PARTS[asked[1]]()


def on_page_content(content: str, **_: Any) -> str:
    r"""Replace \(…\) and \[…\] by MathML, and let keys scroll the tables.

    Browsers draw MathML without a script.
    """
    content = re.sub(r"<th( style=\"[^\"]*\")?></th>", "<td></td>", content)
    return EQUATION.sub(_mathml, content).replace("<table>", '<table tabindex="0">')


def on_post_page(output: str, **_: Any) -> str:
    """Give the search dialog a name for screen readers, which the theme has left out."""
    return output.replace('role="dialog"', 'role="dialog" aria-label="Search"')


def _mathml(match: re.Match[str]) -> str:
    display = "block" if match[1] == "div" else "inline"
    equation: str = latex2mathml.converter.convert(html.unescape(match[2]).strip(), display=display)
    return f"<div class='equation' tabindex='0'>{equation}</div>" if display == "block" else equation
