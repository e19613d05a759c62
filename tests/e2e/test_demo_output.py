"""Tests of what `make run` prints: one line a second without a terminal, the emulator's warning, and the
steps of set-up.
"""

import io
import json
import os
import shutil
import subprocess
from pathlib import Path

import msgspec
import numpy as np
import pytest
from fltea.noise.spectra import g_of, step_variance
from fltea.records.plus_minus import plus_minus
from fltea.records.records import Estimate
from fltea.settings.device_name import device_name
from fltea.sources.synthetic import parse_noise

from tests.rig.due_support import ROOT
from tests.rig.example_records import GOOD, STATS
from tests.rig.host_support import fltea_here
from tools import demo
from tools.due_emulator.pty_front import Pace
from tools.validation.evaluate.cramer_rao import bound

SAMPLES = 450


def test_a_run_becomes_one_line_for_each_second_of_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "noise.csv"
    gyro = np.random.default_rng(3).normal(0, 0.1, (SAMPLES, 3))
    np.savetxt(file, gyro, delimiter=",", header="gx,gy,gz", comments="")
    source = ["--source", str(file), "--columns", "gx,gy,gz", "--units", "dps", "--rate", "100"]
    settings = ["--startup", "150", "--set", "estimator.window=200"]
    records = fltea_here("run", "--format", "ndjson", "--once", *source, *settings).stdout
    demo.show_summary(io.StringIO(records))
    lines = capsys.readouterr().out.splitlines()
    assert 0 < len(lines) == records.count('"class":"stats"') <= SAMPLES / 100 + 1
    assert "start-up: " in lines[0]
    last = [json.loads(line) for line in records.splitlines() if '"class":"estimate"' in line][-1]
    for name, axis in last["axes"].items():
        verdict = axis["verdict"] or "no stable verdict yet"
        assert f"{name} {verdict}, bias {plus_minus(axis['bias'], axis['bias_std'])} deg/s" in lines[-1]


def test_an_order_is_shown_with_its_intervals_and_motion_is_told() -> None:
    estimate = Estimate(
        1, 1, 1, 1, "joint", {"gyro_x": msgspec.structs.replace(GOOD, moving=True)}, device="due"
    )
    summary = demo.Summary()
    for record in (estimate, STATS):
        line = summary.line(msgspec.json.encode(record).decode())
    assert line is not None
    assert "gyro_x fractional, α 0.51 [0.42, 0.60], f -1.20 [-2.50, -0.70]" in line
    assert "bias 0.234 ± 0.024 deg/s, moving" in line


def test_what_is_no_record_is_shown_as_it_is(capsys: pytest.CaptureFixture[str]) -> None:
    demo.show_summary(io.StringIO("Traceback\n{}\n"))
    assert capsys.readouterr().out == "Traceback\n{}\n"


def test_the_truth_is_that_of_the_noise_and_what_is_said_of_it_holds() -> None:
    noise, h = parse_noise(demo.NOISE), 1 / demo.RATE_HZ
    assert (noise.alpha, noise.f, noise.R, noise.rate_hz) == (demo.ALPHA, demo.F, demo.R, demo.RATE_HZ)
    s2 = step_variance(noise.alpha, noise.Q, h)
    assert s2 / noise.R == pytest.approx(demo.S2_OVER_R, rel=1e-4)
    for seconds, alpha, f in demo.KNOWN:
        best = bound(noise.alpha, g_of(noise.alpha, noise.f, h), s2, noise.R, round(seconds / h), h)
        assert (alpha, f) == pytest.approx((1.96 * best.alpha, 1.96 * best.f), rel=0.16)
    # In the range ±2000 deg/s, rounding to counts adds white noise, which must not hide the demo's own noise.
    assert 1 / 12 / (noise.R * 16.4**2) < 0.02
    assert device_name(f"serial:/tmp/folder/{demo.DEVICE}") == demo.DEVICE


def test_a_format_that_was_asked_for_is_left_alone() -> None:
    assert demo.output(["--format", "ndjson"]) == demo.output(["--format=table"]) == []
    assert demo.output(["--estimate-on", "both"]) == ["--format", "ndjson"]


def test_the_warning_is_shown_with_what_the_figures_then_mean(capsys: pytest.CaptureFixture[str]) -> None:
    pace = Pace()
    warning = pace.check(1.0, 0.4)
    assert warning is not None
    demo.pass_on(io.StringIO(f"due_emulator: {warning}\ndue_emulator: {warning}\n"))
    first, meaning, second = capsys.readouterr().err.splitlines()
    assert first == second
    assert "unaffected" in meaning


@pytest.fixture
def setup(tmp_path: Path) -> list[str]:
    """Return a copy of the set-up script, with a fake Python that installs nothing."""
    python = tmp_path / ".venv/bin/python"
    python.parent.mkdir(parents=True)
    python.write_text("#!/bin/sh\necho Collecting something\ncase $* in *scikit*) sleep ${PAUSE:-0};; esac\n")
    python.chmod(0o755)
    (tmp_path / "tools").mkdir()
    shutil.copy(ROOT / "tools/setup.sh", tmp_path / "tools")
    return ["bash", str(tmp_path / "tools/setup.sh"), "run"]


def test_setup_says_which_step_of_how_many_it_is_at(setup: list[str]) -> None:
    told = subprocess.run(setup, capture_output=True, text=True, check=True).stderr.splitlines()
    assert [line.split()[1] for line in told] == ["1/3", "2/3", "3/3", "ready"]


@pytest.mark.slow
def test_setup_shows_seconds_and_what_it_does_on_a_terminal(setup: list[str]) -> None:
    terminal, far_end = os.openpty()
    subprocess.run(setup, stderr=far_end, check=True, env={**os.environ, "PAUSE": "0.7"})
    os.close(far_end)
    told = os.read(terminal, 1 << 16).decode()
    os.close(terminal)
    assert "s  Collecting something" in told
