"""CI checks the packages for known vulnerabilities.

A known vulnerability is an error. If the service that lists vulnerabilities cannot be reached, the check says
so.
"""

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.rig.host_support import ROOT

FINE: dict[str, Any] = {"name": "fine", "version": "1.0", "vulns": []}
BAD = {"name": "bad", "version": "2.0", "vulns": [{"id": "CVE-1", "fix_versions": ["2.1"]}]}
OPEN = {"name": "open", "version": "3.0", "vulns": [{"id": "CVE-2", "fix_versions": []}]}
SKIPPED = {"name": "other", "skip_reason": "not found"}
NO_DATA = "audit: NOT DONE: no data on vulnerabilities can be had from here (build/audit.log)"


@pytest.mark.parametrize(
    ("installs", "found", "code", "lines"),
    [
        (False, [BAD], 0, ["audit: NOT DONE: pip-audit cannot be installed here (build/audit.log)"]),
        (True, None, 0, [NO_DATA]),
        (True, [], 0, [NO_DATA]),
        (True, [SKIPPED], 0, [NO_DATA]),
        (True, [FINE, SKIPPED], 0, ["audit: 1 of 2 packages looked up, 0 known vulnerabilities"]),
        (
            True,
            [FINE, BAD, OPEN],
            1,
            [
                "audit: bad 2.0: CVE-1; mended in 2.1",
                "audit: open 3.0: CVE-2; mended in no version",
                "audit: 3 of 3 packages looked up, 2 known vulnerabilities",
            ],
        ),
    ],
)
def test_what_is_known_ends_it_and_what_is_not_is_said(
    installs: bool, found: list[Any] | None, code: int, lines: list[str], tmp_path: Path
) -> None:
    """Run the check with a fake pip-audit. `found`: what pip-audit prints, or None if it fails and prints
    nothing.
    """
    folder = tmp_path / "build/audit/bin"
    folder.mkdir(parents=True)
    (tmp_path / "found.json").write_text("" if found is None else json.dumps({"dependencies": found}))
    fakes = {
        "python": f'[ "$1" != -m ] || exit {int(not installs)}\nexec {sys.executable} "$@"\n',
        "pip-audit": f"cat {tmp_path}/found.json\nexit 1\n",
    }
    for name, text in fakes.items():
        (folder / name).write_text(f"#!/bin/sh\n{text}")
        (folder / name).chmod(0o755)
    (tmp_path / "tools").mkdir()
    script = shutil.copy(ROOT / "tools/audit.sh", tmp_path / "tools")
    done = subprocess.run([script], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout.splitlines()) == (code, lines), done.stderr


def test_ci_looks_at_all_that_is_installed_and_ends_with_what_it_finds() -> None:
    script = (ROOT / ".ci/run").read_text("utf-8")
    assert "set -euo pipefail" in script
    assert "\ntools/audit.sh\n" in script
    assert "-r tools/hashes/dev.txt" in (ROOT / "tools/audit.sh").read_text("utf-8")
