#!/usr/bin/env bash
# Build the sdist and, from the sdist alone, a wheel for each machine named, into build/dist.
# Usage: tools/dist/wheels.sh [x86_64] [aarch64]          (without a name: both)
set -euo pipefail
cd "$(dirname "$0")/../.."
# shellcheck source=tools/dist/common.sh
. tools/dist/common.sh
machines=("$@")
[ ${#machines[@]} -gt 0 ] || machines=(x86_64 aarch64)

"$python" -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' ||
    refuse "the wheels are built with Python 3.11, their oldest: make clean, then make dist PYTHON=python3.11"
mkdir -p "$out" "$work"
entries_but dist cobs >"$work/tools.txt"
"$python" -m pip install --quiet --no-deps --require-hashes -r "$work/tools.txt"

rm -f "$out"/fltea-*.tar.gz
"$python" -c 'import sys, scikit_build_core.build as backend; backend.build_sdist(sys.argv[1])' "$out" >"$work/sdist.log"
say "$(ls "$out"/fltea-*.tar.gz)"

for machine in "${machines[@]}"; do
    (
        [ "$machine" = "$(uname -m)" ] || [ "$machine" = aarch64 ] || refuse "no rule to build for $machine on $(uname -m)"
        folder=$work/$machine
        rm -rf "$folder/source" "$folder/build" "$folder/wheel"
        mkdir -p "$folder/source" "$folder/build" "$folder/wheel"
        tar -xf "$out/fltea-$version.tar.gz" --strip-components=1 -C "$folder/source"
        [ "$machine" = "$(uname -m)" ] || cross_environment
        say "building for $machine (log: $folder/build.log)"
        cd "$folder/source"
        # FLTEA_WERROR is set here alone: other compilers give other warnings.
        "$python" -m pip wheel --quiet --no-deps --no-build-isolation --wheel-dir "$folder/wheel" \
            --config-settings=build-dir="$folder/build" --config-settings=cmake.define.FLTEA_WERROR=ON . \
            >"$folder/build.log" 2>&1 || { cat "$folder/build.log" >&2; refuse "the wheel for $machine was not built"; }
        rm -f "$out"/fltea-*_"$machine".whl
        auditwheel repair --plat auto --wheel-dir "$out" "$folder"/wheel/*.whl >>"$folder/build.log" 2>&1 ||
            { cat "$folder/build.log" >&2; refuse "the wheel for $machine is not manylinux"; }
        [ -e "$(wheel_of "$machine")" ] ||
            refuse "the wheel asks for more than glibc ${glibc/_/.}: $(ls "$out"/fltea-*_"$machine".whl)"
        say "$(ls "$out"/fltea-*_"$machine".whl)"
    )
done
