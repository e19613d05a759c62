"""Write a self-contained HTML page; all reports are made with it."""

from collections.abc import Iterable, Sequence
from html import escape
from itertools import chain, repeat
from pathlib import Path

from fltea.records.version import __version__

STYLE = Path(__file__).with_name("report.css")

MEANING = (
    'α and f mean something only where the verdict says so. "Undefined" is a result: the data do not tell '
    "one value from another."
)


def html_page(title: str, body: str, made_by: str, head: str = "") -> str:
    """Return the page.

    `body`, `made_by` and `head` are HTML, in which text from outside has already been escaped.
    """
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<style>{STYLE.read_text(encoding='utf-8')}</style>{head}</head><body><main><h1>{escape(title)}</h1>"
        f'<p class="faint">{MEANING}</p>{body}</main>'
        f"<footer><p>fltea {__version__}, {made_by}</p></footer></body></html>\n"
    )


def table(rows: Iterable[Sequence[str]], head: Sequence[str] = (), kinds: Sequence[str] = ()) -> str:
    """Return a table that scrolls by itself where it is too wide for the page; texts are escaped here.

    `kinds`: how the first columns look; further columns look plain. "th": the cells are labels of their rows;
    a label that begins with a space belongs to the row above. "word": each cell's text is also its CSS class.
    Any other kind is the CSS class (in report.css) of all cells of the column.
    """
    return table_of(("".join(map(_cell, row, chain(kinds, repeat("")))) for row in rows), head)


def table_of(lines: Iterable[str], head: Sequence[str] = ()) -> str:
    """Return a table whose cells are already HTML."""
    top = "".join(f"<th>{escape(text)}</th>" if text else "<td></td>" for text in head)
    body = "".join(f"<tr>{line}</tr>" for line in lines)
    thead = f"<thead><tr>{top}</tr></thead>" if top else ""
    return f'<div class="wide" tabindex="0"><table>{thead}<tbody>{body}</tbody></table></div>'


def _cell(text: str, kind: str) -> str:
    if kind == "th":
        of_row_above = ' class="sub"' if text.startswith(" ") else ""
        return f"<th{of_row_above}>{escape(text.strip())}</th>"
    name = text if kind == "word" else kind
    return f'<td class="{name}">{escape(text)}</td>' if name else f"<td>{escape(text)}</td>"
