"""Every fault that a daemon has to survive, played on the real program: what was lost, and was it counted?

    python -m tools.fault_script               a table
    python -m tools.fault_script clock disk    only faults with these words in their names
    python -m tools.fault_script --short       as the tests play them: seconds in place of minutes
    python -m tools.fault_script --markdown    for host/docs/guide/running.md
    python -m tools.fault_script --json

The board, on a pseudo-terminal, knows every sample that it sent, and the daemon's counts have to agree with
it. Exit code 1: they do not, or a fault did what it should not.
"""

import argparse
import json
import sys

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from tools.fault_script.cases import CASES, Case, play_all
from tools.fault_script.report import HEADS, cells, markdown
from tools.fault_script.stage import Outcome, Skip

WIDTH = 150
"""Of the table at least: narrower columns cannot be read."""


def main() -> int:
    """Run the command line; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.fault_script",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("only", nargs="*", metavar="NAME", help="a word of a fault's name")
    parser.add_argument("--short", action="store_true", help="seconds in place of minutes")
    parser.add_argument("--at-once", type=int, default=2, metavar="N", help="so many at a time (default 2)")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--markdown", action="store_true", help="print a table in Markdown")
    options = parser.parse_args()
    cases = [case for case in CASES if not options.only or any(word in case.name for word in options.only)]
    if not cases:
        parser.error("no such fault; there are: " + "; ".join(case.name for case in CASES))
    rows = _play(cases, short=options.short, at_once=options.at_once)
    if options.json:
        print(json.dumps([{"fault": case.name, **_plain(outcome)} for case, outcome in rows], indent=2))
    elif options.markdown:
        print("\n".join(markdown(rows)))
    else:
        _print_table(rows)
    wrong = [(case.name, text) for case, outcome in rows for text in outcome.wrong]
    for name, text in wrong:
        print(f"{name}: {text}", file=sys.stderr)
    return 1 if wrong or any(outcome.account.uncounted for _, outcome in rows) else 0


def _play(cases: list[Case], *, short: bool, at_once: int) -> list[tuple[Case, Outcome]]:
    rows = []
    playing = play_all(cases, short=short, at_once=at_once)
    for case in cases:
        try:
            rows.append((case, playing[case.name].result()))
            print(f"{case.name}: done", file=sys.stderr)
        except Skip as why:
            print(f"{case.name}: left out: {why}", file=sys.stderr)
    return rows


def _plain(outcome: Outcome) -> dict[str, object]:
    return {**outcome._asdict(), "account": outcome.account._asdict()}


def _print_table(rows: list[tuple[Case, Outcome]]) -> None:
    table = Table(show_lines=True)
    for head in HEADS:
        table.add_column(head, overflow="fold")
    for case, outcome in rows:
        table.add_row(*map(escape, cells(case, outcome)))
    Console(width=max(WIDTH, Console().width)).print(table)


if __name__ == "__main__":
    sys.exit(main())
