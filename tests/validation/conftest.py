"""A tiny evaluation, made once; and the command, called in this process."""

import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from fltea.identification.workers import Here
from validation_support import TINY

from tools.validation import __main__ as program
from tools.validation.evaluate import figures
from tools.validation.evaluate.run import Result, evaluate


@pytest.fixture
def validate(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> Callable[..., tuple[int, str, str]]:
    """Call the command in an empty folder; returns exit code, stdout, stderr."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["validation", *arguments])
        try:
            program.main()
            code = 0
        except SystemExit as end:
            code = int(end.code or 0)
        return code, *capsys.readouterr()

    return call


@pytest.fixture(scope="session")
def tiny() -> Result:
    return evaluate(TINY, Here())


@pytest.fixture(scope="session")
def drawn(tiny: Result) -> dict[str, bytes]:
    """Two of the maps and the settings: a map takes most of a second."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figures, "MAPS", {name: figures.MAPS[name] for name in ("error", "coverage")})
        return figures.draw(tiny)
