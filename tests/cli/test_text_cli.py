"""`fltea run -s stdin:` as a program: a pipe in, records out."""

import json
import subprocess
import sys

PATIENCE_S = 60
COMMAND = [sys.executable, "-m", "fltea", "run", "-s", "stdin:", "--once", "--samples", "--columns", "gx"]
OPTIONS = ["--time-column", "t_ms", "--startup", "50", "--format", "ndjson"]


def test_lines_through_a_pipe_become_samples_and_losses_are_published() -> None:
    values = [(k * 7919 % 101 - 50) / 50 for k in range(400)]
    lines = [f"{k * 10},{value}\n" for k, value in enumerate(values) if k not in (300, 301)]
    lines.insert(200, "reset?\x1b[2J\n")
    result = subprocess.run(
        [*COMMAND, *OPTIONS],
        input=("IMU ready\nt_ms,gx\n" + "".join(lines)).encode(),
        capture_output=True,
        timeout=PATIENCE_S,
    )
    assert result.returncode == 0, result.stderr
    assert b"bad_lines" in result.stderr
    assert b"\x1b" not in result.stderr
    records = [json.loads(line) for line in result.stdout.splitlines()]
    assert next(r for r in records if r["class"] == "hello")["rate_hz"] == 100.0
    stats = [r for r in records if r["class"] == "stats"][-1]
    assert stats["samples"]["delivered"] == 398
    assert (stats["samples"]["lost"], stats["samples"]["gaps"]) == (2, 1)
    assert stats["link"]["bad_frames"] == {"before_header": 1, "text": 1}
    samples = [r for r in records if r["class"] == "sample"]
    assert len(samples) == 398


def test_an_input_without_samples_ends_with_2() -> None:
    result = subprocess.run([*COMMAND, *OPTIONS], input=b"a\nb\n", capture_output=True, timeout=PATIENCE_S)
    assert result.returncode == 2
    assert b"no sample was in it" in result.stderr
    assert b"Traceback" not in result.stderr
