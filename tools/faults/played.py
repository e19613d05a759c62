"""Plays cases in folders of their own; what breaks is a wrong row, not the end of the report."""

import tempfile
import traceback
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from tools.fault_script.stage import Skip
from tools.faults.row import Row


def played(part: str, cases: Iterable[Callable[[Path], Row]], words: list[str]) -> Iterator[Row]:
    """The rows of those cases whose names hold one of the words; of all if there are none.

    A case that lacks something on this machine is a row without records that says what: others need less.
    """
    for case in cases:
        name = case.__name__.replace("_", " ")
        if words and not any(word in name for word in words):
            continue
        with tempfile.TemporaryDirectory(prefix="fault-", ignore_cleanup_errors=True) as folder:
            try:
                yield case(Path(folder))
            except Skip as why:
                yield Row(part, name, [], "records", 0, {}, f"not played: {why}", [])
            except (Exception, SystemExit):
                yield Row(part, name, [], "records", 0, {}, "", [traceback.format_exc()])
