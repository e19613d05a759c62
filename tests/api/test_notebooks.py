"""The example notebooks give the output that is stored in them.

A notebook kernel would need forty packages, and seconds for each notebook. So the tests run the cells of a
notebook themselves, one after the other, and compare the cells' output with what a kernel stored in the file.
"""

import contextlib
import io
import json
import re
import tempfile
from pathlib import Path
from typing import Any

import pytest

FOLDER = Path(__file__).parents[2] / "host" / "notebooks"
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))


def test_there_are_three() -> None:
    assert [path.stem for path in NOTEBOOKS] == [
        "bias_and_heading",
        "noise_of_known_order",
        "resting_recording",
    ]


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_says_what_it_said(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    names: dict[str, Any] = {}
    cells = [cell for cell in json.loads(path.read_text())["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    for cell in cells:
        source = "".join(cell["source"])
        printed, value = _run(source, names)
        streams = [o for o in cell["outputs"] if o["output_type"] == "stream"]
        results = [o for o in cell["outputs"] if o["output_type"] == "execute_result"]
        assert len(streams) + len(results) == len(cell["outputs"]), source
        _assert_alike(printed, "".join("".join(o["text"]) for o in streams), source)
        assert bool(results) == (value is not None), source
        for result in results:
            _assert_alike(repr(value), "".join(result["data"]["text/plain"]), source)
            assert _words(value._repr_html_()) == _words("".join(result["data"]["text/html"])), source


def _run(source: str, names: dict[str, Any]) -> tuple[str, Any]:
    """Return what a cell prints, and the value of the cell's last line if that line is an expression."""
    *lines, last = source.splitlines()
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        if re.fullmatch(r"\w+(\[.*\])?", last):
            exec("\n".join(lines), names)
            return printed.getvalue(), eval(last, names)
        exec(source, names)
    return printed.getvalue(), None


def _assert_alike(found: str, stored: str, source: str) -> None:
    """Check that the words of two outputs are equal, and that their numbers differ at most in the last digit.
    Numbers may differ because processors differ in rounding.
    """
    assert NUMBER.sub("#", found) == NUMBER.sub("#", stored), source
    numbers = [float(n) for n in NUMBER.findall(found)]
    assert numbers == pytest.approx([float(n) for n in NUMBER.findall(stored)], rel=0.02, abs=0.0011), source


def _words(html: str) -> str:
    """Return the text of some HTML without its drawings."""
    return re.sub(r"<svg.*?</svg>|<[^>]*>", " ", NUMBER.sub("#", html), flags=re.S)
