"""Each kind of verdict is listed where people and programs look for it. A missing one is named with its file.

tests/records/test_records.py checks the text of the field `FittedAxis.verdict`.
"""

import re
from typing import get_args

from fltea.records.verdict_kinds import VERDICT_KINDS, VerdictKind

from tests.rig.host_support import ROOT

GUIDE = "host/docs/guide/verdict.md"


def test_each_word_has_a_row_in_the_table() -> None:
    missing = set(get_args(VerdictKind)) - VERDICT_KINDS.keys()
    assert not missing, f"VERDICT_KINDS of host/fltea/records/verdict_kinds.py lacks {missing}"
    unknown = VERDICT_KINDS.keys() - set(get_args(VerdictKind))
    assert not unknown, f"VerdictKind of host/fltea/records/verdict_kinds.py lacks {unknown}"


def test_each_word_has_a_row_in_the_guide() -> None:
    text = (ROOT / GUIDE).read_text(encoding="utf-8")
    table = re.search(r"^\| verdict \|.*\n\|[-|]+\n((?:\|.*\n)+)", text, re.MULTILINE)
    assert table is not None
    firsts = [line.split("|")[1].strip() for line in table[1].splitlines()]
    words = {word for first in firsts for word in first.split(", ")}
    missing = set(get_args(VerdictKind)) - words
    assert not missing, f"the table of verdicts in {GUIDE} has no row for {missing}"
    unknown = words - set(get_args(VerdictKind))
    assert not unknown, f"the table of verdicts in {GUIDE} has rows for {unknown}, which are no verdicts"
