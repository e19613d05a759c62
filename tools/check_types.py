"""Runs mypy over the program, `tools` and `tests`, each module under the name by which it is imported.

Modules directly in `tools` or `tests/rig` are imported without the folder's name, all other modules with it.
If mypy were given file names, it would take the two names for two modules.

Usage: check_types.py [arguments for mypy]
"""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PATH = ("host", ".", "tools", "tests/rig")
FLAT = ("tools", "tests/rig")
BY_PACKAGE = (
    "tools.made_up_board",
    "tools.own_estimator",
    "tools.standin",
    "tools.demo",
    "tools.due_run",
    "tools.fed_source",
    "tools.fleet_fits",
    "tools.fleet_load",
    "tools.frames_load",
    "tools.nats_users",
    "tools.pty_port",
)
"""Modules of `tools` that are imported as `tools.NAME`, because they import packages inside `tools`."""


def names() -> list[str]:
    """Return mypy's arguments that name every package and module."""
    packages = ["fltea", *(f"tools.{name}" for name in _folders("tools"))]
    packages += [f"tests.{name}" for name in _folders("tests") if name != "rig"]
    flat = {file.stem for folder in FLAT for file in (ROOT / folder).glob("*.py")}
    flat -= {name.rpartition(".")[2] for name in BY_PACKAGE}
    modules = [*sorted(flat), *BY_PACKAGE, "tests.conftest"]
    return [word for name in packages for word in ("-p", name)] + [
        word for name in modules for word in ("-m", name)
    ]


def _folders(folder: str) -> list[str]:
    return sorted({file.parent.name for file in (ROOT / folder).glob("*/*.py")})


def path() -> str:
    """Return the search path of the modules, for mypy's environment variable MYPYPATH."""
    return os.pathsep.join(str(ROOT / folder) for folder in PATH)


def main() -> int:
    """Run mypy and return its exit code."""
    environment = {**os.environ, "MYPYPATH": path()}
    command = [sys.executable, "-m", "mypy", *sys.argv[1:], *names()]
    return subprocess.run(command, cwd=ROOT, env=environment, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
