"""Writes the table of error kinds in host/docs/reference/errors.md from host/fltea/records/kinds.py."""

from pathlib import Path

from fltea.records.kinds import ERROR_KINDS

SOURCE, README = "host/fltea/records/kinds.py", "host/docs/reference/errors.md"
HEAD = "| kind | what happened | what to do |\n|---|---|---|\n"


def table() -> str:
    """Return the rows, one a kind."""
    return "".join(f"| `{name}` | {kind.meaning} | {kind.remedy} |\n" for name, kind in ERROR_KINDS.items())


def outputs(root: Path) -> dict[str, str]:
    """Return the page with the table in place of the one that it has."""
    page = (root / README).read_text(encoding="utf-8")
    before, found, after = page.partition(HEAD)
    if not found:
        raise ValueError(f"{README} has no table that begins with {HEAD.splitlines()[0]!r}")
    rows = after[: after.index("\n\n") + 1]
    return {README: before + HEAD + table() + after[len(rows) :]}
