"""Run the committed firmware image on the emulated Due, for tests from the chip to the output.

A run of the image that several tests need is made once and shared.
"""

import os
from functools import cache
from pathlib import Path

from tests.rig.host_support import ROOT
from tests.rig.toolchain import arm_compiler
from tools.due_emulator.__main__ import IMAGE as COMMITTED
from tools.due_run import DueRun
from tools.faults.board import DUE_CASES, Measured, measure

IMAGE = Path(os.environ.get("FLTEA_DUE_IMAGE", COMMITTED))
"""The image under test; `make mutants` sets other images."""
NOISE = "alpha=0.5&f=-1&seed=7"
PERIOD_US = 10_000


@cache
def image() -> bytes:
    return IMAGE.read_bytes()


def after_a_reading(run: DueRun) -> DueRun:
    """Let the emulated Due run until it has just read the sensor. The program is then in the middle of a
    sampling step.
    """
    bursts, twi = run.boots[-1].bursts, run.board.twi
    seen = len(bursts)
    while len(bursts) == seen or not twi.field("SR", "TXCOMP"):
        run.board.run_until(run.board.now_s + 1e-5)
    return run


@cache
def with_fault(name: str) -> tuple[DueRun, Measured]:
    return measure(image(), next(case for case in DUE_CASES if case.name == name))


def build(mode: str, folder: Path, *defines: str) -> bytes:
    """Compile a firmware image from the present sources. Skip the test if there is no compiler (CI has one).

    `defines`: overrides of firmware/core/settings.h.
    """
    arm_compiler()
    from tools.build_firmware import build

    return build(ROOT, mode, folder, defines).data
