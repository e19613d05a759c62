#!/usr/bin/env bash
# Look up the known vulnerabilities of the pinned packages with pip-audit. Exit code 1: at least one was
# found. Without its data (no network, or a mirror that has none) the script says so and ends with 0.
set -euo pipefail
cd "$(dirname "$0")/.."
say() { printf 'audit: %s\n' "$*"; }

folder=build/audit
{ [ -x $folder/bin/pip-audit ] || python3 -m venv $folder &&
    $folder/bin/python -m pip install --quiet --require-hashes --no-deps -r tools/hashes/audit.txt; } >$folder.log 2>&1 ||
    { say "NOT DONE: pip-audit cannot be installed here (build/audit.log)"; exit 0; }
PYTHONWARNINGS=ignore $folder/bin/pip-audit --disable-pip --no-deps --progress-spinner off --format json \
    -r tools/hashes/dev.txt >$folder.json 2>$folder.log || true
$folder/bin/python - $folder.json <<'PYTHON'
import json
import sys

try:
    with open(sys.argv[1], encoding="utf-8") as file:
        packages = json.load(file)["dependencies"]
except ValueError:
    packages = []
known = [one for one in packages if "vulns" in one]
if not known:
    sys.exit(print("audit: NOT DONE: no data on vulnerabilities can be had from here (build/audit.log)"))
found = [(one["name"], one["version"], vuln) for one in known for vuln in one["vulns"]]
for name, version, vuln in found:
    print(f"audit: {name} {version}: {vuln['id']}; mended in {', '.join(vuln['fix_versions']) or 'no version'}")
print(f"audit: {len(known)} of {len(packages)} packages looked up, {len(found)} known vulnerabilities")
sys.exit(bool(found))
PYTHON
