"""The example of host/identify.md is run as it stands there."""

import re
import shlex
from pathlib import Path

import pytest
from host_support import fltea

PAGE = Path(__file__).parents[2] / "host" / "identify.md"


@pytest.mark.slow
def test_the_example_gives_what_the_page_says(tmp_path: Path) -> None:
    section = PAGE.read_text().split("## What a navigation filter needs\n")[1].split("\n## ")[0]
    model, table = (re.search(rf"```{kind}\n(.*?)```", section, re.DOTALL) for kind in ("json", "text"))
    assert model is not None
    assert table is not None
    (tmp_path / "sensor.json").write_text(model[1])
    files = {name: str(tmp_path / name) for name in ("sensor.json", "rest.npz", "navigation.json")}
    shown = ""
    for line in re.findall(r"^    fltea (.*)$", section, re.MULTILINE):
        done = fltea(*(files.get(word, word) for word in shlex.split(line)))
        assert (done.returncode, done.stderr) == (0, "")
        shown = done.stdout
    rows = [line.split() for line in shown.splitlines()]
    for line in table[1].splitlines():
        assert line.split() in rows
    assert (tmp_path / "navigation.json").exists()
