"""Writes the site's tables of all settings from the settings' declarations."""

import html
import re

import msgspec
from fltea.settings.config import TABLES
from fltea.settings.setting import declared


def cell(text: str) -> str:
    """Return text as one cell of a table."""
    return re.sub(r"(?<!\\)\|", r"\\|", " ".join(text.split())).replace("<", "&lt;")


def code(text: str) -> str:
    """Return text as code in a cell of a table."""
    return (
        f"<code>{html.escape(text, quote=False).replace('|', '&#124;')}</code>"
        if "|" in text
        else f"`{text}`"
    )


def settings() -> str:
    """Return the tables of all settings, one for each table of the TOML file."""
    text: list[str] = []
    for path, table in TABLES.items():
        about = cell((type(table).__doc__ or "").split("\n\n")[0])
        text += ["", f"## [{path}]" if path else "## At the top of the file", ""]
        text += [about, "", "| setting | takes | default | meaning |", "|---|---|---|---|"]
        for one in declared(table, path):
            default = "unset" if one.default is None else msgspec.json.encode(one.default).decode()
            row = code(one.path), cell(one.takes), code(default), cell(one.setting.meaning)
            text.append(f"| {' | '.join(row)} |")
    return "\n".join(text)
