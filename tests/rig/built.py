"""What tests need compiled is compiled once, though several processes run tests."""

import fcntl
import subprocess
from pathlib import Path


def make(folder: Path, build: Path, *goals: str) -> subprocess.CompletedProcess[str]:
    """Run `make BUILD=build goals` in a folder; who comes while another one does waits, and finds it made."""
    build.mkdir(parents=True, exist_ok=True)
    with (build / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        command = ["make", "-C", str(folder), f"BUILD={build}", *goals]
        return subprocess.run(command, capture_output=True, text=True, check=False)
