"""Plays cases in folders of their own; what breaks is a wrong row, not the end of the report."""

import tempfile
import traceback
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from tools.fault_script.stage import Skip
from tools.faults.row import Row

Case = Callable[[Path], Row]


def played(part: str, cases: Iterable[Case], words: list[str], at_once: int = 1) -> Iterator[Row]:
    """The rows of those cases whose names hold one of the words; of all if there are none.

    A case that lacks something on this machine is a row without records that says what: others need less.
    at_once: so many are played at a time; most of the time they wait.
    """
    chosen = [case for case in cases if not words or any(word in _name(case) for word in words)]
    with ThreadPoolExecutor(at_once) as pool:
        yield from pool.map(lambda case: _play(part, case), chosen)


def _play(part: str, case: Case) -> Row:
    with tempfile.TemporaryDirectory(prefix="fault-", ignore_cleanup_errors=True) as folder:
        try:
            return case(Path(folder))
        except Skip as why:
            return Row(part, _name(case), [], "records", 0, {}, f"not played: {why}", [])
        except (Exception, SystemExit):
            return Row(part, _name(case), [], "records", 0, {}, "", [traceback.format_exc()])


def _name(case: Case) -> str:
    return case.__name__.replace("_", " ")
