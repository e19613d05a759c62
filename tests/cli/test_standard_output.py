"""Tests of commands whose standard output is full, not open for writing, or limited to ASCII."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from fltea.cli.standard_output import SPELL, prepare

from tests.rig.host_support import PATIENCE_S, strict_records

NAME = "müll α.npz"
COMMANDS = [["--help"], ["--version"], ["info", NAME], ["info", "--json", NAME]]


def fltea_command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "fltea", *arguments]


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    counts = np.random.default_rng(1).integers(-50, 50, (600, 3)).astype(np.int16)
    np.savez(NAME, gyro_raw=counts, fs_hz=100.0, lsb_per_dps=16.4)


def in_ascii(*arguments: str) -> str:
    environment = os.environ | {"PYTHONIOENCODING": "ascii"}
    done = subprocess.run(
        fltea_command(*arguments), capture_output=True, text=True, encoding="ascii", env=environment
    )
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_a_full_disk_is_named_as_what_failed(command: list[str]) -> None:
    with open("/dev/full", "wb") as full:
        done = subprocess.run(fltea_command(*command), stdout=full, stderr=subprocess.PIPE, text=True)
    assert (done.returncode, done.stderr) == (
        1,
        "fltea: error: cannot write the output: [Errno 28] No space left on device. The disk or device that "
        "it leads to is full.\n",
    )


def without(descriptor: int, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the command with one of its standard descriptors closed, as some programs start others."""
    command = ["sh", "-c", f'exec "$@" {descriptor}>&-', "sh", *fltea_command(*arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=PATIENCE_S)


def test_a_closed_output_is_named() -> None:
    done = without(1, "--version")
    assert (done.returncode, done.stderr) == (
        2,
        "fltea: error: standard output is closed; give it a file, a pipe or /dev/null.\n",
    )


def test_a_closed_input_is_no_source() -> None:
    done = without(0, "run", "-s", "stdin:", "--columns", "1", "--units", "dps", "--rate", "100")
    assert (done.returncode, done.stdout) == (2, "")
    assert "was started without a standard input" in done.stderr


def test_messages_for_a_closed_standard_error_go_nowhere() -> None:
    done = without(2, "run", "-s", "synthetic:?alpha=x", "--record", "kept")
    assert (done.returncode, done.stdout) == (2, "")
    done = without(2, "run", "-s", "synthetic:?n=60", "--once", "--format", "ndjson")
    assert "too_short" in {record.kind for record in strict_records(done.stdout) if hasattr(record, "kind")}


def test_an_output_that_is_open_for_reading_is_named_too() -> None:
    with open("/dev/null", "rb") as reading:
        done = subprocess.run(fltea_command("--version"), stdout=reading, stderr=subprocess.PIPE, text=True)
    assert (done.returncode, "It is not open for writing." in done.stderr) == (1, True)


@pytest.mark.parametrize(
    ("text", "plain"),
    [
        ("α ± σ [dps/√Hz]…", "alpha +/- sigma [dps/sqrtHz]..."),
        ("m/s², 10⁻³ µg, 20 °C – Γ × τ", "m/s^2, 10^-^3 ug, 20 degC - Gamma x tau"),
        ("┃ λ → Müller 😀\udcff ┃", "| lambda -> Muller ?? |"),
    ],
)
def test_letters_that_an_output_does_not_have_are_spelled(text: str, plain: str) -> None:
    prepare()
    assert text.encode("ascii", SPELL).decode() == plain


def test_an_output_in_ascii_gets_the_same_words_in_other_letters() -> None:
    assert "order alpha and parameter f" in " ".join(in_ascii("--help").split())
    assert "/sqrt" in in_ascii("identify", NAME)


@pytest.mark.parametrize("command", ["info", pytest.param("identify", marks=pytest.mark.slow)])
def test_json_stays_exact_in_ascii(command: str) -> None:
    """If standard output is limited to ASCII, JSON still contains the exact text, as escapes. Programs can
    therefore use the file names in it.
    """
    found = json.loads(in_ascii(command, "--json", NAME))
    assert NAME in json.dumps(found, ensure_ascii=False)
