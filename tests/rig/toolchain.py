"""Find the programs that tests need, and decide what happens if one of them is not installed."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any, NoReturn

import pytest

ROOT = Path(__file__).resolve().parents[2]


def missing(reason: str) -> NoReturn:
    """Skip the test; in CI, which has every tool (tools/setup.sh), fail it."""
    if os.environ.get("CI") == "true":
        pytest.fail(reason)
    pytest.skip(reason)


def needed(tool: str, package: str = "") -> str:
    """Return the path of a tool; skip the test if it is not installed.

    `package`: the Debian package if its name differs.
    """
    path = f"{os.environ['PATH']}:/usr/sbin"
    return shutil.which(tool, path=path) or missing(f"no {tool} (Debian: {package or tool})")


def arm_compiler() -> str:
    return needed("arm-none-eabi-g++", "gcc-arm-none-eabi")


def run_tool(tool: str, root: Path, *options: str, **how: Any) -> subprocess.CompletedProcess[str]:
    """Run a module of `tools` on a repository at `root`; Python warnings are errors."""
    command = [sys.executable, "-W", "error", "-m", f"tools.{tool}", *options, "--root", root]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, **how)
