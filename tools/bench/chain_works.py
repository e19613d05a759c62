"""The tasks that `make bench ARGS=--chain` measures: a program processes recordings, or live devices.

The program may be that of another commit (`tools.bench.programs`). Files, devices and the measurement of time
are always those of the present commit.
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from fltea.estimator.engine import Engine
from fltea.estimator.lane_settings import LaneSettings
from fltea.settings.estimator import EstimatorConfig
from numpy.typing import NDArray

from tools.bench import bench_daemon, day_files
from tools.bench.bench_daemon import Setting
from tools.bench.feeder import RATE_HZ, relaxation
from tools.bench.programs import Program

AT_ONCE = 8192

Figures = dict[str, Any]


class Files:
    """Recordings of the same samples in all formats, each written when it is first used."""

    def __init__(self, folder: Path, seconds: int) -> None:
        folder.mkdir(exist_ok=True)
        self.folder, self._seconds = folder, seconds

    @cached_property
    def gyro(self) -> NDArray[np.int16]:
        """Return the counts of white noise of three axes, of shape (samples, 3)."""
        return day_files.counts(self._seconds * RATE_HZ)

    @cached_property
    def npz(self) -> Path:
        """Return the path of a recording of white noise."""
        return self._written("white.npz", day_files.write_npz, self.gyro)

    @cached_property
    def coloured(self) -> Path:
        """Return the path of a recording of white noise plus an AR(1) process."""
        noise = np.rint(relaxation(1, len(self.gyro))).astype(np.int16)
        return self._written("coloured.npz", day_files.write_npz, self.gyro + noise)

    @cached_property
    def csv(self) -> Path:
        """Return the path of the recording of white noise as CSV in deg/s."""
        return self._written("white.csv", day_files.write_csv, self.gyro)

    @cached_property
    def mcap(self) -> Path:
        """Return the path of the recording of white noise as MCAP, in the form that the daemon records."""
        return self._written("mcap", day_files.write_mcap, self.gyro)

    def _written(self, name: str, write: Callable[[Path, Any], object], gyro: NDArray[np.int16]) -> Path:
        write(self.folder / name, gyro)
        return self.folder / name


Work = Callable[[Files, Program], Figures]


def run_program(command: Sequence[str], out: Path | None = None) -> Figures:
    """Return the time and memory that a program and its child processes use; its output goes to `out`.

    If the program fails, RuntimeError is raised.
    """
    with open(out or os.devnull, "wb") as stream:
        measure = [sys.executable, "-c", _MEASURE, *command]
        done = subprocess.run(measure, stdout=stream, stderr=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command[2:])}: {done.stderr[-300:]}")
    return dict(zip(("wall_s", "cpu_s", "rss_mb"), json.loads(done.stderr.splitlines()[-1]), strict=True))


_MEASURE = """
import contextlib, ctypes, json, os, subprocess, sys, time
ctypes.CDLL(None).prctl(36, 1, 0, 0, 0)  # PR_SET_CHILD_SUBREAPER: its workers are waited for, too
begin_s = time.monotonic()
program = subprocess.Popen(sys.argv[1:])
cpu_s = rss_kb = code = 0
with contextlib.suppress(ChildProcessError):
    while True:
        pid, status, usage = os.wait4(-1, 0)
        if pid == program.pid:
            wall_s, code = time.monotonic() - begin_s, os.waitstatus_to_exitcode(status)
        cpu_s += usage.ru_utime + usage.ru_stime
        rss_kb = max(rss_kb, usage.ru_maxrss)
print(json.dumps([wall_s, cpu_s, rss_kb / 1024]), file=sys.stderr)
os._exit(code % 256)
"""
"""Code of a small process that starts the measured program. The process has to be small because a program's
peak memory includes the memory of the process that forked it.
"""


def replay(
    form: str, files: Files, program: Program, *, output: str = "none", more: Sequence[str] = ()
) -> Figures:
    """Replay a recording in this file format. The records are discarded, or written to a file as NDJSON.

    `more`: options of `fltea run`.
    """
    path = getattr(files, form)
    command = program.command("run", "-s", f"replay:{path}", "--once", "--format", output, *more)
    return run_program(command, None if output == "none" else files.folder / "lines")


def start(files: Files, program: Program) -> Figures:
    """Start the program with --help, so that it ends immediately."""
    return run_program(program.command("run", "--help"))


def export(suffix: str, files: Files, program: Program) -> Figures:
    """Export the MCAP recording to another format."""
    return run_program(program.command("export", files.mcap, "--to", files.folder / f"exported{suffix}"))


def identify(files: Files, program: Program) -> Figures:
    """Identify the recording with the usual options.

    The test with shuffled copies of the samples is left out. This is the only difference from usual use.
    """
    return run_program(program.command("identify", files.npz, "--shuffles", 0))


def identify_in_full(files: Files, program: Program) -> Figures:
    """Identify the recording with all figures as JSON, but without the test with shuffled copies."""
    return run_program(program.command("identify", files.npz, "--json", "--shuffles", 0))


def code(text: str, form: str, files: Files, program: Program) -> Figures:
    """Run Python code with the program's packages. Its argument is the path of the file in format `form`."""
    return run_program([program.python, "-c", text, str(getattr(files, form))])


def engine_alone(files: Files) -> Figures:
    """Return the time that the engine in this process takes for the same samples, in blocks."""
    y = np.asarray(files.gyro[200:], dtype=np.float64) / day_files.LSB_PER_DPS
    engine = Engine(3, LaneSettings(EstimatorConfig(), 1 / RATE_HZ, y[:1000].var(axis=0)))
    begin_s, begin_cpu_s = time.monotonic(), time.process_time()
    for begin in range(0, len(y), AT_ONCE):
        engine.run(y[begin : begin + AT_ONCE])
    return {
        "wall_s": time.monotonic() - begin_s,
        "cpu_s": time.process_time() - begin_cpu_s,
        "rss_mb": None,
    }


def live(setting: Setting, files: Files, program: Program) -> Figures:
    """Run a daemon on simulated devices; return its figures and the sum of all kinds of losses."""
    run = bench_daemon.run_once(setting, program)
    return run | {"lost_or_errors": sum(run[key] for key in bench_daemon.LOST)}
