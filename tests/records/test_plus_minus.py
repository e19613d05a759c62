"""Tests that the number after "±" is half of a 95 % interval in all texts for people."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import fltea
import pytest
from fltea.records.plus_minus import NORMAL_95, angle_within, plus_minus, within

PACKAGE = Path(fltea.__file__).parent
RANGE = "the range of a sensor or of numbers"
TARGET = "half of a 95 % interval that is wanted"
BOUND = "a limit that nothing exceeds"
SIGN = "the sign itself"
OTHERS = {
    "cli/standard_output.py": (1, "the sign itself, and how it is spelled in ASCII"),
    "records/plus_minus.py": (4, "the place where it is made"),
    "archive/info.py": (1, RANGE),
    "cli/app.py": (1, RANGE),
    "cli/identify_options.py": (7, f"a band of frequencies; {TARGET}"),
    "fleet/page.js": (1, "1.96 σ, as in the code before it"),
    "identification/comparison.py": (3, "half of a 95 % interval"),
    "identification/data_sheet.py": (2, RANGE),
    "identification/findings.py": (1, SIGN),
    "identification/forecast.py": (3, TARGET),
    "identification/data_checks.py": (3, RANGE),
    "lab/reproduce/open_choices.py": (2, RANGE),
    "lab/reproduce/scenarios.py": (1, RANGE),
    "machine/doctor/checks_link.py": (1, RANGE),
    "recording/bag_names.py": (1, SIGN),
    "recording/which_sensor.py": (2, "σ, as its heading says"),
    "recording/other_facts.py": (2, "the signs that a file writes before a range"),
    "sinks/page/answer.py": (2, TARGET),
    "sinks/page/facts.py": (3, f"{RANGE}; 1.96 σ, as in the code before it"),
    "sinks/page/page.js": (4, "a kind of column"),
    "sinks/table.py": (1, RANGE),
    "sources/i2c/source.py": (1, BOUND),
    "sources/i2c/texts.py": (1, BOUND),
}
"""For each source file with texts that contain ±, the number of such texts, and what the sign means in them.
"""
SPELLINGS = ("±", r"\xb1", r"\u00b1", "PLUS-MINUS")
"""How Python code may write the sign ±. A file with none of these spellings need not be parsed."""


def texts(path: Path) -> Iterator[str]:
    """Yield all texts of a file except docstrings and comments.

    If none of them can contain the sign ±, nothing is yielded.
    """
    code = path.read_text(encoding="utf-8")
    if path.suffix != ".py":
        yield from (re.sub(r"//.*", "", line) for line in code.splitlines())
        return
    if not any(spelling in code for spelling in SPELLINGS):
        return
    tree = ast.parse(code)
    documents = {
        id(node.value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in documents:
            yield node.value


def with_sign() -> dict[str, list[str]]:
    files = [path for kind in ("*.py", "*.js", "*.html") for path in PACKAGE.rglob(kind)]
    found = {path.relative_to(PACKAGE).as_posix(): list(texts(path)) for path in files}
    return {name: those for name, all_ in found.items() if (those := [text for text in all_ if "±" in text])}


def test_each_sign_is_a_95_percent_interval_or_says_what_it_is() -> None:
    """Code should write standard deviations with `fltea.records.plus_minus`.

    `OTHERS` lists all other uses of ±.
    """
    found = {name: len(those) for name, those in with_sign().items()}
    assert found == {name: count for name, (count, _) in OTHERS.items()}


def test_the_pages_write_95_percent() -> None:
    fleet, page = (
        (PACKAGE / name).read_text(encoding="utf-8") for name in ("fleet/page.js", "sinks/page/page.js")
    )
    assert "half = 1.96 * std" in fleet
    assert "NORMAL_95 = 1.96" in page
    assert "sign * NORMAL_95 * columns[`${name}_std`]" in page


def test_what_stands_behind_it() -> None:
    assert plus_minus(1.0, 0.1) == "1.00 ± 0.20"
    assert plus_minus(1.0, 0.1 / NORMAL_95) == "1.00 ± 0.10"
    assert angle_within(1 / NORMAL_95) == "± 1°"
    assert within(0.5, " ppm") == "± 0.98 ppm"
    assert angle_within(200.0) == "no heading left"


@pytest.mark.parametrize(
    ("value", "std", "shown"),
    [(None, 1.0, "–"), (2.0, None, "2.000"), (2.0, 0.0, "2.000 ± 0"), (1e9, 1e7, "1.000e+09 ± 1.960e+07")],
)
def test_what_is_not_known(value: float | None, std: float | None, shown: str) -> None:
    assert plus_minus(value, std) == shown
