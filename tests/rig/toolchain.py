"""What to do where a test needs a tool that is not there."""

import os
import shutil
from typing import NoReturn

import pytest


def missing(reason: str) -> NoReturn:
    """Skip; but fail in CI, which has every tool (tools/setup.sh)."""
    if os.environ.get("CI") == "true":
        pytest.fail(reason)
    pytest.skip(reason)


def needed(tool: str, package: str = "") -> str:
    """Where a tool is, in a package of Debian that has another name perhaps; skips without it."""
    path = f"{os.environ['PATH']}:/usr/sbin"
    return shutil.which(tool, path=path) or missing(f"no {tool} (Debian: {package or tool})")


def arm_compiler() -> str:
    """The compiler for the board."""
    return needed("arm-none-eabi-g++", "gcc-arm-none-eabi")
