"""Writes the tables of host/docs/guide/files.md.

One table lists the formats that can be read, the other what known loggers write.

The tables come from formats.py and dialects.toml (read by dialects.py) in host/fltea/recording.
"""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from fltea.recording.dialects import dialects
from fltea.recording.formats import FORMATS, UNREAD, Format

from tools.generated import cell

SOURCE = "host/fltea/recording/formats.py and dialects.toml"
PAGE = "host/docs/guide/files.md"
MARKED = re.compile(r"(<!-- (\w+): written by make gen -->\n).*?(<!-- end -->\n)", re.DOTALL)


def outputs(root: Path) -> dict[str, str]:
    """Return the path and the text of the page, with new tables between their markers."""
    text = (root / PAGE).read_text(encoding="utf-8")
    tables = {"formats": formats(), "loggers": loggers()}
    return {PAGE: MARKED.sub(lambda found: f"{found[1]}\n{tables[found[2]]}\n{found[3]}", text)}


def formats() -> str:
    """Return the table of the formats that fltea reads and of those that have to be converted first."""
    read = (
        (f"{one.guide}{_endings(one.suffixes)}", f"`fltea identify {_example(one)}`", code(one.extra))
        for one in FORMATS.values()
    )
    turned = (
        (one.guide, f"`{one.command.format(path='FILE')}`, then what it writes", "")
        for one in UNREAD
        if one.guide
    )
    return table(("file", "command", "extra"), [*read, *turned])


def loggers() -> str:
    """Return the table of dialects (what a logger writes in a format)."""
    rows = []
    for one in dialects():
        name, options = next(iter(one.corpus.items()))
        command = f"`{f'fltea identify {name} {options}'.rstrip()}`"
        rows.append((one.guide, f"not read: {one.unread}" if one.unread else command, one.docs))
    return table(("logger", "command", "where its form is said"), rows)


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    lines = (f"| {' | '.join(map(cell, row))} |" for row in rows)
    return (
        "\n".join([f"| {' | '.join(head)} |", "|---" * len(head) + "|", *lines]).replace("|  |", "| |") + "\n"
    )


def code(text: str) -> str:
    """Return a word marked as code in Markdown; an empty text stays empty."""
    return text and f"`{text}`"


def _endings(suffixes: Sequence[str]) -> str:
    return "" if not suffixes else f" ({', '.join(map(code, suffixes))})"


def _example(form: Format) -> str:
    """Return an example: a file name with the format's ending, and options for reading the file.

    The options are those of the first file of this format in tests/recording/corpus.
    """
    name, options = next(iter(form.corpus.items()))
    is_like = not form.suffixes or name.endswith(form.suffixes)
    ending = name[name.index(".") :] if is_like else form.suffixes[0]
    return f"rest{ending} {options}".rstrip()
