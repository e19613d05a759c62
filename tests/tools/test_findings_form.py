"""The form of the scripts in `findings/` is checked.

The scripts are not run by tests, because they need a package index.
"""

import shutil
from pathlib import Path

import pytest

from tools import findings_form as form

HEAD = """#!/usr/bin/env bash
# library: one 1.2, two 3
# expected: that it keeps the unit of a channel, as its manual says in
#   section 4.
# seen: the unit is dropped, and the figures are a thousand times as large.
# matters: whoever takes these figures has a noise density that no sensor has.
# fltea: asks for the unit of such a file, and shows what each would mean.
"""
BODY = """set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet one==1.2 two==3
"$folder/venv/bin/python" -c 'print(1)'
"""


def faults(
    tmp_path: Path, text: str, table: str = "| [a.sh](a.sh) | what |\n", mode: int = 0o755
) -> list[str]:
    (tmp_path / "a.sh").write_text(text)
    (tmp_path / "a.sh").chmod(mode)
    (tmp_path / "README.md").write_text(table)
    return form.faults(tmp_path)


def test_ours_have_the_form() -> None:
    assert form.faults(form.ROOT / "findings") == []
    assert len(list((form.ROOT / "findings").glob("*.sh"))) >= 4


def test_a_script_of_the_form_has_no_faults(tmp_path: Path) -> None:
    assert faults(tmp_path, HEAD + BODY) == []


@pytest.mark.parametrize(
    ("before", "after", "why"),
    [
        ("# seen: ", "# saw: ", "lacks '# seen:'"),
        (
            "# matters: whoever takes these figures has a noise density that no sensor has.",
            "# matters: much",
            "is no sentence",
        ),
        ("in\n#   section 4", "somewhere", "names no source"),
        ("two 3", "two 4", "names two 4"),
        ("two==3", "two", "'two' has no version"),
        ("set -euo pipefail", "set -eu", "stops at the first error"),
        ("trap 'rm", "echo 'rm", "removes the folder"),
        ("print(1)", "import fltea", "uses fltea"),
        ('"$folder/venv/bin/pip" install --quiet one==1.2 two==3', ":", "installs no package"),
    ],
)
def test_each_part_of_the_form_is_asked_for(tmp_path: Path, before: str, after: str, why: str) -> None:
    text = HEAD + BODY
    assert before in text
    assert any(why in fault for fault in faults(tmp_path, text.replace(before, after)))


def test_the_order_of_the_head_the_table_and_the_mode_are_looked_at(tmp_path: Path) -> None:
    lines = HEAD.splitlines(keepends=True)
    turned = "".join([*lines[:4], lines[5], lines[4], *lines[6:]])
    assert any("have to be" in fault for fault in faults(tmp_path, turned + BODY))
    assert any("its table has" in fault for fault in faults(tmp_path, HEAD + BODY, table="no row\n"))
    assert any("chmod" in fault for fault in faults(tmp_path, HEAD + BODY, mode=0o644))
    shutil.copy(tmp_path / "a.sh", tmp_path / "data.csv")
    assert any("data.csv: is neither" in fault for fault in faults(tmp_path, HEAD + BODY))
