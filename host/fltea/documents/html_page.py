"""What reports have in common: one HTML page that is complete in itself (pure)."""

from collections.abc import Sequence
from html import escape
from pathlib import Path

from fltea.records.version import __version__

STYLE = Path(__file__).with_name("report.css")

MEANING = (
    'α and f mean something only where the verdict says so. "Undefined" is a result: the data do not tell '
    "one value from another."
)


def html_page(title: str, body: str, made_by: str, head: str = "") -> str:
    """Return the page. body, made_by and head are HTML, in which foreign text is escaped already."""
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<style>{STYLE.read_text(encoding='utf-8')}</style>{head}</head><body><main><h1>{escape(title)}</h1>"
        f'<p class="faint">{MEANING}</p>{body}</main>'
        f"<footer><p>fltea {__version__}, {made_by}</p></footer></body></html>\n"
    )


def wide_table(head: str, lines: Sequence[str]) -> str:
    """Return a table that scrolls by itself where there is no room. head, lines: HTML of its rows."""
    return f'<div class="wide" tabindex="0"><table>{head}<tbody>{"".join(lines)}</tbody></table></div>'
